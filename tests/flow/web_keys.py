"""`tui --web` in a real browser: the first thing that happens to the page is a key, not a click."""

from __future__ import annotations

import asyncio
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

from .bench_terminal import DemoBench
from .chromium import tabs

NOTE = "rear left damper looks wet"
MOST_S = 60.0


async def _type(bench: DemoBench, link: str, picture: Path) -> float:
    """Return the seconds that the page has taken to load."""
    async with tabs(1) as (tab,):
        begun_s = time.monotonic()
        await tab.order("Page.bringToFront")
        await tab.open(link, 1024, 768)
        while not await tab.value("document.body?.classList.contains('-first-byte') ?? false"):
            assert time.monotonic() - begun_s < MOST_S, "the page has not loaded"
            await asyncio.sleep(0.01)
        loaded_s = time.monotonic()
        await tab.press(f"n{NOTE}\r")
        while not any(note.text == NOTE for note in bench.status().notes):
            if time.monotonic() - loaded_s > MOST_S:
                await tab.picture(picture)
                raise AssertionError(f"keys were lost: {picture}")
            await asyncio.sleep(0.1)
        await tab.picture(picture)
        strangers = [url for url in tab.requested if not url.startswith((link, "data:"))]
        assert not strangers, strangers
        return loaded_s - begun_s


def keys_at_once(bench: DemoBench, picture: Path) -> str:
    """Write a note with the first keys after loading; return the figures in words.

    `bench`: with a recorder that is due to bump.  `picture`: where the page is stored as PNG.
    Raises AssertionError if a key is lost.
    """
    command = [sys.executable, "-m", "tui", "tui", "--web", "--demo", "--out", str(bench.folder)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server:
        try:
            assert server.stderr is not None
            link = re.search(r"http\S+", server.stderr.readline())
            assert link is not None
            loaded_s = asyncio.run(_type(bench, link[0], picture))
            return f"terminal in the page after {loaded_s:.1f} s; first {len(NOTE) + 2} keys right"
        finally:
            server.send_signal(signal.SIGINT)
