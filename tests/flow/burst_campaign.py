"""A whole campaign on the real recorder, every form filled by bursts of keys, on a busy machine.

Part of `make bursts`; some two minutes.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import string
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

from daq.vehicle import HubWeight
from tui.terminal.campaign import BenchStep
from tui.terminal.screens.base import BenchScreen
from tui.terminal.screens.masses import MassesScreen
from tui.terminal.screens.vehicle import VEHICLE_FIELDS, VehicleScreen
from tui.terminal.widgets import Confirm

from ..tui.terminal.bursts import MOST_S, burst
from .bench_terminal import SHIPPED_BUMPS, Seat, demo_bench, seat, terminal_on

SPEED = 8.0
KEYS = 500
_NOTE = 55
"""Characters of a note; one is written during each run."""
_FORM = {
    "name": "KA-BB 1552",
    "operator": "J. Tester",
    "total_mass_kg": "1552",
    "total_mass_kg.sigma": "1.5",
    "front_axle_kg": "850",
    "front_axle_kg.sigma": "0.9",
    "rear_axle_kg": "702",
    "rear_axle_kg.sigma": "0.8",
    "wheelbase_m": "2.761",
    "wheelbase_m.sigma": "0.004",
    "front_track_m": "1.482",
    "front_track_m.sigma": "0.005",
    "rear_track_m": "1.479",
    "rear_track_m.sigma": "0.006",
    "repeats": "1",
    "bump_height_mm": "42",
    "accept_after_s": "7",
    "notes": "2.5 bar, half a tank, left rear damper looks wet",
}
_WEIGHT = {"serial": "M-0731", "mass_kg": "4.25", "sigma_kg": "0.02"}


def _spin() -> None:
    while True:
        pass


@contextmanager
def busy_machine() -> Iterator[None]:
    """Keep every processor busy."""
    load = [
        multiprocessing.get_context("spawn").Process(target=_spin, daemon=True)
        for _ in range(multiprocessing.cpu_count())
    ]
    for process in load:
        process.start()
    try:
        yield
    finally:
        for process in load:
            process.kill()


class _Typist:
    """Types into the forms of a campaign, and remembers what."""

    def __init__(self, operator: Seat) -> None:
        self.seat, self.rng = operator, Random(3)
        self.typed = 0
        self.notes: list[str] = []
        self._noted: set[str] = set()

    async def type(self, *keys: str) -> None:
        """Type keys 0 to 20 ms apart."""
        self.typed += len(keys)
        await burst(self.seat.pilot, *keys, most_s=MOST_S, seed=self.rng.randrange(1 << 30))

    async def note(self) -> None:
        """Write a note by one burst, its key included."""
        letters = string.ascii_letters + string.digits + " .,-"
        text = "x" + "".join(self.rng.choice(letters) for _ in range(_NOTE)) + "x"
        self.notes.append(text)
        await self.type("n", *text, "enter")

    async def go_on(self) -> None:
        """Note something on each run, else do what SPACE does."""
        app = self.seat.app
        status = app.status
        label = status.runs[-1].label if status is not None and status.runs else ""
        if isinstance(app.screen, Confirm):
            await self.seat.pilot.press("space")
        elif label and label not in self._noted:
            self._noted.add(label)
            await self.note()
        elif isinstance(app.screen, BenchScreen):
            await self.seat.space_if_offered()


def _as_typed(text: str, found: str) -> str:
    """Return a number as it was typed if it is the same one."""
    try:
        return text if float(found) == float(text) else found
    except ValueError:
        return found


def _wrong(expected: str, found: str) -> int:
    pairs = zip(expected, found.ljust(len(expected)), strict=False)
    return sum(a != b for a, b in pairs) + max(0, len(found) - len(expected))


async def _campaign(operator: Seat) -> tuple[int, int]:
    app, typist = operator.app, _Typist(operator)
    await operator.until(lambda: isinstance(app.screen, VehicleScreen) and app.bench is not None)
    keys = ["tab"]
    for field in VEHICLE_FIELDS:
        keys += [*_FORM.get(field.name, ""), "tab"]
    await typist.type(*keys[:-1], "ctrl+s")
    typist.notes.append(_FORM["notes"])  # a note on the session
    await operator.until(lambda: app.step is BenchStep.CHECK)
    await typist.note()
    await operator.until(lambda: isinstance(app.screen, MassesScreen), typist.go_on)
    lines = [key for text in _WEIGHT.values() for key in (*text, "tab")]
    await typist.type("a", *lines, "enter", "down", "enter", "ctrl+s")
    typist.notes.append(f"weights: 9 {_WEIGHT['serial']}")  # the terminal's own, of the inventory
    await operator.until(lambda: app.step is BenchStep.IDENTIFY, typist.go_on)
    assert app.bench is not None
    assert app.status is not None
    vehicle, procedure = app.bench.vehicle, app.bench.campaign
    facts = {str(f.quantity): f for f in vehicle.facts}
    found = {
        "name": vehicle.name,
        "operator": app.operator,
        "repeats": str(app.bench.campaign.repeats),
        "bump_height_mm": f"{procedure.bump_height_m * 1e3:g}",
        "accept_after_s": f"{procedure.accept_after_s:g}",
    }
    for name in _FORM:
        quantity, _, sigma = name.partition(".")
        if quantity in facts:
            found[name] = str(facts[quantity].sigma if sigma else facts[quantity].value)
    weight = app.bench.mass_states[-1].added.weights[-1]
    assert isinstance(weight, HubWeight)
    found |= {"mass_kg": f"{weight.mass_kg:g}", "sigma_kg": f"{weight.sigma_kg:g}"}
    wanted = {**_FORM, "mass_kg": _WEIGHT["mass_kg"], "sigma_kg": _WEIGHT["sigma_kg"]}
    del wanted["notes"]
    wrong = sum(_wrong(text, _as_typed(text, found[name])) for name, text in wanted.items())
    stored = [note.text for note in app.status.notes if note.by]
    wrong += sum(_wrong(*pair) for pair in zip(typist.notes, stored, strict=False))
    wrong += sum(map(len, typist.notes[len(stored) :]))
    if wrong:
        sys.stderr.write(f"wanted {wanted}, notes {typist.notes}\nfound {found}, notes {stored}\n")
    return typist.typed, wrong


def main() -> None:
    """Print how many keys landed wrong; end with 1 if one did."""

    async def act() -> tuple[int, int]:
        async with seat(terminal_on(bench.folder)) as operator:
            return await _campaign(operator)

    with (
        # A process that builds the session may outlive its recorder for a moment.
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        demo_bench(Path(folder), SPEED, bumps=SHIPPED_BUMPS) as bench,
    ):
        bench.started()
        with busy_machine():
            typed, wrong = asyncio.run(act())
    sys.stdout.write(
        f"{wrong} of {typed} keys wrong in a campaign, 0 to {1e3 * MOST_S:g} ms apart\n"
    )
    assert typed >= KEYS
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
