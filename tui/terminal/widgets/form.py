"""Forms: fields with limits and reasons, and the lines to type them into.

Values are the text that a person typed.  Checking never changes them, and every error names the
field, the limit and the reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.events import Paste
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Input, Static


class Line(Input):
    """An input without control characters: pasted ones would act on the terminal."""

    def validate_value(self, value: str) -> str:
        """Keep only printable characters."""
        return "".join(c for c in value if c.isprintable())


Values = Mapping[str, str]
YES, NO = "yes", "no"


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a form."""

    name: str
    """Key of the value."""
    label: str
    """Label on the screen."""
    unit: str = ""
    """Unit of a number; empty for text."""
    low: float = -math.inf
    high: float = math.inf
    """Limits of a number; `high` is included, and `low` too unless `above_low`."""
    reason: str = ""
    """Reason of the limits."""
    help: str = ""
    """Help text on what to enter."""
    needed: bool = False
    """True if the field must not stay empty."""
    choices: tuple[str, ...] = ()
    """The values to choose from; empty for free text."""
    whole: bool = False
    """True for a whole number."""
    most: int = 60
    """Largest number of characters of a text."""
    above_low: bool = False
    """True if a number must be above `low`; False if it may equal it."""

    @property
    def is_number(self) -> bool:
        """True if the value is a number."""
        return bool(self.unit)

    @property
    def limit(self) -> str:
        """The limits in words."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if not self.is_number:
            return f"{'1' if self.needed else '0'} to {self.most} characters"
        kind = "a whole number " if self.whole else ""
        low = f"above {self.low:g}, up" if self.above_low else f"{self.low:g}"
        return f"{kind}{low} to {self.high:g} {self.unit}".strip()

    @property
    def advice(self) -> str:
        """Help on the entry, its limits, and the keys that change a choice."""
        keys = "; left and right change it" if self.choices else ""
        return f"{self.help} ({self.limit}{keys})"


@dataclass(frozen=True, slots=True)
class FieldError:
    """An error in a field: its name and label, the limit, and the reason."""

    field: str
    label: str
    limit: str
    reason: str

    def __str__(self) -> str:
        """Return the error as one line."""
        return f"{self.label}: {self.reason} (limit: {self.limit})"


def check_fields(fields: Sequence[Field], values: Values) -> tuple[FieldError, ...]:
    """Check each field by itself."""
    return tuple(e for field in fields if (e := _checked(field, values.get(field.name, ""))))


def _checked(field: Field, typed: str) -> FieldError | None:
    def wrong(reason: str) -> FieldError:
        return FieldError(field.name, field.label, field.limit, reason)

    text = typed.strip()
    if not text:
        return wrong("is empty, and is needed") if field.needed else None
    if field.choices:
        return None if text in field.choices else wrong(f"{text!r} is not on the list")
    if not field.is_number:
        if len(text) > field.most:
            return wrong(f"has {len(text)} characters")
        return None if text.isprintable() else wrong("has characters that cannot be printed")
    value = number(text)
    if value is None:
        return wrong(f"{text!r} is not a number")
    if field.whole and value != round(value):
        return wrong(f"{text} is not a whole number")
    if field.above_low and value == field.low:
        return wrong(f"{text} {field.unit} is not above {field.low:g}")
    if not field.low <= value <= field.high:
        side = "below" if value < field.low else "above"
        return wrong(f"{text} {field.unit} is {side} the limit: {field.reason}")
    return None


def number(text: str) -> float | None:
    """Return the typed number, with decimal point or comma; None if it is not a number."""
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in text else None


def stated(typed: str) -> float:
    """Return the number in a field that has been checked."""
    value = number(typed)
    assert value is not None  # check_fields guarantees it
    return value


class TextField(Line):
    """A field that is typed into."""

    def __init__(self, field: Field, width: int) -> None:
        super().__init__(compact=True, max_length=max(field.most, 60))
        self.field = field
        self.styles.width = width

    class Row(Message):
        """Texts with tabs between them were pasted: one for each field, starting with this one."""

        def __init__(self, widget: TextField, texts: Sequence[str]) -> None:
            self.widget, self.texts = widget, tuple(texts)
            super().__init__()

    def on_paste(self, event: Paste) -> None:
        """Pass on texts with tabs between them; insert a text without tabs as in any line."""
        texts = event.text.splitlines()[0].split("\t") if event.text.strip() else [""]
        if len(texts) > 1:
            event.stop()
            event.prevent_default()
            self.post_message(self.Row(self, texts))


class ChoiceField(Static, can_focus=True):
    """A field with one of a few words: left and right choose a word; SPACE does not change it."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("right", "turn(1)", "Change", show=False),
        Binding("left", "turn(-1)", "Change", show=False),
        Binding("enter", "submit", "Next field", show=False),
    ]

    class Changed(Message):
        """Another word was chosen."""

    class Submitted(Message):
        """Enter was pressed."""

        def __init__(self, widget: ChoiceField) -> None:
            self.widget = widget
            super().__init__()

    def __init__(self, field: Field) -> None:
        super().__init__(markup=False)
        self.field = field
        self._value = ""
        self.styles.width = max(map(len, field.choices))

    @property
    def value(self) -> str:
        """The word."""
        return self._value

    @value.setter
    def value(self, value: str) -> None:
        self._value = value
        self.update(value)

    def action_turn(self, by: int) -> None:
        """Choose the next word, or the previous one."""
        words = self.field.choices
        now = words.index(self._value) if self._value in words else -1
        self.value = words[(now + by) % len(words)]
        self.post_message(self.Changed())

    def action_submit(self) -> None:
        """Go on to the next field."""
        self.post_message(self.Submitted(self))


