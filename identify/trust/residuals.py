"""Judges whether the model holds: convergence, chi2 and its place, and whether residuals are white.

The intervals assume white noise.  If the noise is already coloured at rest, they are too narrow; if
it is white at rest and the residuals are not, the model leaves motion unexplained.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.words import Finding, Severity, counted

from ..decays.decay import coarse_steps, onset_s
from ..fit.estimation import Estimation, linearised_at
from ..fit.likelihood import covariance_of, fit, normal_blocks
from ..fit.varpro import NormalBlock
from .finding import listed

CHI2_LIMIT = 1.5
"""Beyond this a result is refused: every row of the stress list that costs more than a third of a
parameter lies there."""
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
_FEWEST_AT_REST = 3  # two samples less their mean are always opposite
_LARGEST_R = 0.99  # magnitude at which a correlation is cut: at 1 its deviate has no size
_FEWEST_LEVELS = 5  # a coarser converter shows its own steps instead of the noise
_SILENT = 0.01  # of the noise's power: rounding of data without noise
_MARGIN_S = 0.005  # the onset of motion is seen a little late


def chi2_by_run(estimation: Estimation) -> dict[str, dict[str, float]]:
    """Return chi2 per degree of freedom, by run and channel."""
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
    forbid = "forbid in [vehicle.structure] the elements that the car does not have"
    if estimation.unreached:
        text = (
            f"the search ended for want of time, not finished: {listed(estimation.unreached)}; "
            f"its numbers may be away from the optimum: {forbid}"
        )
        yield Finding("convergence", Severity.WARNING, text)
    elif not estimation.fit.converged:
        advice = "check units, signs and positions of the channels"
        if nonlinear:
            advice = f"its numbers may be away from the optimum; add runs, or {forbid}"
        steps = counted(estimation.fit.iterations, "iteration")
        # The nonlinear fit ends near its optimum even if it has not converged.
        severity = Severity.WARNING if nonlinear else Severity.ERROR
        yield Finding("convergence", severity, f"the fit did not converge in {steps}: {advice}")
    if not estimation.holds:
        worst_chi2, channel, run = max(
            (chi2, name, label)
            for label, row in chi2_by_run(estimation).items()
            for name, chi2 in row.items()
        )
        # A chi2/n of NaN is refused, too.
        refused = not estimation.chi2_per_n <= max(CHI2_LIMIT, estimation.chi2_limit)
        model, intervals = "the linear 7-DOF model", "the intervals do not hold"
        if nonlinear:
            model = "the model with friction, damper curves, stops and mounts"
            if not refused:
                intervals = "the intervals are widened by the unexplained rest"
        text = (
            f"{model} does not explain the decays: chi2/n = {estimation.chi2_per_n:.3f} (limit "
            f"{estimation.chi2_limit:.3f}, refused above {CHI2_LIMIT}), worst {channel} in {run} "
            f"with {worst_chi2:.2f}: {intervals}"
        )
        yield Finding("chi2", Severity.ERROR if refused else Severity.WARNING, text)
    if not estimation.rest:
        text = "no quiet stretch before the bumps: the noise is taken from the residuals"
        yield Finding("noise", Severity.NOTE, text)
    elif coarse := coarse_steps(estimation.records):
        units = {c.name: c.unit for group in estimation.box.groups for c in group.channels}
        steps = listed(f"{name} ({step:.2g} {units[name]})" for name, step in coarse.items())
        text = (
            f"coarse sensors, whose steps hide the noise at rest: {steps}; their noise is taken as "
            "step/sqrt(12): a smaller range of the sensor narrows the intervals"
        )
        yield Finding("coarse_sensors", Severity.NOTE, text)
    since_bump_s = {}  # from the stated end of the bump to the decay's start, by run
    for record, decay in zip(estimation.records, estimation.decays, strict=True):
        onset = onset_s(record)
        if onset is not None and np.isfinite(record.bump_s):
            since_bump_s[record.label] = decay.start_s - onset - record.bump_s
    if since_bump_s and max(since_bump_s.values()) > _LATE_S:
        run = max(since_bump_s, key=lambda label: since_bump_s[label])
        text = (
            f"the model holds only from {since_bump_s[run] * 1e3:.0f} ms after the stated end of "
            f"the bump ({run}): the bump lasts longer than bump_s says, or the first motion of the "
            "wheels does not fit; check bump_s, the hub sensors, and that no wheel lifted"
        )
        yield Finding("late_start", Severity.WARNING, text)


# Whiteness ----------------------------------------------------------------------------------------


class _Stretch(NamedTuple):
    """Residuals of one channel in one run, SI, and how many constants were fitted to them.

    Of a part of the samples, the number of constants is their share: no whole number.
    """

    channel: str
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    constants: float


class _Correlation(NamedTuple):
    """Correlation of successive residuals, and the number of pairs that it rests on."""

    r: float
    n: float

    def z(self, other: _Correlation) -> float:
        """Return the excess over another correlation, the true one, in standard deviations."""
        spread = (1.0 - other.r**2) * (1.0 / self.n + 1.0 / other.n)
        return float((self.r - other.r) / np.sqrt(spread))


_WHITE = _Correlation(0.0, np.inf)


def whiteness_findings(estimation: Estimation) -> Iterator[Finding]:
    """Compare the lag-1 autocorrelation of the residuals with that of the channel at rest.

    All runs are pooled; a gap in the sampling makes no pair.
    """
    noise = estimation.noise
    at_rest = _correlations(_noise_before_motion(estimation), noise)
    coloured = {name: one for name, one in at_rest.items() if one.z(_WHITE) > Z_LIMIT}
    if coloured:
        names = sorted(coloured, key=lambda name: -coloured[name].r)
        worst = coloured[names[0]]
        factor = float(np.sqrt((1.0 + worst.r) / (1.0 - worst.r)))
        yield Finding(
            "coloured_noise",
            Severity.WARNING if factor > NARROW_LIMIT else Severity.NOTE,
            f"the noise at rest is not white, worst {names[0]} with a correlation of {worst.r:.2f} "
            f"from sample to sample (z {worst.z(_WHITE):.0f}, limit {Z_LIMIT}): {listed(names)}; "
            f"intervals that rest on it are too narrow by up to {factor:.2f} (limit "
            f"{NARROW_LIMIT}): look for hum or a running engine, and state the sensor's low-pass "
            "if it has one",
        )
    excess: dict[str, tuple[float, float, str]] = {}  # largest z of a channel, its r, its window
    windows = {f"the first {EARLY_S:g} s of the decays": EARLY_S, "the decays": np.inf}
    for window, end_s in windows.items():
        for name, one in _correlations(_residuals_until(estimation, end_s), noise).items():
            z = one.z(at_rest.get(name, _WHITE))
            if z > max(Z_LIMIT, excess.get(name, (0.0,))[0]):
                excess[name] = (z, one.r, window)
    if excess:
        names = sorted(excess, key=lambda name: -excess[name][0])
        z, r, window = excess[names[0]]
        compared, meaning = "and there is no rest to compare with", ", or the noise is coloured"
        if names[0] in at_rest:
            compared, meaning = f"but {at_rest[names[0]].r:.2f} at rest", ""
        yield Finding(
            "whiteness",
            Severity.WARNING,
            f"the residuals are not white, worst {names[0]} in {window} with a correlation of "
            f"{r:.2f} from sample to sample {compared} (z {z:.1f}, limit {Z_LIMIT}): "
            f"{listed(names)}; the model leaves motion unexplained{meaning}, so errors may exceed "
            "the intervals: check delay, low-pass, gain and place of these sensors, friction and "
            "dampers",
        )


def _residuals_until(estimation: Estimation, end_s: float) -> Iterator[_Stretch]:
    """Yield the residuals of each channel before `end_s`, s since the decay's start.

    Initial state and offset are fitted to the whole decay.  By approximation each sample bears the
    same share of them, so the kept samples bear as many constants as their share of all samples.
    """
    for decay, residuals in zip(estimation.decays, estimation.residuals, strict=True):
        for recording in decay.recordings:
            kept = recording.time_s < end_s
            for name in (channel.name for channel in recording.group.channels):
                values = residuals.values[name]
                constants = (len(values) - residuals.freedom[name]) * float(np.mean(kept))
                yield _Stretch(name, recording.time_s[kept], values[kept], constants)


def _noise_before_motion(estimation: Estimation) -> Iterator[_Stretch]:
    """Yield the samples of each channel before the motion begins, less their mean."""
    for record in estimation.records:
        onset = onset_s(record)
        if onset is None:
            continue
        for recording in record.recordings:
            quiet = recording.time_s < onset - _MARGIN_S
            values = recording.values[quiet]
            if len(values) >= _FEWEST_AT_REST:
                columns = (values - values.mean(axis=0)).T
                for channel, column in zip(recording.group.channels, columns, strict=True):
                    # The one constant is the mean.
                    yield _Stretch(channel.name, recording.time_s[quiet], column, 1.0)


def _correlations(
    stretches: Iterator[_Stretch], noise: Mapping[str, float]
) -> dict[str, _Correlation]:
    """Return the correlation of the channels that have samples and noise enough to be judged.

    The stretches of one channel are pooled.
    """
    pooled: dict[str, list[_Stretch]] = {}
    for stretch in stretches:
        if len(stretch.time_s) > 1:
            pooled.setdefault(stretch.channel, []).append(stretch)
    result = {}
    for name, parts in pooled.items():
        products, squares, n_pairs = 0.0, 0.0, 0
        for part in parts:
            interval_s = np.diff(part.time_s)
            period_s = np.median(interval_s)
            is_pair = np.abs(interval_s - period_s) < 0.5 * period_s  # no sample is missing
            before, after = part.values[:-1][is_pair], part.values[1:][is_pair]
            products += float(before @ after)
            squares += float(before @ before + after @ after) / 2.0
            n_pairs += int(is_pair.sum())
        above_rounding = squares > _SILENT * noise[name] ** 2 * n_pairs
        fine = any(len(np.unique(part.values)) >= _FEWEST_LEVELS for part in parts)
        if n_pairs >= _FEWEST and above_rounding and fine:
            # Each fitted constant takes a smooth part, of correlation 1, out of the residuals:
            # one pair's worth, which is added again.
            r = products / squares + sum(part.constants for part in parts) / n_pairs
            result[name] = _Correlation(min(max(r, -_LARGEST_R), _LARGEST_R), n_pairs)
    return result


# Tests whether all runs, and large and small motion, show the same vehicle ------------------------

_LARGE_S = 0.4
"""Time, s, after which the wheels are at rest and the body moves with half its first amplitude."""
_SEEN = 1e-6
_MATTERS = 0.02
_RATE_HZ = 250.0


class Pull(NamedTuple):
    """Pull of a part of the data away from the common optimum."""

    strength: float
    """Square of the pull in units of what chance would give; noise stays below 1."""
    parameter: str
    """The parameter on which it pulls hardest."""
    change: float
    """Relative change of that parameter that the part asks for, the others kept."""

    @property
    def in_words(self) -> str:
        """The parameter and the change that is asked for."""
        return f"({self.parameter} {self.change * 100:+.0f} %)"


def repeat_findings(estimation: Estimation, rival: float) -> tuple[Finding, ...]:
    """Name runs that disagree with the others, else a dependence on amplitude.

    `rival`: strength of the likeliest cause that all runs share: it may also make runs disagree.
    """
    return tuple(_odd_runs(estimation, rival)) or tuple(_amplitude(estimation))


def some_runs_are_wrong(estimation: Estimation) -> bool:
    """Return whether a fit that does not hold would hold without the runs that pull hardest."""
    if len(estimation.decays) < 3:
        return False
    labels, _ = _hardest(estimation)
    return _mean_square(estimation, labels) <= estimation.chi2_limit


def _hardest(estimation: Estimation) -> tuple[tuple[str, ...], Pull]:
    """Return the labels of the runs that disagree most, and their pull.

    They are one run, or those of a mass state from some repeat on: its weights were changed.
    """

    def repeat(label: str) -> int:
        number = label.rpartition("_")[2]
        return int(number) if number.isdecimal() else 0

    blocks = linearised_at(estimation).blocks
    suspected: list[tuple[str, ...]] = [(decay.label,) for decay in estimation.decays]
    for state in dict.fromkeys(decay.mass_state for decay in estimation.decays):
        labels = [d.label for d in estimation.decays if d.mass_state == state]
        for first in sorted(set(map(repeat, labels)))[1:]:
            later = tuple(label for label in labels if repeat(label) >= first)
            suspected += [later] if len(later) > 1 else []
    pulls = {odd: pull_of(estimation, [blocks[label] for label in odd]) for odd in suspected}
    return max(pulls.items(), key=lambda item: item[1].strength)


def pull_of(estimation: Estimation, parts: Iterable[NormalBlock]) -> Pull:
    """Return the pull of some parts of the data."""
    chosen = tuple(parts)
    H = np.sum([part.information for part in chosen], axis=0)
    g = np.sum([part.gradient for part in chosen], axis=0)
    C = np.where(np.isfinite(estimation.fit.covariance), estimation.fit.covariance, 0.0)
    V = H - H @ C @ H
    diagonal = np.maximum(np.diag(V), 1e-300)
    scale = 1.0 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(V * np.outer(scale, scale))
    seen = values > _SEEN * values[-1]
    square = float(np.sum((vectors[:, seen].T @ (g * scale)) ** 2 / values[seen]))
    chance = (np.sqrt(np.sum(seen)) + 5.0) ** 2 * max(1.0, estimation.chi2_per_n)
    names = estimation.box.parameters
    worst = int(np.argmax(np.abs((g * scale)[: len(names)])))
    return Pull(square / float(chance), names[worst], float(g[worst] / diagonal[worst]))


def _odd_runs(estimation: Estimation, rival: float) -> Iterator[Finding]:
    """Yield a finding if the fit holds without the runs that disagree most."""
    labels, pull = _hardest(estimation)
    odd = pull.strength > max(1.0, rival) and abs(pull.change) > _MATTERS
    if len(estimation.decays) < 3 or (estimation.holds and not odd):
        return
    every, without = _mean_square(estimation), _mean_square(estimation, labels)
    if not estimation.holds and without > 1.0 + 0.5 * (every - 1.0):
        return
    names = ", ".join(labels)
    better = f"chi2/n is {without:.3f} instead of {every:.3f}"
    text = (
        f"run {names} disagrees with the others {pull.in_words}: without it {better}; reject it "
        "and repeat it, or look for what changed (a second bump, a warm damper, a loose weight)"
    )
    if len(labels) > 1:  # and which of them are wrong is not known
        text = (
            f"runs {names} disagree with the others {pull.in_words}: without them {better}; other "
            "weights were on the car: give these runs a mass state of their own, or reject those "
            "with the wrong weights"
        )
    severity = Severity.ERROR if len(labels) > 1 else Severity.WARNING
    yield Finding("odd_run", severity, text, subject=names, value=without)


def _mean_square(estimation: Estimation, without: Collection[str] = ()) -> float:
    """Return the mean square residual; of the other runs, fitted again, where some are left out."""
    decays = tuple(d.thinned(_RATE_HZ) for d in estimation.decays if d.label not in without)
    box, noise, eta = estimation.box, estimation.noise, estimation.fit.eta
    if without:
        eta = fit(box, decays, noise, eta, 0.1, 20).eta
    parts = estimation.engine.residuals(decays, noise, eta)
    squares = sum(
        float(v @ v) / noise[name] ** 2 for part in parts for name, v in part.values.items()
    )
    return squares / sum(sum(part.freedom.values()) for part in parts)


def moves_without(estimation: Estimation, labels: Collection[str]) -> dict[str, float]:
    """Return the change of each parameter's unknown if runs are left out, to first order."""
    blocks = linearised_at(estimation).blocks
    others = [part.information for name, part in blocks.items() if name not in labels]
    covariance = covariance_of(np.sum(others, axis=0))
    kept = np.where(np.isfinite(covariance), covariance, 0.0)
    step = -kept @ np.sum([blocks[label].gradient for label in labels], axis=0)
    names = estimation.box.parameters
    return dict(zip(names, step[: len(names)].tolist(), strict=True))


def _amplitude(estimation: Estimation) -> Iterator[Finding]:
    """Yield a finding where the small motion after the first 0.4 s asks for another vehicle."""
    late = [
        replace(d, recordings=tuple(r.between(_LARGE_S, np.inf) for r in d.recordings))
        for d in estimation.decays
    ]
    late = [d for d in late if all(len(r.time_s) > 50 for r in d.recordings)]
    if not late:
        return
    blocks = normal_blocks(estimation.box, tuple(late), estimation.noise, estimation.fit.eta)
    pull = pull_of(estimation, [blocks[d.label] for d in late])
    if pull.strength > 1.0 and abs(pull.change) >= _MATTERS:
        text = (
            f"the small motion after 0.4 s asks for other parameters {pull.in_words}: the vehicle "
            "is not linear; look for friction, or compare bumps of two heights"
        )
        yield Finding("amplitude", Severity.WARNING, text)
