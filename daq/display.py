"""What a session looks like in a notebook: HTML in which every foreign text is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .runs import Session

_LEFT = "text-align:left"
_RIGHT = "text-align:right"


def html_table(caption: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as HTML: the first column to the left, the others to the right.

    Parameters
    ----------
    caption : str
        Stands above it.
    columns : sequence of str
        Headings.
    rows : iterable of sequence of str
        Cells, as plain text.
    """
    head = "".join(_cell("th", place, text) for place, text in enumerate(columns))
    body = "".join(
        f"<tr>{''.join(_cell('td', place, text) for place, text in enumerate(row))}</tr>"
        for row in rows
    )
    title = f'<caption style="{_LEFT};font-weight:bold">{escape(caption)}</caption>'
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def html_line(text: str) -> str:
    """Return a paragraph of plain text as HTML."""
    return f"<p>{escape(text)}</p>"


def session_html(session: Session) -> str:
    """Return vehicle, runs and channels of a session as HTML."""
    runs = [
        [
            run.label,
            str(run.status),
            str(max((len(group.time_s) for group in run.groups), default=0)),
            str(run.losses.measured),
            "; ".join(run.reasons),
        ]
        for run in session.runs
    ]
    channels = [
        [c.name, str(c.quantity), c.unit, c.corner.value if c.corner else "body", f"{c.delay_s:g}"]
        for c in session.channels
    ]
    weights = {
        state.name: sum(weight.mass_kg for weight in state.added.weights)
        for state in session.mass_states
    }
    loads = ", ".join(f"{name} (+{kg:g} kg)" if kg else name for name, kg in weights.items())
    return (
        html_line(f"Session of {session.vehicle.name}; mass states: {loads}")
        + html_table("Runs", ["run", "status", "samples", "lost frames", "reasons"], runs)
        + html_table("Channels", ["channel", "quantity", "unit", "place", "delay, s"], channels)
    )


def _cell(tag: str, place: int, text: str) -> str:
    side = _RIGHT if place else _LEFT
    return f'<{tag} style="{side}">{escape(text)}</{tag}>'
