"""What the first screen costs: no library and no reader that only later steps need."""

from __future__ import annotations

import subprocess
import sys

_TO_THE_FIRST_SCREEN = """
import asyncio, sys
from pathlib import Path
from tui.commands.tui import _starter, _wanted
from tui.terminal.app import BenchApp
from tui.terminal.state.feed import RecorderFeed
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
_wanted(None, None, None, False, None)
_starter(Path(), None, (None, None), False, None, 1.0, None)
import daq.control.client
from daq.control.messages import REPLY
assert not REPLY.pydantic_complete
print("\\n".join(sorted(sys.modules)))
print("and with a recorder:")
from tests.tui.terminal.fake_recorder import FakeRecorder

async def main():
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = BenchApp(recorder, Path(), choose_glyphs(GlyphSet.ASCII, {}, "utf-8"), "MK")
    async with app.run_test() as pilot:
        await pilot.pause()
        await pilot.press("space")
        await pilot.pause()

asyncio.run(main())
print("\\n".join(sorted({name.split(".")[0] for name in sys.modules})))
"""


def test_home_and_run_screen_load_only_what_they_show() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _TO_THE_FIRST_SCREEN], capture_output=True, text=True, check=True
    )
    before, loaded = (set(part.split()) for part in done.stdout.split("and with a recorder:"))
    assert "tui.terminal.app" in before
    assert not before & {"daq.bench.config", "cantools", "tui.jobs.outcome"}
    assert "textual" in loaded
    assert not loaded & {"scipy", "matplotlib", "pandas", "asammdf", "can", "h5py"}
