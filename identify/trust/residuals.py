"""Judges whether the model holds: convergence, chi2 and its place, and whether residuals are white.

The intervals assume white noise.  If the noise is already coloured at rest, they are too narrow; if
it is white at rest and the residuals are not, the model leaves motion unexplained.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding, Severity
from dbc.words import counted

from ..decays.onset import coarse_steps, onset_s
from ..fit.estimation import Estimation
from .finding import listed

CHI2_LIMIT = 1.5
"""Beyond this a result is refused: every row of the stress list that costs more than a third of a
parameter lies there."""
_MODEL = ("the linear 7-DOF model", "the model with friction, damper curves, stops and mounts")
_UNSETTLED = (
    "check units, signs and positions of the channels",
    "its numbers may be away from the optimum; add runs, or forbid in [vehicle.structure] the "
    "elements that the car does not have",
)
_INTERVALS = ("the intervals do not hold", "the intervals are widened by the unexplained rest")
_LATE_S = 0.015
"""Delay, s, of a decay's start after the stated end of the bump that onset and guard cannot
explain."""
Z_LIMIT = 4.5
"""Normal deviate of a correlation: one false alarm in 20,000 campaigns of seven channels."""
NARROW_LIMIT = 1.3
"""Factor by which intervals may be too narrow: they then cover 87 % instead of 95 %."""
EARLY_S = 0.3
"""Length of the early part, s, which is tested separately: errors of the wheels' motion end within
it."""
_FEWEST = 100  # pairs of samples that give a correlation to 0.1
_FEWEST_LEVELS = 5  # a coarser converter shows its own steps instead of the noise
_SILENT = 0.01  # of the noise's power: rounding of data without noise
_MARGIN_S = 0.005  # the onset of motion is seen a little late


def chi2_by_run(estimation: Estimation) -> dict[str, dict[str, float]]:
    """Return the mean square residual in units of the noise for each run and channel."""
    noise = estimation.noise
    return {
        decay.label: {
            name: float(values @ values) / noise[name] ** 2 / decay.freedom[name]
            for name, values in decay.values.items()
        }
        for decay in estimation.residuals
    }


def misfit_findings(estimation: Estimation) -> Iterator[Finding]:
    """Judge convergence, chi2/n, the noise at rest, and where the decays start."""
    nonlinear = estimation.nonlinear is not None
    if not estimation.fit.converged:
        steps = counted(estimation.fit.iterations, "iteration")
        text = f"the fit did not converge in {steps}: {_UNSETTLED[nonlinear]}"
        # The nonlinear fit ends near its optimum even if it has not converged.
        yield Finding("convergence", Severity.WARNING if nonlinear else Severity.ERROR, text)
    if not estimation.holds:
        rows = chi2_by_run(estimation)
        worst, channel, run = max(
            (v, name, r) for r, row in rows.items() for name, v in row.items()
        )
        refused = not estimation.chi2_per_n <= max(CHI2_LIMIT, estimation.chi2_limit)
        text = (
            f"{_MODEL[nonlinear]} does not explain the decays: chi2/n = "
            f"{estimation.chi2_per_n:.3f} (limit {estimation.chi2_limit:.3f}, refused above "
            f"{CHI2_LIMIT}), worst {channel} in {run} with {worst:.2f}: "
            f"{_INTERVALS[nonlinear and not refused]}"
        )
        yield Finding("chi2", Severity.ERROR if refused else Severity.WARNING, text)
    if not estimation.rest:
        text = "no quiet stretch before the bumps: the noise is taken from the residuals"
        yield Finding("noise", Severity.NOTE, text)
    elif coarse := coarse_steps(estimation.records):
        units = {c.name: c.unit for group in estimation.box.groups for c in group.channels}
        which = listed(f"{name} ({step:.2g} {units[name]})" for name, step in coarse.items())
        text = (
            f"coarse sensors, whose steps hide the noise at rest: {which}; their noise is taken as "
            "step/sqrt(12): a smaller range of the sensor narrows the intervals"
        )
        yield Finding("coarse_sensors", Severity.NOTE, text)
    late = {}
    for record, decay in zip(estimation.records, estimation.decays, strict=True):
        onset = onset_s(record)
        if onset is not None and np.isfinite(record.bump_s):
            late[record.label] = decay.start_s - onset - record.bump_s
    if late and max(late.values()) > _LATE_S:
        run = max(late, key=lambda label: late[label])
        text = (
            f"the model holds only from {late[run] * 1e3:.0f} ms after the stated end of the bump "
            f"({run}): the bump lasts longer than bump_s says, or the first motion of the wheels "
            "does not fit; check bump_s, the hub sensors, and that no wheel lifted"
        )
        yield Finding("late_start", Severity.WARNING, text)
    elif estimation.later_s and not late:
        text = (
            f"the decays were found to start {estimation.later_s * 1e3:.0f} ms into the records: "
            "begin a record at rest before the bump"
        )
        yield Finding("late_start", Severity.NOTE, text)


class _Stretch(NamedTuple):
    """Residuals of one channel in one run, and number of values that the fit has removed."""

    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    fitted: float


class _Correlation(NamedTuple):
    """Correlation of successive residuals, and the number of pairs that it rests on."""

    r: float
    n: float

    def z(self, other: _Correlation) -> float:
        """Return the excess over another correlation in standard deviations."""
        spread = (1.0 - other.r**2) * (1.0 / self.n + 1.0 / other.n)
        return float((self.r - other.r) / np.sqrt(spread))


def whiteness_findings(estimation: Estimation) -> Iterator[Finding]:
    """Compare the lag-1 autocorrelation of the residuals with that of the channel at rest.

    All runs are pooled; a gap in the sampling makes no pair.
    """
    white = _Correlation(0.0, np.inf)
    at_rest = _correlations(_before_motion(estimation), estimation.noise)
    coloured = {name: r for name, r in at_rest.items() if r.z(white) > Z_LIMIT}
    if coloured:
        names = sorted(coloured, key=lambda name: -coloured[name].r)
        worst = coloured[names[0]]
        factor = float(np.sqrt((1.0 + worst.r) / (1.0 - worst.r)))
        yield Finding(
            "coloured_noise",
            Severity.WARNING if factor > NARROW_LIMIT else Severity.NOTE,
            f"the noise at rest is not white, worst {names[0]} with a correlation of {worst.r:.2f} "
            f"from sample to sample (z {worst.z(white):.0f}, limit {Z_LIMIT}): {listed(names)}; "
            f"intervals that rest on it are too narrow by up to {factor:.2f} (limit "
            f"{NARROW_LIMIT}): look for hum or a running engine, and state the sensor's low-pass "
            "if it has one",
        )
    odd: dict[str, tuple[float, float, str]] = {}
    windows = {f"the first {EARLY_S:g} s of the decays": EARLY_S, "the decays": np.inf}
    for where, end_s in windows.items():
        for name, one in _correlations(_in_decays(estimation, end_s), estimation.noise).items():
            z = one.z(at_rest.get(name, white))
            if z > max(Z_LIMIT, odd.get(name, (0.0,))[0]):
                odd[name] = (z, one.r, where)
    if odd:
        names = sorted(odd, key=lambda name: -odd[name][0])
        z, r, where = odd[names[0]]
        if names[0] in at_rest:
            compared = f"but {at_rest[names[0]].r:.2f} at rest"
            meaning = "the model leaves motion unexplained"
        else:
            compared = "and there is no rest to compare with"
            meaning = "the model leaves motion unexplained, or the noise is coloured"
        yield Finding(
            "whiteness",
            Severity.WARNING,
            f"the residuals are not white, worst {names[0]} in {where} with a correlation of "
            f"{r:.2f} from sample to sample {compared} (z {z:.1f}, limit {Z_LIMIT}): "
            f"{listed(names)}; {meaning}, so errors may exceed the intervals: check delay, "
            "low-pass, gain and place of these sensors, friction and dampers",
        )


def _in_decays(estimation: Estimation, end_s: float) -> Iterator[tuple[str, _Stretch]]:
    """Yield the residuals of each channel up to a time since the decay's start."""
    for decay, part in zip(estimation.decays, estimation.residuals, strict=True):
        for recording in decay.recordings:
            keep = recording.time_s < end_s
            for name in (channel.name for channel in recording.group.channels):
                values = part.values[name]
                fitted = (len(values) - part.freedom[name]) * float(np.mean(keep))
                yield name, _Stretch(recording.time_s[keep], values[keep], fitted)


