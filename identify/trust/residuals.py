"""Judges whether the model holds: convergence, chi2 and its place, and whether residuals are white.

The intervals assume white noise.  If the noise is already coloured at rest, they are too narrow; if
it is white at rest and the residuals are not, the model leaves motion unexplained.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

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


def misfit_findings(estimation: Estimation) -> tuple[Finding, ...]:
    """Judge convergence and chi2/n."""
    findings = []
    if not estimation.fit.converged:
        advice = _UNSETTLED[bool(estimation.nonlinear)]
        steps = estimation.fit.iterations
        text = f"the fit did not converge in {counted(steps, 'iteration')}: {advice}"
        # The nonlinear fit ends near its optimum even if it has not converged.
        severity = Severity.WARNING if estimation.nonlinear else Severity.ERROR
        findings.append(Finding("convergence", severity, text))
    if not estimation.holds:
        run, channel, worst = _worst(chi2_by_run(estimation))
        refused = not estimation.chi2_per_n <= max(CHI2_LIMIT, estimation.chi2_limit)
        text = (
            f"{_MODEL[bool(estimation.nonlinear)]} does not explain the decays: chi2/n = "
            f"{estimation.chi2_per_n:.3f} (limit {estimation.chi2_limit:.3f}, refused above "
            f"{CHI2_LIMIT}), worst {channel} in {run} with {worst:.2f}: "
            f"{_INTERVALS[bool(estimation.nonlinear and not refused)]}"
        )
        findings.append(Finding("chi2", Severity.ERROR if refused else Severity.WARNING, text))
    if not estimation.rest:
        text = "no quiet stretch before the bumps: the noise is taken from the residuals"
        findings.append(Finding("noise", Severity.NOTE, text))
    coarse = coarse_steps(estimation.records) if estimation.rest else {}
    if coarse:
        units = {c.name: c.unit for group in estimation.box.groups for c in group.channels}
        which = listed(f"{name} ({step:.2g} {units[name]})" for name, step in coarse.items())
        text = (
            f"coarse sensors, whose steps hide the noise at rest: {which}; their noise is taken as "
            "step/sqrt(12): a smaller range of the sensor narrows the intervals"
        )
        findings.append(Finding("coarse_sensors", Severity.NOTE, text))
    return (*findings, *_late_start(estimation))


def _late_start(estimation: Estimation) -> tuple[Finding, ...]:
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
        return (Finding("late_start", Severity.WARNING, text),)
    if estimation.later_s and not late:
        text = (
            f"the decays were found to start {estimation.later_s * 1e3:.0f} ms into the records: "
            "begin a record at rest before the bump"
        )
        return (Finding("late_start", Severity.NOTE, text),)
    return ()


def _worst(by_run: Mapping[str, Mapping[str, float]]) -> tuple[str, str, float]:
    rows = [(run, name, chi2) for run, row in by_run.items() for name, chi2 in row.items()]
    return max(rows, key=lambda row: row[2])


@dataclass(slots=True)
class _Pairs:
    """Running sums over pairs of successive samples of one channel, those one period apart.

    `fitted` is the number of values that the fit has removed from the samples, `levels` the largest
    number of different values in one stretch, counted up to `_FEWEST_LEVELS`.
    """

    products: float = 0.0
    squares: float = 0.0
    n: int = 0
    fitted: float = 0.0
    levels: int = 0

    def add(self, even: NDArray[np.bool_], values: NDArray[np.float64], fitted: float) -> None:
        if not len(even):
            return
        left, right = values[:-1][even], values[1:][even]
        self.products += float(left @ right)
        self.squares += float(left @ left + right @ right) / 2.0
        self.n += int(even.sum())
        self.fitted += fitted
        if self.levels < _FEWEST_LEVELS:
            self.levels = max(self.levels, len(set(values.tolist())))

    @property
    def correlation(self) -> float:
        # The fitted part is smooth, so its correlation of almost 1 is missing in the residuals.
        r = self.products / self.squares + self.fitted / self.n
        return min(max(r, -0.99), 0.99)

    def usable(self, noise: float) -> bool:
        """Return True if there are samples enough, and noise to be judged."""
        loud = self.squares > _SILENT * noise**2 * self.n
        return self.n >= _FEWEST and loud and self.levels >= _FEWEST_LEVELS

    def z(self, other: float, n_other: float) -> float:
        """Return the excess of the correlation over another one, in standard deviations."""
        spread = (1.0 - other**2) * (1.0 / self.n + 1.0 / n_other)
        return float((self.correlation - other) / np.sqrt(spread))


def _even_pairs(time_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which pairs of successive samples are one period apart."""
    interval = np.diff(time_s)
    if not len(interval):
        return np.zeros(0, dtype=bool)
    period = np.median(interval)
    return np.asarray(np.abs(interval - period) < 0.5 * period)


