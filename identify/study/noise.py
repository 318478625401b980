"""Monte Carlo of noisy campaigns against the Cramer-Rao bound, without any oracle.

Each campaign is processed like a real one: onset and noise level from the records, start values
from generic vehicles.  The bound is that of a free decay from the very end of the bump with the
noise known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES
from dbc.words import counted

from ..fit.estimation import estimate, generic_vehicles
from ..fit.likelihood import fit
from ..fit.uncertainty import COVERAGE_95, Estimate, estimates
from .campaign import BUMP, Campaign, box_of, noise_levels, records_of, require_noise
from .result import Column, DotPanel, Dots, Study, percent, rows_of

_CHI2_LIMIT = 1.5
_VAGUE_PERCENT = 25.0
_UNDETERMINED_PERCENT = 1e6
"""Bound, %, above which a parameter counts as undetermined: it is infinite except for rounding."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One campaign identified."""

    errors_percent: NDArray[np.float64]
    stds_percent: NDArray[np.float64]
    """`errors_percent`, `stds_percent`: error and stated standard deviation in per cent of the true
    value, shape (15,); both are zero for a length that was given."""
    chi2_per_n: float
    """Goodness of fit; 1 if the model holds."""
    converged: bool
    """True if the fit settled."""

    @property
    def lost(self) -> bool:
        """True if the campaign gave no usable result."""
        return not self.converged or self.misfit or self.vague

    @property
    def misfit(self) -> bool:
        """True if the fit leaves more than noise."""
        return not self.chi2_per_n <= _CHI2_LIMIT

    @property
    def vague(self) -> bool:
        """True if some parameter is not determined."""
        return not bool(np.all(self.stds_percent <= _VAGUE_PERCENT))


def outcome(campaign: Campaign, seed: int) -> Outcome:
    """Identify the campaign that `seed` draws."""
    box = box_of(campaign)
    estimation = estimate(box, records_of(campaign, seed), generic_vehicles())
    found = estimates(box, estimation.fit)
    known = FORD_GRANADA.to_array()
    return Outcome(
        errors_percent=percent([found[name].value for name in PARAMETER_NAMES], known),
        stds_percent=_stds_percent(found),
        chi2_per_n=estimation.chi2_per_n,
        converged=estimation.fit.converged,
    )


def bound_percent(campaign: Campaign) -> NDArray[np.float64]:
    """Return the Cramer-Rao bound, (15,): no unbiased estimate has a smaller standard deviation.

    In per cent; infinite where the campaign does not determine a parameter, zero for a length
    that is given.

    Raises InputError if the campaign has no noise, or noise below rounding.
    """
    require_noise(campaign)
    box = box_of(campaign)
    clean = records_of(replace(campaign, noise_db=inf), 0)
    decays = tuple(record.decay(BUMP.end_s - 1e-9) for record in clean)
    truth = box.unknowns(FORD_GRANADA.to_array())
    bound = _stds_percent(estimates(box, fit(box, decays, noise_levels(campaign), truth)))
    return np.where(bound < _UNDETERMINED_PERCENT, bound, inf)


def _stds_percent(found: dict[str, Estimate]) -> NDArray[np.float64]:
    stds = np.array([found[name].std for name in PARAMETER_NAMES])
    return np.asarray(100.0 * stds / FORD_GRANADA.to_array())


def noise_study(
    campaign: Campaign, bound: NDArray[np.float64], outcomes: Sequence[Outcome]
) -> Study:
    """Return the statistics of many campaigns.

    `bound`, (15,) float64: as `bound_percent` has it.
    """
    from scipy.stats import binom

    names = PARAMETER_NAMES if campaign.geometry is None else PARAMETER_NAMES[:11]
    n = len(names)
    kept = [o for o in outcomes if not o.lost]
    rms, stated, covered = np.full((3, n), np.nan)
    if kept:
        errors = np.array([outcome.errors_percent[:n] for outcome in kept])
        stds = np.array([outcome.stds_percent[:n] for outcome in kept])
        rms, stated = (np.sqrt(np.mean(each**2, axis=0)) for each in (errors, stds))
        covered = 100.0 * np.mean(np.abs(errors) <= COVERAGE_95 * stds, axis=0)
    cells = np.array([rms, stated, bound[:n], rms / bound[:n], covered]).T
    # Range of coverage of 95 % intervals in 99 of 100 studies of as many campaigns.
    interval = binom.interval(0.99, len(kept), 0.95) if kept else (0, 1)
    low, high = (100.0 * float(limit) / max(len(kept), 1) for limit in interval)
    likely = low, high
    return Study(
        title=f"Noise study: {counted(len(outcomes), 'campaign')} at {campaign.noise_db:g} dB,"
        f" {campaign.rate_hz:g} Hz, {', '.join(campaign.cases)}",
        columns=(
            Column("parameter", "parameter"),
            Column("rms_error_percent", "rms error %", ".3f"),
            Column("stated_std_percent", "stated std %", ".3f"),
            Column("bound_percent", "Cramer-Rao %", ".3f"),
            Column("ratio", "error / bound", ".3f"),
            Column("coverage_percent", "coverage %", ".1f"),
        ),
        rows=rows_of(names, cells),
        notes=(
            f"lost: {len(outcomes) - len(kept)} of {len(outcomes)}"
            f" (not converged {sum(not o.converged for o in outcomes)},"
            f" chi2/n above {_CHI2_LIMIT:g} {sum(o.misfit for o in outcomes)},"
            f" a standard deviation above {_VAGUE_PERCENT:g} % {sum(o.vague for o in outcomes)})",
            *_remarks(names, cells, likely),
        ),
        panels=(
            (
                DotPanel(
                    f"Error at {campaign.noise_db:g} dB, {campaign.rate_hz:g} Hz",
                    "relative standard deviation / %",
                    names,
                    (
                        Dots("Cramér-Rao bound", bound[:n], 0),
                        Dots("stated", stated, 3),
                        Dots("rms error", rms, 2),
                    ),
                ),
                DotPanel(
                    "95 % intervals that hold the truth",
                    "share of the campaigns / %",
                    names,
                    (Dots("coverage", covered, 2),),
                    expected=likely,
                ),
            ),
        ),
    )


def _remarks(
    names: Sequence[str], cells: NDArray[np.float64], likely: tuple[float, float]
) -> list[str]:
    """Sum up the table; `cells` has a row for each parameter."""
    rms, _, bound, ratio, covered = cells.T
    remarks = []
    open_ = [name for name, limit in zip(names, bound, strict=True) if limit == inf]
    if open_:
        remarks.append(
            f"these cases do not determine {', '.join(open_)}: take bounce, pitch and roll"
        )
    if not np.isnan(rms).any():
        remarks += [
            f"rms error {rms.max():.3f} % at most; {ratio.min():.3f} .. {ratio.max():.3f} times"
            f" the bound, {sqrt(np.mean(ratio**2)):.3f} in the mean square",
            f"95 % intervals hold the truth in {covered.mean():.1f} % of all cases; for one"
            f" parameter, {likely[0]:.0f} .. {likely[1]:.0f} % may be chance",
        ]
    return remarks
