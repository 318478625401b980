"""What the first screen costs: no library that only later steps need."""

from __future__ import annotations

import subprocess
import sys

_TO_THE_FIRST_SCREEN = """
import asyncio, sys
from pathlib import Path
from tests.tui.terminal.fake_recorder import FakeRecorder
from tui.terminal.app import BenchApp
from tui.terminal.state.feed import RecorderFeed
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
import tui.commands.tui

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


def test_home_and_run_screen_need_neither_scipy_nor_matplotlib() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _TO_THE_FIRST_SCREEN], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert "textual" in loaded
    assert not loaded & {"scipy", "matplotlib", "pandas", "asammdf", "can", "h5py"}
