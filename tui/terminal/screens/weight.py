"""The form of one weight: place, mass and serial number."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.events import DescendantFocus
from textual.screen import ModalScreen
from textual.widgets import Static

from ..forms.fields import FieldError
from ..forms.weight_form import WEIGHT_FIELDS
from ..widgets.form import Form

Values = dict[str, str]


class WeightScreen(ModalScreen[Values | None]):
    """Returns the values of a weight; Esc keeps the text for the next time."""

    DEFAULT_CSS = """
    WeightScreen { align: center middle; }
    WeightScreen Vertical { width: 78; max-width: 100%; height: auto; max-height: 100%;
        background: $background; }
    WeightScreen Form { height: 8; }
    WeightScreen #help { height: auto; min-height: 3; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "dismiss(None)", "Back"),
        Binding("ctrl+s", "apply", "Apply", priority=True),
    ]

    def __init__(
        self,
        title: str,
        values: Mapping[str, str],
        check: Callable[[Mapping[str, str]], tuple[FieldError, ...]],
        keep: Callable[[Values], None],
    ) -> None:
        super().__init__()
        self._title, self._values = title, dict(values)
        self._check, self._keep = check, keep

    def compose(self) -> ComposeResult:
        """Compose the fields."""
        with Vertical(classes="box") as box:
            box.border_title = self._title
            yield Form([(field,) for field in WEIGHT_FIELDS], 11)
            yield Static(id="help")
            yield Static("Enter: next field, last one applies   Ctrl+S applies   Esc back",
                         markup=False)  # fmt: skip

    def on_mount(self) -> None:
        """Fill the fields."""
        form = self.query_one(Form)
        form.fill(self._values)
        form.enter()

    def on_form_changed(self, _: Form.Changed) -> None:
        """Keep the text, valid or not."""
        self._keep(self.query_one(Form).values)
        self._advise()

    def on_descendant_focus(self, _: DescendantFocus) -> None:
        """Show help on the field."""
        self._advise()

    def on_form_submitted(self, _: Form.Submitted) -> None:
        """Apply the form on Enter in the last field."""
        self.action_apply()

    def _advise(self) -> None:
        form = self.query_one(Form)
        errors = self._check(form.values)
        form.mark(errors)
        field = form.current
        if field is None:
            return
        own = [error for error in errors if error.field == field.name] or list(errors[:1])
        lines = [Content(field.advice)]
        if own:
            lines.append(Content.styled(str(own[0]), "bold $error"))
        self.query_one("#help", Static).update(Content("\n").join(lines))

    def action_apply(self) -> None:
        """Return the weight if it has no error."""
        form = self.query_one(Form)
        errors = self._check(form.values)
        if errors:
            form.enter(errors[0].field)
            self._advise()
            return
        self.dismiss(form.values)
