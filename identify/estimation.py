"""From records to the optimum: noise levels, start values, and the start of each free decay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .decay import FreeDecay, Record
from .greybox import GreyBox
from .likelihood import Fit, Residuals, fit, misfit, residuals
from .window import decay_start_s, difference_noise, onset_s, quiet_noise

CHI2_FITS = 1.3  # below this, chi2/n says that the model fits
_SEARCH_RATE_HZ = 250.0  # enough to find the basin of the optimum
_FLOOR = 1e-6  # of a channel's rms: the noise of noise-free data
_LATER_S = (0.02, 0.05)
"""Tried when the model does not fit from the stated end of the bump on.  No later: what is wrong
with the wheels' motion dies within 0.2 s, and a start after that would hide it."""
_LATER_UNSTATED_S = (0.1, 0.2, 0.4)
"""Tried where no bump is stated and a record may begin within it."""
_SCAN_STEP_S = 0.005

_MID_SIZE_CAR = np.array(
    [1500, 2500, 500, 40, 40, 20e3, 20e3, 200e3, 200e3, 1500, 1500, 1.3, 1.4, 0.75, 0.75]
)
_INERTIAS = slice(0, 5)
_FORCES = slice(5, 11)


def generic_vehicles() -> tuple[NDArray[np.float64], ...]:
    """Return the vehicles, each (15,), from which a search may start: a car, and kin of it.

    The kin are lighter, heavier, stiffer and more strongly damped; together they lie within a
    factor of two or three of anything on four wheels that is bumped by hand.
    """
    vehicles = []
    for mass, force in ((1.0, 1.0), (2.0, 2.0), (0.5, 0.5), (1.0, 2.0), (2.0, 1.0), (4.0, 4.0)):
        vehicle = _MID_SIZE_CAR.copy()
        vehicle[_INERTIAS] *= mass
        vehicle[_FORCES] *= force
        vehicles.append(vehicle)
    return tuple(vehicles)


@dataclass(frozen=True, slots=True)
class Estimation:
    """A fit with everything it rests on.

    Parameters
    ----------
    fit : Fit
        The optimum.
    decays : tuple of FreeDecay
        The windows used.
    sigma : mapping of channel name to float
        Noise level of each channel, SI.
    sigma_from_rest : bool
        Whether the noise was measured at rest; else it is the rough part of the residuals.
    residuals : tuple of Residuals
        One for each decay.
    chi2_per_n : float
        Mean square residual in units of sigma, by degrees of freedom: 1 if the model holds.
    later_s : float
        How much later than expected the decays were first fitted with success, s.
    """

    fit: Fit
    decays: tuple[FreeDecay, ...]
    sigma: dict[str, float]
    sigma_from_rest: bool
    residuals: tuple[Residuals, ...]
    chi2_per_n: float
    later_s: float = 0.0


def estimate(
    box: GreyBox, records: Sequence[Record], starts: Sequence[NDArray[np.float64]]
) -> Estimation:
    """Find the most likely parameters of all records.

    The decays start where the stated bump ends; if the model does not fit from there on, a later
    start is tried.  Where no bump is stated, the misfit tells how far back the decay reaches.

    Parameters
    ----------
    box : GreyBox
        Structure of the problem.
    records : sequence of Record
        All runs.
    starts : sequence of (15,) float64
        Parameters to begin from, the most trusted first.
    """
    first = np.array([decay_start_s(record) for record in records])
    rest = quiet_noise(records)
    best = _from(box, records, rest, first, starts)
    stated = all(np.isfinite(record.bump_s) for record in records)
    # Where rest was seen and no bump is stated, the first guess is late enough for any bump.
    movable = np.array([stated or onset_s(record) is None for record in records])
    for later in _LATER_S if stated else _LATER_UNSTATED_S:
        if best.chi2_per_n <= CHI2_FITS or not movable.any():
            break
        trial = _from(box, records, rest, first + later * movable, (_theta(box, best), starts[0]))
        if trial.chi2_per_n <= CHI2_FITS:
            best = replace(trial, later_s=later)
    if best.chi2_per_n <= CHI2_FITS and not stated:
        best = replace(_reach_back(box, records, rest, best), later_s=best.later_s)
    return best


def _theta(box: GreyBox, estimation: Estimation) -> NDArray[np.float64]:
    return box.theta(estimation.fit.eta.astype(complex)).real


