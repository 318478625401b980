"""An identification as the terminal shows it: plain numbers and words, made in the worker.

The worker makes it with `outcome_of`; the terminal only reads it, so that it needs neither SciPy
nor the session itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

Row = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Estimated:
    """A quantity with its 95 % interval."""

    name: str
    """Symbol."""
    words: str
    """The quantity in words."""
    value: str
    """Value in `unit`, with the digits that its interval justifies."""
    interval: str
    """Both ends; empty where the value was given or is not determined."""
    half_percent: float | None
    """Half of the interval as a share of the value, %; None where that has no meaning, NaN where
    the value is not determined."""
    share: str
    """`half_percent` as text with two digits."""
    unit: str
    rests_on: str
    """Runs or facts that most of its precision comes from."""


@dataclass(frozen=True, slots=True)
class ModeRow:
    """One mode: frequency in Hz and damping ratio with half of their 95 % intervals, as text."""

    name: str
    frequency_hz: str
    frequency_half_hz: str
    damping_ratio: str
    damping_ratio_half: str


@dataclass(frozen=True, slots=True)
class StateOutcome:
    """One mass state: modes, and M, C, K in the order of `daq.vehicle.DOF`.

    The matrices are empty where a parameter is not determined.
    """

    name: str
    modes: tuple[ModeRow, ...]
    mass: tuple[Row, ...]
    damping: tuple[Row, ...]
    stiffness: tuple[Row, ...]


@dataclass(frozen=True, slots=True)
class Curve:
    """One channel of a decay: times in s and values in `unit`, measured and fitted."""

    channel: str
    unit: str
    measured_s: Row
    measured: Row
    fitted_s: Row
    fitted: Row


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """One run: its status, and its decay where it was used."""

    label: str
    status: str
    """`accepted`, `rejected`, or `left out`."""
    reasons: tuple[str, ...]
    """Reasons why it was not used."""
    chi2_per_n: float
    """Mean over its channels; NaN where it was not used."""
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class FindingRow:
    """A finding: severity `refused`, `doubtful` or `ok` (a note)."""

    gate: str
    severity: str
    text: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """Everything that the screens show of one identification."""

    session: str
    """The session file."""
    vehicle: str
    """Name of its vehicle."""
    created: str
    """Time of the recording."""
    without: tuple[str, ...]
    """Runs left out for a trial; the file is not changed by that."""
    verdict: str
    """`ok`, `doubtful` or `refused`."""
    headline: str
    """The verdict in one sentence."""
    meaning: str
    """The reason of the verdict, in one or two sentences."""
    chi2_per_n: float
    findings: tuple[FindingRow, ...]
    """The worst first."""
    survival: tuple[str, ...]
    """Lines that say which parameters survive and which are lost; none where the verdict is ok."""
    overrides: tuple[str, ...]
    """Warnings that a person overrode, with reason and name."""
    parameters: tuple[Estimated, ...]
    derived: tuple[Estimated, ...]
    states: tuple[StateOutcome, ...]
    runs: tuple[RunOutcome, ...]
    dampers: tuple[str, ...] = ()
    """Lines on damper curves and force elements; none where the linear model is enough."""

    @property
    def used(self) -> int:
        """Number of runs that the result is based on."""
        return sum(run.status == "accepted" for run in self.runs)


_OUTCOME = TypeAdapter(Outcome)


def parse_outcome(body: dict[str, Any]) -> Outcome:
    """Return the outcome that a worker sent.

    Raises ValueError if it is none.
    """
    return _OUTCOME.validate_python(body)
