"""Takes values that no sensor shows out of a session: a wrong byte order or scale, or a defect.

The squares of such values overflow, and one of them outweighs all others in a fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import LARGEST
from daq.runs import Run, SampleGroup
from daq.sessions import Session

_SMALLEST = 1e-100
"""Smallest magnitude that is not taken as zero: the squares of smaller ones vanish."""
_ROUNDING = 1e-12
"""Magnitude, SI, below which a channel shows only a simulation's rounding: it is taken as zero."""


@dataclass(frozen=True, slots=True)
class Absurd:
    """Values of one channel in one run that no sensor shows."""

    channel: str
    run: str
    count: int
    """Number of these values."""
    value: float
    """The first of them."""


def absurd(session: Session) -> Iterator[Absurd]:
    """Yield the channels with values above `LARGEST`, infinite ones too, in each accepted run."""
    used = {c.name for c in session.used_channels}
    for run in session.accepted:
        for name, values in ((n, v) for g in run.groups for n, v in g.values.items() if n in used):
            found = values[_is_absurd(values)]
            if len(found):
                yield Absurd(name, run.label, len(found), float(found[0]))


def readable_session(session: Session) -> Session:
    """Return a session with absurd values of accepted runs missing (NaN), and tiny ones 0."""
    used = {c.name for c in session.used_channels}

    def of_group(group: SampleGroup) -> SampleGroup:
        values = {name: _readable(v) if name in used else v for name, v in group.values.items()}
        same = all(values[name] is v for name, v in group.values.items())
        return group if same else replace(group, values=values)

    def of_run(run: Run) -> Run:
        groups = tuple(map(of_group, run.groups)) if run.is_accepted else run.groups
        same = all(a is b for a, b in zip(groups, run.groups, strict=True))
        return run if same else replace(run, groups=groups)

    return replace(session, runs=tuple(map(of_run, session.runs)))


def _readable(values: NDArray[np.float64]) -> NDArray[np.float64]:
    wrong = _is_absurd(values)
    size = np.abs(values)
    seen = bool(np.fmax.reduce(size, initial=0.0) > _ROUNDING)
    tiny = (size < (_SMALLEST if seen else _ROUNDING)) & (values != 0.0)
    if not (wrong.any() or tiny.any()):
        return values
    return np.where(wrong, np.nan, np.where(tiny, 0.0, values))


def _is_absurd(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(np.abs(values) > LARGEST)  # false for NaN
