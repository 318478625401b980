"""A process that opens a bus loads neither asammdf nor pandas; one that needs them has them."""

from __future__ import annotations

import json
import subprocess
import sys

_CHILD = """
import json, sys
from {first}
from daq.python_can import can
loaded = sorted({{"asammdf", "can", "pandas"}} & set(sys.modules))
import asammdf
print(json.dumps([loaded, can.__name__, asammdf.__name__, sys.modules["asammdf"] is asammdf]))
"""


def _after(first: str) -> object:
    done = subprocess.run(
        [sys.executable, "-c", _CHILD.format(first=first)],
        capture_output=True,
        check=True,
    )
    return json.loads(done.stdout)


def test_a_bus_costs_no_asammdf_and_leaves_it_to_be_imported() -> None:
    assert _after("daq.bus.interfaces import open_source") == [["can"], "can", "asammdf", True]


def test_what_is_loaded_already_stays() -> None:
    loaded = ["asammdf", "can", "pandas"]
    assert _after("asammdf import MDF") == [loaded, "can", "asammdf", True]