def whiteness_findings(estimation: Estimation) -> tuple[Finding, ...]:
    """Compare the lag-1 autocorrelation of the residuals with that of the channel at rest.

    All runs are pooled; a gap in the sampling makes no pair.
    """
    rest = _at_rest(estimation)
    windows = (
        (f"the first {EARLY_S:g} s of the decays", _left(estimation, EARLY_S)),
        ("the decays", _left(estimation, np.inf)),
    )
    return (*_coloured(rest), *_unexplained(windows, rest))


def _coloured(rest: dict[str, _Pairs]) -> Iterator[Finding]:
    worst: list[tuple[float, str, float, float]] = []
    for name, pairs in rest.items():
        z = pairs.z(0.0, np.inf)
        if z > Z_LIMIT:
            r = pairs.correlation
            worst.append((float(np.sqrt((1.0 + r) / (1.0 - r))), name, r, z))
    if not worst:
        return
    worst.sort(reverse=True)
    factor, name, r, z = worst[0]
    yield Finding(
        "coloured_noise",
        Severity.WARNING if factor > NARROW_LIMIT else Severity.NOTE,
        f"the noise at rest is not white, worst {name} with a correlation of {r:.2f} from sample "
        f"to sample (z {z:.0f}, limit {Z_LIMIT}): {listed(n for _, n, _, _ in worst)}; intervals "
        f"that rest on it are too narrow by up to {factor:.2f} (limit {NARROW_LIMIT}): look for "
        "hum or a running engine, and state the sensor's low-pass if it has one",
    )


def _unexplained(
    windows: Sequence[tuple[str, dict[str, _Pairs]]], rest: dict[str, _Pairs]
) -> Iterator[Finding]:
    worst: dict[str, tuple[float, float, str]] = {}
    for where, left in windows:
        for name, pairs in left.items():
            known = rest.get(name)
            r_rest, n_rest = (known.correlation, known.n) if known else (0.0, np.inf)
            z = pairs.z(r_rest, n_rest)
            if z > max(Z_LIMIT, worst.get(name, (0.0,))[0]):
                worst[name] = (z, pairs.correlation, where)
    if not worst:
        return
    names = sorted(worst, key=lambda name: -worst[name][0])
    z, r, where = worst[names[0]]
    if names[0] in rest:
        compared = f"but {rest[names[0]].correlation:.2f} at rest"
        meaning = "the model leaves motion unexplained"
    else:
        compared = "and there is no rest to compare with"
        meaning = "the model leaves motion unexplained, or the noise is coloured"
    yield Finding(
        "whiteness",
        Severity.WARNING,
        f"the residuals are not white, worst {names[0]} in {where} with a correlation of {r:.2f} "
        f"from sample to sample {compared} (z {z:.1f}, limit {Z_LIMIT}): {listed(names)}; "
        f"{meaning}, so errors may exceed the intervals: check delay, low-pass, gain and place of "
        "these sensors, friction and dampers",
    )


def _left(estimation: Estimation, end_s: float) -> dict[str, _Pairs]:
    """Return the residuals of each channel up to a time since the decay's start, pooled."""
    pooled: defaultdict[str, _Pairs] = defaultdict(_Pairs)
    for decay, left in zip(estimation.decays, estimation.residuals, strict=True):
        for recording in decay.recordings:
            keep = recording.time_s < end_s
            even = _even_pairs(recording.time_s[keep])
            for name in (channel.name for channel in recording.group.channels):
                values = left.values[name]
                share = float(keep.mean()) if len(keep) else 0.0
                fitted = (len(values) - left.freedom[name]) * share
                pooled[name].add(even, values[keep], fitted)
    return _usable(pooled, estimation)


def _at_rest(estimation: Estimation) -> dict[str, _Pairs]:
    pooled: defaultdict[str, _Pairs] = defaultdict(_Pairs)
    for record in estimation.records:
        onset = onset_s(record)
        if onset is None:
            continue
        for recording in record.recordings:
            quiet = recording.time_s < onset - _MARGIN_S
            values = recording.values[quiet]
            if len(values) < 3:
                continue
            values, even = values - values.mean(axis=0), _even_pairs(recording.time_s[quiet])
            for channel, column in zip(recording.group.channels, values.T, strict=True):
                pooled[channel.name].add(even, column, 1.0)
    return _usable(pooled, estimation)


def _usable(pooled: dict[str, _Pairs], estimation: Estimation) -> dict[str, _Pairs]:
    noise = estimation.noise
    return {name: pairs for name, pairs in pooled.items() if pairs.usable(noise[name])}
