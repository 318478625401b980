"""One line that is typed into."""

from __future__ import annotations

from textual.widgets import Input


class Line(Input):
    """An input without control characters: pasted ones would act on the terminal."""

    def validate_value(self, value: str) -> str:
        """Keep only printable characters."""
        return "".join(c for c in value if c.isprintable())