FieldWidget = TextField | ChoiceField


class Label(Static):
    """Text between two fields: the end of the first, the label of the second.

    It is one widget instead of three, because a form of thirty fields must appear at once.
    """

    def __init__(self, before: str, words: str, bracket: str = "") -> None:
        self._before, self._words, self._bad, self._bracket = before, words, False, bracket
        super().__init__(self._text())

    def mark(self, bad: bool) -> None:
        """Show whether the field after it is wrong: by a mark, and in colour."""
        if bad != self._bad:
            self._bad = bad
            self.update(self._text())

    def _text(self) -> Content:
        if not self._words:
            return Content(self._before)
        style = "bold $error" if self._bad else ""
        mark = "!" if self._bad else " "
        return Content.assemble(self._before, (f"{mark}{self._words[1:]}{self._bracket}", style))


class Form(VerticalScroll, can_focus=False):
    """Fields in rows; typed text stays, valid or not.

    `rows`: fields of each row.  `label_width`: cells of the first label of a row.
    """

    DEFAULT_CSS = """
    Form { height: 1fr; }
    Form Horizontal { height: 1; }
    Form Label { width: auto; height: 1; }
    Form TextField, Form ChoiceField { height: 1; background: $surface; }
    Form TextField:focus, Form ChoiceField:focus { text-style: bold reverse; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("down", "app.focus_next", "Next field", show=False),
        Binding("up", "app.focus_previous", "Field before", show=False),
    ]

    class Changed(Message):
        """Something was typed."""

    class Submitted(Message):
        """Enter was pressed in the last field."""

    def __init__(self, rows: Sequence[Sequence[Field]], label_width: int = 13) -> None:
        super().__init__()
        self._rows, self._label_width = rows, label_width
        self._fields: dict[str, FieldWidget] = {}
        self._labels: dict[str, Label] = {}

    def compose(self) -> ComposeResult:
        """Compose the rows."""
        for row in self._rows:
            yield Horizontal(*self._row(row))

    def _row(self, row: Sequence[Field]) -> Iterable[Widget]:
        before = ""
        for position, field in enumerate(row):
            short = "±" if field.name.endswith(".sigma") else field.label
            words = f" {short}".ljust(self._label_width) if position == 0 else f" {short} "
            opens, closes = "<>" if field.choices else "[]"
            label = Label(before, words, opens)
            widget = ChoiceField(field) if field.choices else TextField(field, _width(field))
            self._labels[field.name], self._fields[field.name] = label, widget
            yield label
            yield widget
            before = f"{closes} {field.unit:<4} "
        yield Label(before.rstrip(" "), "")

    @property
    def values(self) -> dict[str, str]:
        """The texts of the fields, by name."""
        return {name: widget.value for name, widget in self._fields.items()}

    def fill(self, values: Mapping[str, str]) -> None:
        """Set values; fields that are not named stay unchanged."""
        with self.prevent(Input.Changed):
            for name, value in values.items():
                if name in self._fields:
                    self._fields[name].value = value

    def mark(self, errors: Sequence[FieldError]) -> None:
        """Show which fields are wrong: by a mark before the label, and in colour."""
        bad = {error.field for error in errors}
        for name, label in self._labels.items():
            label.mark(name in bad)

    def enter(self, name: str = "") -> None:
        """Put the cursor into a field; into the first one without a name."""
        widget = self._fields.get(name) or next(iter(self._fields.values()))
        widget.focus()

    @property
    def current(self) -> Field | None:
        """The field with the cursor."""
        focused = self.screen.focused
        return focused.field if isinstance(focused, (TextField, ChoiceField)) else None

    def on_input_changed(self, event: Input.Changed) -> None:
        """Post the form's own message."""
        event.stop()
        self.post_message(self.Changed())

    def on_text_field_row(self, event: TextField.Row) -> None:
        """Fill the fields, starting at the cursor; go to the last one that was filled."""
        event.stop()
        widgets = list(self._fields.values())
        for widget, text in zip(widgets[widgets.index(event.widget) :], event.texts, strict=False):
            if not widget.field.choices or text in widget.field.choices:
                widget.value = text
            widget.focus()
        self.post_message(self.Changed())

    def on_choice_field_changed(self, event: ChoiceField.Changed) -> None:
        """Post the form's own message."""
        event.stop()
        self.post_message(self.Changed())

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Go to the next field; after the last one, submit the form."""
        event.stop()
        self._submitted(event.input)

    def on_choice_field_submitted(self, event: ChoiceField.Submitted) -> None:
        """Go to the next field; after the last one, submit the form."""
        event.stop()
        self._submitted(event.widget)

    def _submitted(self, widget: Widget) -> None:
        if widget is list(self._fields.values())[-1]:
            self.post_message(self.Submitted())
        else:
            self.screen.focus_next()


def _width(field: Field) -> int:
    return 9 if field.is_number else min(field.most, 48)
