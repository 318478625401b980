"""Forms: fields with limits and reasons, checked while they are typed.

Values are the text that a person typed.  Checking never changes them, and every error names the
field, the limit and the reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.message import Message
from textual.widgets import Checkbox, Input, Label, Select

from .widgets import Line

Values = Mapping[str, str]
YES, NO = "yes", "no"


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a form: the key of its value, its label, and what may be typed."""

    name: str
    label: str
    unit: str = ""
    """Unit of a number; empty for text."""
    low: float = -math.inf
    high: float = math.inf
    """Limits of a number, which it may equal."""
    reason: str = ""
    """Why a number has these limits."""
    help: str = ""
    needed: bool = False
    choices: tuple[str, ...] = ()
    """The values to choose from; empty for free text."""
    whole: bool = False
    max_length: int = 60

    @property
    def limit(self) -> str:
        """The limits in words."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if not self.unit:
            return f"{'1' if self.needed else '0'} to {self.max_length} characters"
        kind = "a whole number " if self.whole else ""
        return f"{kind}{self.low:g} to {self.high:g} {self.unit}"

    @property
    def advice(self) -> str:
        """Help on the entry, and its limits."""
        return f"{self.help} ({self.limit})"

    def error(self, mistake: str, limit: str = "") -> FieldError:
        """Return an error in this field; `limit`: in words, if it is another than the field's."""
        return FieldError(self.name, f"{self.label}: {mistake} (limit: {limit or self.limit})")

    def check(self, typed: str) -> FieldError | None:
        """Return the error in a typed text; None without one."""
        text = typed.strip()
        value = number(text)
        mistake = ""
        if not text:
            mistake = "is empty, and is needed" if self.needed else ""
        elif self.choices:
            mistake = "" if text in self.choices else f"{text!r} is not on the list"
        elif not self.unit:
            mistake = f"has {len(text)} characters" if len(text) > self.max_length else ""
            mistake = mistake if text.isprintable() else "has characters that cannot be printed"
        elif value is None:
            mistake = f"{text!r} is not a number"
        elif self.whole and value != round(value):
            mistake = f"{text} is not a whole number"
        elif not self.low <= value <= self.high:
            side = "below" if value < self.low else "above"
            mistake = f"{text} {self.unit} is {side} the limit: {self.reason}"
        return self.error(mistake) if mistake else None


@dataclass(frozen=True, slots=True)
class FieldError:
    """An error in a field: its name, and label, reason and limit as one line."""

    field: str
    text: str


def check_fields(fields: Iterable[Field], values: Values) -> tuple[FieldError, ...]:
    """Return the error of each field that has one by itself, in the order of the fields."""
    return tuple(e for field in fields if (e := field.check(values.get(field.name, ""))))


def number(text: str) -> float | None:
    """Return the typed number, with decimal point or comma; None if it is not a number."""
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in text else None


def checked_number(typed: str) -> float:
    """Return the number in a field that has been checked."""
    value = number(typed)
    assert value is not None  # check_fields guarantees it
    return value


class Flag(Checkbox):
    """Yes or no, as a word: SPACE changes it."""

    BUTTON_LEFT = BUTTON_INNER = BUTTON_RIGHT = ""

    def watch_value(self) -> None:
        """Show the word."""
        super().watch_value()
        self.label = YES if self.value else NO


