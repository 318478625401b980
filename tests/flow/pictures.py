"""Draws the README's two pictures anew in a Chromium of this machine: `make pictures`.

A run of the simulated car in the operator's terminal, and the first screen of a report.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
import tempfile
from pathlib import Path

from .bench_terminal import demo_bench, seat, terminal_on
from .chromium import Tab, tabs

DOCS = Path(__file__).parents[2] / "docs"
SIZES_PX = {"terminal-run.png": (1400, 754), "report.png": (1120, 900)}
TERMINAL = (110, 28)
"""Columns and rows of the terminal."""
SPEED = 5.0


async def _terminal(folder: Path) -> str:
    """Return the operator's terminal behind an accepted run, as SVG."""
    with demo_bench(folder, SPEED) as bench:
        bench.started().skip_to_bumps()
        app = terminal_on(bench.folder)
        async with seat(app, TERMINAL) as operator:
            await operator.until(operator.sees("ACCEPTED"), operator.space_if_offered)
            # The font that Textual names is on the web only, and another cannot draw Braille.
            return app.export_screenshot().replace("Fira Code", "DejaVu Sans Mono")


def _report(folder: Path) -> Path:
    """Return the report of a demonstration."""
    page = folder / "report.html"
    session = folder / "demo" / "session_0001.h5"
    for words in (["demo", "--out", session.parent], ["report", session, "--page", page]):
        command = [sys.executable, "-m", "tui", *map(str, words)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return page


async def _picture(tab: Tab, page: Path, target: Path) -> None:
    await tab.open(page.as_uri(), *SIZES_PX[target.name])
    await tab.order("Emulation.setScrollbarsHidden", hidden=True)
    while await tab.value("document.readyState") != "complete":
        await asyncio.sleep(0.1)
    await tab.picture(target)


async def draw(docs: Path) -> None:
    """Write both pictures into a folder."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "terminal.svg").write_text(await _terminal(folder), "utf-8")
        frame = folder / "terminal.html"
        frame.write_text('<body style="margin:0"><img src="terminal.svg" width="100%">', "utf-8")
        async with tabs(1) as (tab,):
            await _picture(tab, frame, docs / "terminal-run.png")
            await _picture(tab, _report(folder), docs / "report.png")


if __name__ == "__main__":
    asyncio.run(draw(DOCS))