def _before_motion(estimation: Estimation) -> Iterator[tuple[str, _Stretch]]:
    """Yield the samples of each channel before the motion begins, less their mean."""
    for record in estimation.records:
        onset = onset_s(record)
        if onset is None:
            continue
        for recording in record.recordings:
            quiet = recording.time_s < onset - _MARGIN_S
            values = recording.values[quiet]
            if len(values) < 3:
                continue
            columns = (values - values.mean(axis=0)).T
            for channel, column in zip(recording.group.channels, columns, strict=True):
                yield channel.name, _Stretch(recording.time_s[quiet], column, 1.0)


def _correlations(
    stretches: Iterator[tuple[str, _Stretch]], noise: Mapping[str, float]
) -> dict[str, _Correlation]:
    """Return the correlation of the channels that have samples and noise enough to be judged."""
    pooled: dict[str, list[_Stretch]] = {}
    for name, stretch in stretches:
        if len(stretch.time_s) > 1:
            pooled.setdefault(name, []).append(stretch)
    result = {}
    for name, parts in pooled.items():
        products, squares, n = 0.0, 0.0, 0
        for part in parts:
            interval = np.diff(part.time_s)
            period = np.median(interval)
            even = np.abs(interval - period) < 0.5 * period  # pairs that are one period apart
            before, after = part.values[:-1][even], part.values[1:][even]
            products += float(before @ after)
            squares += float(before @ before + after @ after) / 2.0
            n += int(even.sum())
        loud = squares > _SILENT * noise[name] ** 2 * n
        fine = any(len(np.unique(part.values)) >= _FEWEST_LEVELS for part in parts)
        if n >= _FEWEST and loud and fine:
            # The fitted part is smooth, so its correlation of almost 1 is missing in the residuals.
            r = products / squares + sum(part.fitted for part in parts) / n
            result[name] = _Correlation(min(max(r, -0.99), 0.99), n)
    return result
