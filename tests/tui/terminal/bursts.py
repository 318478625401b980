"""Keys that come faster than an app turns, as from a bar-code scanner or a line that lags.

`make bursts`: 500 keys, 0 to 20 ms apart, into every field of every form; how many are wrong.
"""

from __future__ import annotations

import asyncio
import string
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any

from textual.events import Event, Key
from textual.keys import _character_to_key
from textual.pilot import Pilot
from textual.screen import ModalScreen

from tui.terminal.app import BenchApp
from tui.terminal.device import KeyboardApp
from tui.terminal.form import Field, Form
from tui.terminal.screens.vehicle import VEHICLE_FIELDS
from tui.terminal.screens.weights import WEIGHT_FIELDS, WeightScreen
from tui.terminal.widgets import Line, Question
from tui.terminal.words import choose_glyphs

from .fake_recorder import FakeRecorder

_CHARACTERS = {"space": " ", "tab": "\t", "enter": "\r", "backspace": "\x7f"}


async def burst(pilot: Pilot[None], *keys: str | Event, most_s: float = 0.0, seed: int = 1) -> None:
    """Post keys, or events among them, without a wait, or 0 to `most_s` apart; then wait."""
    gaps = Random(seed)
    for key in keys:
        pilot.app.post_message(_key(key) if isinstance(key, str) else key)
        if most_s:
            await asyncio.sleep(gaps.uniform(0.0, most_s))
    app = pilot.app
    assert isinstance(app, KeyboardApp)
    await asyncio.sleep(0)
    while not app._idle:
        await asyncio.sleep(0.001)
    await pilot.pause()


def _key(name: str) -> Key:
    if len(name) == 1:
        return Key(name if name.isalnum() else _character_to_key(name), name)
    return Key(name, _CHARACTERS.get(name))


KEYS = 500
MOST_S = 0.02
_WIDTH = 6
"""Characters that are typed into each field."""


def _texts(fields: tuple[Field, ...], rng: Random) -> dict[str, str]:
    """Return what to type into each field of text."""
    letters = string.ascii_letters + string.digits + " .-"
    return {
        field.name: "".join(rng.choice(letters) for _ in range(_WIDTH))
        for field in fields
        if not field.choices
    }


async def _filled(
    pilot: Pilot[None], fields: tuple[Field, ...], rng: Random
) -> tuple[int, Mapping[str, str], Mapping[str, str]]:
    """Type into a form whose first field has the cursor; return keys, texts and what is there."""
    texts = _texts(fields, rng)
    keys = []
    for field in fields:
        ends = ("tab",) if field.choices else ("tab", "enter", "down")
        keys += [*texts.get(field.name, ""), rng.choice(ends)]
    await burst(pilot, *keys[:-1], most_s=MOST_S, seed=rng.randrange(1 << 30))
    values = pilot.app.screen.query_one(Form).values
    return len(keys) - 1, texts, {name: values[name] for name in texts}


async def _open(app: BenchApp, screen: ModalScreen[Any]) -> None:
    """Open a dialog, and wait until it has its cursor."""
    await app.push_screen(screen)
    while screen.focused is None:
        await asyncio.sleep(0.001)


async def wrong_keys(seed: int) -> tuple[int, int]:
    """Return how many keys were typed into every form, and how many landed wrong."""
    rng = Random(seed)
    app = BenchApp(FakeRecorder(), Path(tempfile.mkdtemp()), choose_glyphs("braille", {}), "MK")
    typed = wrong = 0

    def count(keys: int, texts: Mapping[str, str], there: Mapping[str, str]) -> None:
        nonlocal typed, wrong
        typed += keys
        for name, text in texts.items():
            found = there[name].ljust(len(text))
            wrong += sum(a != b for a, b in zip(text, found, strict=False))
            wrong += max(0, len(found) - len(text))
            if found != text:
                sys.stderr.write(f"{name}: typed {text!r}, there is {found!r}\n")

    async with app.run_test(size=(140, 40)) as pilot:
        while app.bench is None:
            await asyncio.sleep(0.02)
        await app.open("vehicle")
        await burst(pilot, "tab")
        count(*await _filled(pilot, VEHICLE_FIELDS, rng))
        while typed < KEYS:
            await _open(app, WeightScreen("Weight", {}))
            count(*await _filled(pilot, WEIGHT_FIELDS, rng))
            await burst(pilot, "escape")
            screen = Question(f"Why {typed}", "why")
            await _open(app, screen)
            text = _texts(WEIGHT_FIELDS[:1], rng)["mass_kg"].strip() or "x"
            await burst(pilot, *text, most_s=MOST_S, seed=rng.randrange(1 << 30))
            count(len(text), {"text": text}, {"text": screen.query_one(Line).value})
            await burst(pilot, "escape")
    return typed, wrong


def main() -> None:
    """Print the count; end with 1 if a key is wrong."""
    typed, wrong = asyncio.run(wrong_keys(seed=1))
    sys.stdout.write(f"{wrong} of {typed} keys wrong, 0 to {1e3 * MOST_S:g} ms apart\n")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
