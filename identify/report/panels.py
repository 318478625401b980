"""What each figure of the report draws: numbers only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .shapes import Shape

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class IntervalPanel:
    """Relative intervals of the parameters, and what each rests on.

    Parameters
    ----------
    names : tuple of str
        Parameters.
    half_percent : (n,) float64
        Half of each 95 % interval, % of the value.
    kinds : tuple of str
        What a parameter may rest on.
    shares : (n, n_kinds) float64
        Shares of one.
    """

    names: tuple[str, ...]
    half_percent: Floats
    kinds: tuple[str, ...]
    shares: Floats


@dataclass(frozen=True, slots=True)
class ClosedFormPanel:
    """Closed form beside likelihood.

    Parameters
    ----------
    names : tuple of str
        Parameters.
    half_percent : (n,) float64
        Half of each 95 % interval, %.
    apart_percent : (n,) float64
        Closed form less likelihood, % of the likelihood's.
    """

    names: tuple[str, ...]
    half_percent: Floats
    apart_percent: Floats


@dataclass(frozen=True, slots=True)
class Trace:
    """A channel measured and fitted, each thinned so that no spike is lost.

    Parameters
    ----------
    channel, unit : str
        What it is.
    measured, fitted, residual : (2, n) float64
        Time within the run, s, over the value in `unit`; the residual in units of the noise.
    """

    channel: str
    unit: str
    measured: Floats
    fitted: Floats
    residual: Floats


@dataclass(frozen=True, slots=True)
class DecayPanel:
    """One run: measured against fitted.

    Parameters
    ----------
    traces : tuple of Trace
        Channels shown.
    onset_s, start_s, end_s : float
        When motion begins (NaN if the record begins in motion), and the window that is fitted.
    """

    traces: tuple[Trace, ...]
    onset_s: float
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class StabilisationPanel:
    """Poles over the rank of the State Variable Method, of one mass state.

    Parameters
    ----------
    frequency_hz, rank : (n,) float64
        Of each pole.
    stable : (n,) bool
        Whether it comes again.
    modes_hz : (m,) float64
        Modes of the identified vehicle.
    """

    frequency_hz: Floats
    rank: Floats
    stable: NDArray[np.bool_]
    modes_hz: Floats


@dataclass(frozen=True, slots=True)
class CorrelationPanel:
    """Correlation of the parameters' errors, (n, n)."""

    names: tuple[str, ...]
    matrix: Floats


@dataclass(frozen=True, slots=True)
class SnrPanel:
    """How far each mode stands out of the noise in each run.

    Parameters
    ----------
    runs, modes : tuple of str
        Rows and columns.
    decibel : (n_runs, n_modes) float64
        NaN where there is no such mode.
    limit_db : float
        What all runs of a mass state together need.
    """

    runs: tuple[str, ...]
    modes: tuple[str, ...]
    decibel: Floats
    limit_db: float


@dataclass(frozen=True, slots=True)
class PredictionPanel:
    """chi2/n of each run, fitted with all and predicted from the others.

    Parameters
    ----------
    runs : tuple of str
        Labels.
    fitted, predicted, limit : (n,) float64
        NaN where the others say nothing.
    """

    runs: tuple[str, ...]
    fitted: Floats
    predicted: Floats
    limit: Floats


@dataclass(frozen=True, slots=True)
class DifferencePanel:
    """Differences between two sessions.

    Parameters
    ----------
    names : tuple of str
        Quantities.
    percent, half_percent : (n,) float64
        Difference and half of its 95 % interval, % of the first session's value.
    significant : (n,) bool
        Whether it stands among all.
    """

    names: tuple[str, ...]
    percent: Floats
    half_percent: Floats
    significant: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class TrendPanel:
    """A quantity over the sessions.

    Parameters
    ----------
    values, half : (n,) float64
        Value and half of its 95 % interval in each session.
    slope : float
        Of the weighted line, a session.
    unit : str
        Of the values.
    """

    values: Floats
    half: Floats
    slope: float
    unit: str


@dataclass(frozen=True, slots=True)
class ShapePanel:
    """Mode shapes, at rest and at their largest."""

    shapes: tuple[Shape, ...]


Panel = (
    IntervalPanel
    | ClosedFormPanel
    | DecayPanel
    | StabilisationPanel
    | CorrelationPanel
    | SnrPanel
    | PredictionPanel
    | ShapePanel
    | DifferencePanel
    | TrendPanel
)