def _from(
    box: GreyBox,
    records: Sequence[Record],
    rest: dict[str, float],
    start_s: NDArray[np.float64],
    starts: Sequence[NDArray[np.float64]],
) -> Estimation:
    """Fit the decays that begin at the given times, (n_records,); `rest` is the noise at rest."""
    decays = tuple(r.decay(float(s)) for r, s in zip(records, start_s, strict=True))
    sigma = _floored(rest or _rough_noise(decays), decays)
    search = tuple(decay.thinned(_SEARCH_RATE_HZ) for decay in decays)
    n = sum(decay.n_values for decay in search)
    coarse: Fit | None = None
    for theta in starts:
        trial = fit(box, search, sigma, box.unknowns(theta), tolerance=1e-3)
        if coarse is None or trial.cost < coarse.cost:
            coarse = trial
        if coarse.cost < CHI2_FITS * n:
            break
    assert coarse is not None  # there is always a generic vehicle to start from
    fine = fit(box, decays, sigma, coarse.eta)
    left = residuals(box, decays, sigma, fine.eta)
    if not rest:
        for _ in range(2):  # the noise and the fit settle together
            sigma = _floored(_residual_noise(left), decays)
            fine = fit(box, decays, sigma, fine.eta)
            left = residuals(box, decays, sigma, fine.eta)
    return Estimation(fine, decays, sigma, bool(rest), left, _chi2_per_n(box, left, sigma))


def _chi2_per_n(box: GreyBox, left: Sequence[Residuals], sigma: dict[str, float]) -> float:
    squares = sum(
        float(values @ values) / sigma[name] ** 2
        for decay in left
        for name, values in decay.values.items()
    )
    freedom = sum(sum(decay.freedom.values()) for decay in left) - len(box.parameters)
    return squares / freedom if freedom > 0 else float("inf")


def _rough_noise(decays: Sequence[FreeDecay]) -> dict[str, float]:
    """Return an upper bound of the noise from the samples themselves."""
    worst: dict[str, float] = {}
    for decay in decays:
        for recording in decay.recordings:
            noise = difference_noise(recording.values)
            for channel, level in zip(recording.clock.channels, noise.tolist(), strict=True):
                worst[channel.name] = max(worst.get(channel.name, 0.0), level)
    return worst


def _residual_noise(left: Sequence[Residuals]) -> dict[str, float]:
    names = {name for decay in left for name in decay.values}
    return {
        name: float(
            np.sqrt(
                np.mean([difference_noise(d.values[name]) ** 2 for d in left if name in d.values])
            )
        )
        for name in names
    }


def _floored(sigma: dict[str, float], decays: Sequence[FreeDecay]) -> dict[str, float]:
    """Keep noise levels above what rounding makes of noise-free data."""
    power: dict[str, list[float]] = {}
    for decay in decays:
        for recording in decay.recordings:
            for channel, column in zip(recording.clock.channels, recording.values.T, strict=True):
                power.setdefault(channel.name, []).append(float(np.mean(column**2)))
    floor = {name: _FLOOR * float(np.sqrt(np.mean(p))) for name, p in power.items()}
    return {name: max(level, floor[name], 1e-300) for name, level in sigma.items()}


def _reach_back(
    box: GreyBox, records: Sequence[Record], rest: dict[str, float], late: Estimation
) -> Estimation:
    """Move the start of each decay as far back as the fitted model explains the samples."""
    starts = []
    for record, decay in zip(records, late.decays, strict=True):
        start = decay.start_s
        if not np.isfinite(record.bump_s):
            onset = onset_s(record)
            start = _earliest(box, record, late, start, record.start_s if onset is None else onset)
        starts.append(start)
    return _from(box, records, rest, np.array(starts), (_theta(box, late),))


def _earliest(
    box: GreyBox, record: Record, late: Estimation, start_s: float, lower_s: float
) -> float:
    """Return the earliest start after `lower_s` from which the samples are free decay, s."""
    here = record.decay(start_s)
    system = box.system(late.fit.eta, record.mass_state)
    cost, n = misfit(box, here, late.sigma, late.fit.eta, system), here.n_values
    earliest = start_s
    for candidate in np.arange(start_s - _SCAN_STEP_S, lower_s, -_SCAN_STEP_S):
        longer = record.decay(float(candidate))
        longer_cost = misfit(box, longer, late.sigma, late.fit.eta, system)
        added = longer.n_values - n
        if longer_cost - cost > added + 4 * np.sqrt(2 * added):
            # The step before may hold the last of the bump below the noise.
            return min(earliest + _SCAN_STEP_S, start_s)
        earliest, cost, n = float(candidate), longer_cost, longer.n_values
    return earliest
