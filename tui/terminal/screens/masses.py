"""Step 4: the weights on the car and their places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.content import Content

from daq.bench.edit import with_weights
from daq.control.messages import Status
from daq.vehicle import Weight, expected_car

from ..campaign import BenchStep, read_draft
from ..widgets import SPACE_INK, Table, Words
from .base import MARK_KEYS, BenchScreen
from .weights import (
    HEADS,
    NEW_WEIGHT,
    Entry,
    WeightScreen,
    check_inventory,
    entries_of,
    entry_values,
    weight_cells,
    weight_of,
    weight_values,
)

DRAFT = "draft_masses.json"


class MassesScreen(BenchScreen):
    """The weights, each bolted or not; SPACE confirms one after the other."""

    STEP: ClassVar[BenchStep] = BenchStep.MASSES
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("a", "add", "Add", tooltip="Add a weight"),
        Binding("e,enter", "edit", "Edit", key_display="E", tooltip="Edit the marked weight"),
        Binding("delete", "remove", "Remove", key_display="Del", tooltip="Remove the weight"),
        *MARK_KEYS,
    ]

    def __init__(self) -> None:
        super().__init__()
        self._filled = False
        self._entries: tuple[Entry, ...] = ()

    def compose_body(self) -> ComposeResult:
        """Compose the table, and what SPACE does."""
        yield Table("weights")
        yield Words("due", "box", "Next")

    @property
    def next_enabled(self) -> bool:
        """True while SPACE does something: not while an entry is wrong or no recorder answers."""
        return self._filled and not self._error and not self.lost_words

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show only the keys that do something now."""
        if action in ("edit", "remove"):
            return bool(self._entries)
        return super().check_action(action, parameters)

    @property
    def _weights(self) -> tuple[Weight, ...]:
        return tuple(entry.weight for entry in self._entries)

    @property
    def _error(self) -> str:
        """Mistakes in the weights; empty without any."""
        assert self.bench_app.bench is not None  # show_status returns earlier without one
        car = expected_car(self.bench_app.bench.vehicle)
        return check_inventory(self._weights, car.m_s + 2 * (car.m_uf + car.m_ur))

    @property
    def _loose_rows(self) -> list[int]:
        return [i for i, entry in enumerate(self._entries) if not entry.bolted]

    def show_status(self, status: Status) -> None:
        """Fill the table as soon as the bench is known; show it, and the next action."""
        app = self.bench_app
        if app.bench is None:
            return
        if not self._filled:
            self._filled = True
            draft = read_draft(app.folder / DRAFT)
            self._entries = entries_of(app.bench.mass_states[1].added.weights, draft)
        rows = [
            weight_cells(number, entry, app.glyphs.good, app.glyphs.bad)
            for number, entry in enumerate(self._entries, 1)
        ]
        self.query_one(Table).show(HEADS, rows or [["", "no weight: A adds one"]])
        total = Content(f"together {sum(weight.mass_kg for weight in self._weights):.4g} kg")
        self.query_one("#due", Words).say(Content("\n").join([self._next_line(), total]))

    def _next_line(self) -> Content:
        """Return what is wrong with the weights, or what the next key does."""
        if self._error and not self.lost_words:
            return Content.styled(f"{self.bench_app.glyphs.bad} {self._error}", "bold $error")
        words = "SPACE = all are bolted: go on to step 5 Added"
        if self._loose_rows:
            words = f"SPACE = weight {self._loose_rows[0] + 1} is bolted"
        return Content.styled(self.lost_words or words, SPACE_INK)

    def _change(self, row: int, *replacement: Entry) -> None:
        """Replace the entry in a row, add one after the last, or remove it without another."""
        self._entries = (*self._entries[:row], *replacement, *self._entries[row + 1 :])
        self.bench_app.store_form(DRAFT, {"entries": entry_values(self._entries)})
        self._show()

    def action_add(self) -> None:
        """Add a weight."""
        self._edit("Add a weight", NEW_WEIGHT, len(self._entries))

    def action_edit(self) -> None:
        """Edit the marked weight."""
        row = self.query_one(Table).cursor_row
        self._edit(f"Weight {row + 1}", weight_values(self._entries[row].weight), row)

    def _edit(self, title: str, values: Mapping[str, str], row: int) -> None:
        """Let the operator fill the form; put its weight, not bolted yet, into a row."""

        def put(typed: dict[str, str] | None) -> None:
            if typed is not None:
                self._change(row, Entry(weight_of(typed)))
                self.mark_row(row)

        self.app.push_screen(WeightScreen(title, values), put)

    def action_remove(self) -> None:
        """Remove the marked weight."""
        self._change(self.query_one(Table).cursor_row)

    async def action_next(self) -> None:
        """Confirm that the first loose weight is bolted, and mark the next.

        Without a loose one, send the weights to the recorder, and go on to the bumps.
        """
        app = self.bench_app
        if self._error:
            app.warn(self._error)
        elif loose_rows := self._loose_rows:
            self._change(loose_rows[0], replace(self._entries[loose_rows[0]], bolted=True))
            self.mark_row(next(iter(loose_rows[1:]), loose_rows[0]))
        else:
            sent = await app.configure(lambda text: with_weights(text, self._weights))
            if sent and await app.finish(self.STEP):
                (app.folder / DRAFT).unlink(missing_ok=True)
                await app.go_to(BenchStep.ADDED)