class Form(VerticalScroll, can_focus=False):
    """Groups of fields; typed text stays, valid or not.

    `groups`: rows of fields under the heading of each group; without a heading if it is empty.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("down", "app.focus_next", "Next field", show=False),
        Binding("up", "app.focus_previous", "Field before", show=False),
    ]

    class Changed(Message):
        """Something was typed."""

    class Submitted(Message):
        """Enter was pressed in the last field."""

    def __init__(self, groups: Mapping[str, Sequence[Sequence[Field]]]) -> None:
        super().__init__()
        self._groups = groups
        self._fields: dict[str, Field] = {}
        self._inputs: dict[str, Input | Select[str] | Checkbox] = {}
        self._labels: dict[str, Label] = {}
        self._announced: dict[str, str] = {}  # the values as set by the form or announced last

    def compose(self) -> ComposeResult:
        """Compose the groups."""
        for heading, rows in self._groups.items():
            with Vertical(classes="group"):
                if heading:
                    yield Label(heading, classes="heading")
                for row in rows:
                    with Horizontal():
                        for field in row:
                            yield from self._compose_field(field)

    def _compose_field(self, field: Field) -> ComposeResult:
        """Yield the label of a field and the widget for its entry, and keep both by its name."""
        entry: Input | Select[str] | Checkbox
        label = Label(_label_text(field, " "), markup=False)  # the mark of an error is one wide
        if field.choices == (YES, NO):
            entry = Flag(NO, compact=True)
        elif field.choices:
            options = [(choice, choice) for choice in field.choices]
            entry = Select(options, allow_blank=False, compact=True)
        else:
            max_length = max(field.max_length, 60)  # a text over a short limit is an error, not cut
            classes = "number" if field.unit else ""
            entry = Line(compact=True, max_length=max_length, classes=classes)
        self._fields[field.name], self._inputs[field.name] = field, entry
        self._labels[field.name] = label
        yield label
        yield entry

    def on_mount(self) -> None:
        """Take the values that the choices begin with as known."""
        self._announced = self.values

    @property
    def values(self) -> dict[str, str]:
        """The texts of the fields, by name."""
        return {
            name: (YES if entry.value else NO) if isinstance(entry, Checkbox) else str(entry.value)
            for name, entry in self._inputs.items()
        }

    def fill(self, values: Mapping[str, str]) -> None:
        """Set values of fields; unknown names, and what is no choice, change nothing."""
        for name in values.keys() & self._inputs.keys():
            entry, value = self._inputs[name], values[name]
            if isinstance(entry, Checkbox):
                entry.value = value == YES
            elif isinstance(entry, Input) or value in self._fields[name].choices:
                entry.value = value
        self._announced = self.values

    def mark(self, errors: Sequence[FieldError]) -> FieldError | None:
        """Mark the wrong fields, by a sign before the label and in colour.

        Returns the error in the field with the cursor, or else the first; None without errors.
        """
        wrong_fields = {error.field for error in errors}
        for name, label in self._labels.items():
            is_wrong = name in wrong_fields
            if label.has_class("bad") != is_wrong:
                label.set_class(is_wrong, "bad")
                label.update(_label_text(self._fields[name], "!" if is_wrong else " "))
        current_name = self.current.name if self.current is not None else ""
        return next((e for e in errors if e.field == current_name), next(iter(errors), None))

    def enter(self, name: str = "") -> None:
        """Put the cursor into a field; into the first one without a name."""
        (self._inputs.get(name) or next(iter(self._inputs.values()))).focus()

    @property
    def current(self) -> Field | None:
        """The field with the cursor."""
        focused = self.screen.focused  # the entry of the field, or a widget inside of it
        with_ancestors = focused.ancestors_with_self if focused is not None else ()
        names = (name for name, entry in self._inputs.items() if entry in with_ancestors)
        return self._fields.get(next(names, ""))

    @on(Input.Changed)
    @on(Select.Changed)
    @on(Checkbox.Changed)
    def _announce(self, event: Input.Changed | Select.Changed | Checkbox.Changed) -> None:
        """Post the form's own message, but not for a value that a person has not changed."""
        event.stop()
        if self.values != self._announced:
            self._announced = self.values
            self.post_message(self.Changed())

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Go to the next field; after the last one, submit the form."""
        event.stop()
        if event.input is list(self._inputs.values())[-1]:
            self.post_message(self.Submitted())
        else:
            self.screen.focus_next()


def _label_text(field: Field, mark: str) -> str:
    """Return mark, label and unit of a field; of an uncertainty, beside its value, only ±."""
    label = "±" if field.name.endswith(".sigma") else field.label
    return f"{mark}{label}, {field.unit} " if field.unit and label != "±" else f"{mark}{label} "
