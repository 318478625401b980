"""The numbers that each figure of the report draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .shapes import Shape

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class IntervalPanel:
    """Relative intervals of the parameters, and the runs and facts that each rests on."""

    names: tuple[str, ...]
    """Parameters."""
    half_percent: Floats
    """Half of each 95 % interval, % of the value, shape (n,)."""
    kinds: tuple[str, ...]
    """Kinds of runs and facts that a parameter may rest on."""
    shares: Floats
    """Share of each kind in a parameter's precision, 0..1, shape (n, n_kinds)."""


@dataclass(frozen=True, slots=True)
class ClosedFormPanel:
    """Closed form compared with likelihood."""

    names: tuple[str, ...]
    """Parameters."""
    half_percent: Floats
    """Half of each 95 % interval, %, shape (n,)."""
    apart_percent: Floats
    """Closed form less likelihood, % of the likelihood's, shape (n,)."""


@dataclass(frozen=True, slots=True)
class Trace:
    """A channel measured and fitted, each thinned so that no spike is lost."""

    channel: str
    unit: str
    """`channel`, `unit`: name of the channel, and unit of its values."""
    measured: Floats
    fitted: Floats
    residual: Floats
    """Time within the run, s, over the value in `unit`, shape (2, n); the residual in units of the
    noise."""


@dataclass(frozen=True, slots=True)
class DecayPanel:
    """One run: measured against fitted."""

    traces: tuple[Trace, ...]
    """Channels shown."""
    onset_s: float
    start_s: float
    end_s: float
    """`onset_s`, `start_s`, `end_s`: when motion begins (NaN if the record begins in motion), and
    the window that is fitted."""


@dataclass(frozen=True, slots=True)
class OverlayPanel:
    """One channel of one run in several sessions, as measured."""

    channel: str
    unit: str
    """`channel`, `unit`: name of the channel, and unit of its values."""
    labels: tuple[str, ...]
    """Names of the sessions."""
    curves: tuple[Floats, ...]
    """For each, time since the start of its decay, s, over the value in `unit`, shape (2, n)."""


@dataclass(frozen=True, slots=True)
class StabilisationPanel:
    """Poles over the rank of the State Variable Method, of one mass state."""

    frequency_hz: Floats
    rank: Floats
    """`frequency_hz`, `rank`: of each pole, shape (n,)."""
    stable: NDArray[np.bool_]
    """True if the pole recurs, shape (n,)."""
    modes_hz: Floats
    """Modes of the identified vehicle, shape (m,)."""


@dataclass(frozen=True, slots=True)
class CorrelationPanel:
    """Correlation of the parameters' errors, (n, n)."""

    names: tuple[str, ...]
    matrix: Floats


@dataclass(frozen=True, slots=True)
class SnrPanel:
    """Energy of each mode over the noise in each run."""

    runs: tuple[str, ...]
    modes: tuple[str, ...]
    """`runs`, `modes`: rows and columns."""
    decibel: Floats
    """NaN where there is no such mode, shape (n_runs, n_modes)."""
    limit_db: float
    """Least sum over all runs of a mass state, dB."""


@dataclass(frozen=True, slots=True)
class PredictionPanel:
    """chi2/n of each run, fitted with all and predicted from the others."""

    runs: tuple[str, ...]
    """Labels."""
    fitted: Floats
    predicted: Floats
    limit: Floats
    """`fitted`, `predicted`, `limit`: NaN where the others do not determine it, shape (n,)."""


@dataclass(frozen=True, slots=True)
class DifferencePanel:
    """Differences between two sessions."""

    names: tuple[str, ...]
    """Quantities."""
    percent: Floats
    half_percent: Floats
    """`percent`, `half_percent`: difference and half of its 95 % interval, % of the first session's
    value, shape (n,)."""
    significant: NDArray[np.bool_]
    """True if the difference is significant among all, shape (n,)."""


@dataclass(frozen=True, slots=True)
class TrendPanel:
    """A quantity over the sessions."""

    values: Floats
    half: Floats
    """Value and half of its 95 % interval in each session, shape (n,)."""
    slope: float
    """Slope of the weighted line per session."""
    unit: str
    """Unit of the values."""


@dataclass(frozen=True, slots=True)
class ShapePanel:
    """Mode shapes, at rest and at their largest."""

    shapes: tuple[Shape, ...]


@dataclass(frozen=True, slots=True)
class AxleCurve:
    """Damper force of one axle over speed, with the 95 % band."""

    axle: str
    speed_m_s: Floats
    """Speed, compression positive, m/s, shape (n,)."""
    force_n: Floats
    """Force of the damper alone, N, shape (n,)."""
    low_n: Floats
    """Lower end of the 95 % band, shape (n,)."""
    high_n: Floats
    """Upper end of the 95 % band, shape (n,)."""
    total_n: Floats
    """Force of damper and friction together, N, shape (n,)."""


@dataclass(frozen=True, slots=True)
class DamperPanel:
    """Damper curves of both axles."""

    axles: tuple[AxleCurve, ...]


Panel = (
    DamperPanel
    | IntervalPanel
    | ClosedFormPanel
    | DecayPanel
    | OverlayPanel
    | StabilisationPanel
    | CorrelationPanel
    | SnrPanel
    | PredictionPanel
    | ShapePanel
    | DifferencePanel
    | TrendPanel
)
