"""Report, comparison and the page of a batch in a real browser, under axe: `make pages-check`.

Light, dark and in print, at the width of a desk and of a phone; nothing may be wider than the
window (paper is wider than a phone).  Needs Chromium and npm.  Pictures go to build/pages/.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
import tempfile
from pathlib import Path

from .chromium import Tab, assert_accessible, tabs

PICTURES = Path("build/pages")
WIDTHS_PX = {"desk": 1280, "phone": 400}
LOOKS = {"light": ("screen", "light"), "dark": ("screen", "dark"), "print": ("print", "light")}
"""Medium and preferred scheme of colours."""


def _run(*words: str) -> None:
    command = [sys.executable, "-m", "tui", *words]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, (words, done.stderr)


def _write(folder: Path) -> list[Path]:
    """Write the pages of two sessions of one car, which differ in their noise."""
    sessions = []
    for seed in ("1", "2"):
        _run("demo", "--seed", seed, "--out", str(folder / seed))
        sessions.append(str(folder / seed / "session_0001.h5"))
    report, comparison, batch = (folder / f"{name}.html" for name in ("report", "compare", "batch"))
    _run("report", sessions[0], "--out", str(report))
    _run("compare", *sessions, "--page", str(comparison))
    table = ("--out", str(folder / "batch.csv"))
    _run("batch", *sessions, *table, "--page", str(batch))
    return [report, comparison, batch]


async def _check(tab: Tab, page: Path) -> None:
    for place, width in WIDTHS_PX.items():
        await tab.open(page.as_uri(), width, 900)
        while await tab.value("document.readyState") != "complete":
            await asyncio.sleep(0.1)
        for look, (medium, colours) in LOOKS.items():
            scheme = {"name": "prefers-color-scheme", "value": colours}
            await tab.order("Emulation.setEmulatedMedia", media=medium, features=[scheme])
            where = f"{page.stem} {place} {look}"
            beyond = await tab.value("document.documentElement.scrollWidth - innerWidth")
            assert beyond <= 0 or look == "print", f"{where}: {beyond} px wider than the window"
            await assert_accessible(tab, where)
            await tab.picture(PICTURES / f"{page.stem}_{place}_{look}.png")
            sys.stdout.write(f"{where}: nothing serious\n")


NUMBERS = {
    "measured(16682.4, 50.8)": "16,680 ± 100",
    "measured(-0.00412, 0.0158)": "-0.004 ± 0.031",
    "measured(1385.47, 2.77)": "1,385.5 ± 5.4",
    "measured(1234567, 0)": "1,234,600",
    "number(17000)": "17,000",
    "number(1.25)": "1.25",
}
"""What the script of the batch page writes: as `identify.numbers` does."""


async def _check_numbers(tab: Tab, page: Path) -> None:
    await tab.open(page.as_uri(), WIDTHS_PX["desk"], 900)
    while await tab.value("document.readyState") != "complete":
        await asyncio.sleep(0.1)
    for call, text in NUMBERS.items():
        written = await tab.value(call)
        assert written == text, f"{call} is {written}, not {text}"


async def _check_all(pages: list[Path]) -> None:
    async with tabs(1) as (tab,):
        for page in pages:
            await _check(tab, page)
        await _check_numbers(tab, pages[-1])


def main() -> None:
    """Check every page; raise AssertionError where one falls short."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(_check_all(_write(Path(folder))))


if __name__ == "__main__":
    main()
