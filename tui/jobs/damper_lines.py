"""Writes damper curves and force elements as lines of text of 78 columns; runs in the worker."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from identify.document import unit_text
from identify.estimate_text import ends_text, value_text
from identify.report import damper_columns, damper_rows, element_answer
from identify.report.words import plain

if TYPE_CHECKING:
    from identify.document import ForcesEntry


def damper_lines(forces: ForcesEntry) -> Iterator[str]:
    """Yield force at speeds, elements, remarks, and which elements were tried."""
    yield "Force of one corner at the wheel, N ± half of the 95 % interval"
    yield "over its speed, compression positive; on the right of each with friction"
    yield f"{'m/s':>6}" + "".join(f"{name:>18}" for name in damper_columns(forces))
    for speed, *texts in damper_rows(forces):
        yield f"{speed:>6}" + "".join(f"{text:>18}" for text in texts)
    yield ""
    yield f"{'element of one corner':<30}{'value':>14} {'':<6}{'95 % interval':>26}"
    for axle, one in forces["axles"].items():
        for name, e in one["elements"].items():
            unit = "" if e["reason"] else unit_text(e["unit"])
            head = f"{axle} {plain(name)}"
            yield f"{head:<30}{value_text(e):>14} {unit:<6}{ends_text(e):>26}"
    for axle, one in forces["axles"].items():
        yield from (f"  {axle} {note}" for note in one["notes"])
    yield ""
    yield "Elements that were tried"
    for tried in forces["elements"]:
        yield f"  {plain(tried['name']):<30}{element_answer(tried)}"
