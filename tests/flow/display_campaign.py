"""A whole simulated campaign on the display, in a real browser: `make display-check`.

Needs Chromium, and npm for axe.  Pictures of each word on phone, tablet and TV go to
build/display/.  Last comes the terminal of `tui --web`, which takes its first keys without a click.
"""

from __future__ import annotations

import asyncio
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from daq.control.address import control_address
from daq.control.exchange import Client
from daq.control.messages import Mark

from .bench_terminal import DemoBench, demo_bench
from .chromium import Tab, assert_accessible, tabs

SIZES = {"phone": (390, 844), "tablet": (1024, 768), "tv": (1920, 1080)}
PICTURES = Path("build/display")
MOST_S = 300.0
NOTE = "rear left damper looks wet"
TYPED_S = 60.0
"""Longest time, s, until the page has loaded, and until what is typed has arrived."""
PASSING = {"WAIT", "BUMP NOW", "HANDS OFF", "ACCEPTED", "AGAIN"}
"""Words that stand for a few seconds, too short for axe on three pages."""
STATE = """({
  word: document.getElementById("state").textContent,
  share: document.getElementById("word").dataset.high / innerHeight,
  across: Math.max(...[...document.querySelectorAll("#word text")].map(
    (line) => line.getBoundingClientRect().width)) / innerWidth,
  field: getComputedStyle(document.body).backgroundColor,
  ink: getComputedStyle(document.querySelector("#word text")).fill,
  wide: document.documentElement.scrollWidth - innerWidth,
})"""


def _luminance(colour: str) -> float:
    """Return the relative luminance of `rgb(1, 2, 3)` as WCAG 2 defines it."""
    parts = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours, 1 to 21."""
    dark, light = sorted((_luminance(one), _luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def _cpu_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def _state(tab: Tab) -> dict[str, Any]:
    found: dict[str, Any] = await tab.value(STATE)
    return found


async def _check(name: str, tab: Tab, word: str) -> None:
    """Check a picture: size and contrast of the word, nothing beyond the right edge."""
    state = await _state(tab)
    if state["word"] != word:  # it has passed meanwhile
        return
    ratio = contrast(state["field"], state["ink"])
    print(f"{word:14} {name:7} height {state['share']:.2f} contrast {ratio:.1f}")
    # As large as letters of a font can be: high, or from edge to edge of a narrow page.
    assert state["share"] >= 0.28 or state["across"] >= 0.9, (name, state)
    assert ratio >= 7.0, (name, state)
    assert state["wide"] <= 0, (name, state)
    if name == "phone" or word not in PASSING:
        await assert_accessible(tab, f"{word} on the {name}")
    await tab.picture(PICTURES / f"{word.replace(' ', '_').lower()}_{name}.png")


def _mark(bench: DemoBench, text: str) -> None:
    client = Client(control_address(bench.folder), "Test", control=True, take_over=True)
    client.ask(Mark(text), 60.0)
    client.close()


async def _campaign(bench: DemoBench, display: subprocess.Popen[str]) -> None:
    assert display.stderr is not None
    link = display.stderr.readline().split()[-1]
    number = "".join(re.findall(r"\d{3}", display.stderr.readline())[:2])
    async with tabs(len(SIZES)) as made:
        shown = dict(zip(SIZES, made, strict=True))
        for name, tab in shown.items():
            await tab.open(link, *SIZES[name])
        phone, tv = shown["phone"], shown["tv"]
        while not await phone.value("document.querySelector('#grant')?.offsetHeight > 0"):
            await asyncio.sleep(0.1)
        await phone.order("Page.bringToFront")
        await phone.press(" ")  # the first thing that happens to the page: no click before it
        await phone.press(number)
        await phone.press("\r")
        bench.skip_to_bumps()
        seen: set[str] = set()
        begun_s, used_s, reloaded = time.monotonic(), _cpu_s(display.pid), False
        while "DONE" not in seen:
            assert time.monotonic() - begun_s < MOST_S, seen
            word = (await _state(phone))["word"]
            if word not in seen:
                seen.add(word)
                for name, tab in reversed(shown.items()):
                    await _check(name, tab, word)
            if word in ("READY", "WEIGHTS ON?"):
                await phone.press(" ")
            elif word == "STEP 4":
                _mark(bench, "step masses done")
            elif word == "HANDS OFF" and not reloaded:
                reloaded = True
                await tv.order("Page.reload")
                while not await tv.value("document.querySelector('#word text') !== null"):
                    await asyncio.sleep(0.05)
            await asyncio.sleep(0.1)
        passed_s = time.monotonic() - begun_s
        share = (_cpu_s(display.pid) - used_s) / passed_s
        print(f"{share:.1%} of a core for {len(SIZES)} pages over {passed_s:.0f} s")
        assert seen >= {"BUMP NOW", "HANDS OFF", "ACCEPTED", "AGAIN", "STEP 4", "WEIGHTS ON?"}
        assert share < 0.05
        assert (await _state(tv))["word"] == "DONE", "it was loaded anew in mid-run"
        await _cut(phone, display)
        for tab in made:
            strangers = [url for url in tab.requested if not url.startswith(link)]
            assert not strangers, strangers


async def _cut(page: Tab, display: subprocess.Popen[str]) -> None:
    """Cut the line for 10 s: the page says so, and is there again by itself."""
    display.send_signal(signal.SIGSTOP)
    begun_s, said_s = time.monotonic(), 0.0
    while time.monotonic() - begun_s < 10.0:
        if not said_s and (await _state(page))["word"] == "NO LINE":
            said_s = time.monotonic() - begun_s
        await asyncio.sleep(0.1)
    display.send_signal(signal.SIGCONT)
    begun_s = time.monotonic()
    while (await _state(page))["word"] != "DONE":
        assert time.monotonic() - begun_s < 10.0
        await asyncio.sleep(0.05)
    print(f"NO LINE after {said_s:.1f} s; there again after {time.monotonic() - begun_s:.1f} s")
    assert 0.0 < said_s < 5.0


# `tui --web`: the first thing that happens to the page is a key, not a click -------------------


async def _type(bench: DemoBench, link: str, picture: Path) -> float:
    """Return the seconds that the page has taken to load."""
    async with tabs(1) as (tab,):
        begun_s = time.monotonic()
        await tab.order("Page.bringToFront")
        await tab.open(link, 1024, 768)
        while not await tab.value("document.body?.classList.contains('-first-byte') ?? false"):
            assert time.monotonic() - begun_s < TYPED_S, "the page has not loaded"
            await asyncio.sleep(0.01)
        loaded_s = time.monotonic()
        await tab.press(f"n{NOTE}\r")
        while not any(note.text == NOTE for note in bench.status().notes):
            if time.monotonic() - loaded_s > TYPED_S:
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


def main() -> None:
    """Run the campaign; raise AssertionError where the display falls short."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as folder,
        demo_bench(Path(folder), 2.0, repeats=2, fault="double-bump") as bench,
    ):
        bench.started()
        command = [sys.executable, "-m", "tui", "display", str(bench.folder), "--control"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as display:
            try:
                asyncio.run(_campaign(bench, display))
            finally:
                display.send_signal(signal.SIGCONT)
                display.terminate()
    with tempfile.TemporaryDirectory() as folder, demo_bench(Path(folder), 2.0) as bench:
        bench.started()
        bench.skip_to_bumps()
        print(keys_at_once(bench, PICTURES / "web.png"))


if __name__ == "__main__":
    main()
