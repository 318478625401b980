"""How a command ends."""

import subprocess
import sys

_COUNTED = """
import atexit, gc, sys
from tui.cli import main
sys.argv = ["bumpbench", *sys.argv[1:]]
atexit.register(lambda: print(gc.get_freeze_count()))
main()
"""


def test_what_is_loaded_is_not_searched_for_garbage_at_the_end() -> None:
    command = [sys.executable, "-c", _COUNTED, "inspect", "no such file"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert int(done.stdout) > 10_000
