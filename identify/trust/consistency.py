"""Tests whether all runs, and large and small motion, show the same vehicle.

Each part of the data has its own pull on the parameters; at the common optimum the pulls cancel.
If the parts agree, each pull is noise of known covariance (Hausman 1978); a part that disagrees
pulls harder.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding, Severity

from ..decays.decay import FreeDecay
from ..fit.estimation import Estimation, linearised_at
from ..fit.likelihood import covariance_of, fit, normal_blocks, residuals
from ..fit.varpro import NormalBlock

_LARGE_S = 0.4
"""Time, s, after which the wheels are at rest and the body moves with half its first amplitude."""
_SEEN = 1e-6
_FEWEST = 3
"""Least number of runs of which one can be odd."""
_HEIGHTS = 1.3
"""Ratio of bump heights above which they count as two heights."""
_MATTERS = 0.02
_RATE_HZ = 250.0


@dataclass(frozen=True, slots=True)
class Pull:
    """Pull of a part of the data away from the common optimum."""

    strength: float
    """Square of the pull in units of what chance would give; noise stays below 1."""
    parameter: str
    """The parameter on which it pulls hardest."""
    change: float
    """Relative change of that parameter that the part asks for, the others kept."""


def repeat_findings(estimation: Estimation, rival: float) -> tuple[Finding, ...]:
    """Name runs that disagree with the others, and a dependence on amplitude.

    `rival`: strength of the likeliest cause that all runs share: it may also make runs disagree.
    """
    runs, odd, pull = _hardest(estimation)
    findings = _odd_runs(estimation, odd, pull, rival)
    if findings:
        return findings
    return (*_small_motion(estimation), *_two_heights(estimation, runs))


def some_runs_are_wrong(estimation: Estimation) -> bool:
    """Return whether a fit that does not hold would hold without the runs that pull hardest."""
    _, odd, _ = _hardest(estimation)
    if len(estimation.decays) < _FEWEST:
        return False
    return _without(estimation, odd) <= estimation.chi2_limit


def _hardest(estimation: Estimation) -> tuple[dict[str, NormalBlock], tuple[str, ...], Pull]:
    """Return the parts of the runs, and the labels of those that disagree most with their pull.

    They are one run, or those of a mass state from some repeat on: its weights were changed.
    """
    parts = linearised_at(estimation).blocks
    runs = {decay.label: parts[decay.label] for decay in estimation.decays}
    suspected: list[tuple[str, ...]] = [(label,) for label in runs]
    for state in dict.fromkeys(decay.mass_state for decay in estimation.decays):
        labels = [d.label for d in estimation.decays if d.mass_state == state]
        repeats = sorted({_repeat(label) for label in labels})
        for first in repeats[1:]:
            later = tuple(label for label in labels if _repeat(label) >= first)
            suspected += [later] if len(later) > 1 else []
    pulls = {odd: pull_of(estimation, [runs[label] for label in odd]) for odd in suspected}
    odd = max(pulls, key=lambda labels: pulls[labels].strength)
    return runs, odd, pulls[odd]


def _repeat(label: str) -> int:
    number = label.rpartition("_")[2]
    return int(number) if number.isdecimal() else 0


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
    rank = int(np.sum(seen))
    n = len(estimation.box.parameters)
    worst = int(np.argmax(np.abs(g[:n] * scale[:n])))
    chance = (np.sqrt(rank) + 5.0) ** 2 * max(1.0, estimation.chi2_per_n)
    change = float(g[worst] / diagonal[worst])
    return Pull(square / chance, estimation.box.parameters[worst], change)


def _odd_runs(
    estimation: Estimation, labels: tuple[str, ...], pull: Pull, rival: float
) -> tuple[Finding, ...]:
    """Return a finding if the fit holds without the runs that disagree most."""
    odd = pull.strength > max(1.0, rival) and abs(pull.change) > _MATTERS
    if len(estimation.decays) < _FEWEST or (estimation.holds and not odd):
        return ()
    everything = tuple(d.thinned(_RATE_HZ) for d in estimation.decays)
    with_it = _mean_square(estimation, everything, estimation.fit.eta)
    without = _without(estimation, labels)
    if not estimation.holds and without > 1.0 + 0.5 * (with_it - 1.0):
        return ()
    size = f"({pull.parameter} {pull.change * 100:+.0f} %)"
    better = f"chi2/n is {without:.3f} instead of {with_it:.3f}"
    names = ", ".join(labels)
    if len(labels) > 1:  # and which of them are wrong is not known
        text = (
            f"runs {names} disagree with the others {size}: without them {better}; other weights "
            "were on the car: give these runs a mass state of their own, or reject those with the "
            "wrong weights"
        )
        return (Finding("odd_run", Severity.ERROR, text, subject=names, value=without),)
    text = (
        f"run {names} disagrees with the others {size}: without it {better}; reject it and repeat "
        "it, or look for what changed (a second bump, a warm damper, a loose weight)"
    )
    return (Finding("odd_run", Severity.WARNING, text, subject=names, value=without),)


def _without(estimation: Estimation, labels: tuple[str, ...]) -> float:
    """Return the mean square residual of the other runs, fitted without these."""
    others = tuple(d.thinned(_RATE_HZ) for d in estimation.decays if d.label not in labels)
    eta = fit(estimation.box, others, estimation.noise, estimation.fit.eta, 0.1, 20).eta
    return _mean_square(estimation, others, eta)


def moves_without(estimation: Estimation, labels: Collection[str]) -> dict[str, float]:
    """Return the change of each parameter's unknown if runs are left out, to first order."""
    parts = linearised_at(estimation).blocks
    others = [part.information for name, part in parts.items() if name not in labels]
    covariance = covariance_of(np.sum(others, axis=0))
    kept = np.where(np.isfinite(covariance), covariance, 0.0)
    step = -kept @ np.sum([parts[label].gradient for label in labels], axis=0)
    names = estimation.box.parameters
    return dict(zip(names, step[: len(names)].tolist(), strict=True))


def _mean_square(
    estimation: Estimation, decays: tuple[FreeDecay, ...], eta: NDArray[np.float64]
) -> float:
    left = residuals(estimation.box, decays, estimation.noise, eta)
    squares = sum(
        float(v @ v) / estimation.noise[name] ** 2 for r in left for name, v in r.values.items()
    )
    return squares / sum(sum(r.freedom.values()) for r in left)


def _small_motion(estimation: Estimation) -> tuple[Finding, ...]:
    """Compare the whole decays with what follows their first 0.4 s."""
    late = tuple(
        FreeDecay(d.label, d.mass_state, d.start_s, tuple(r.between(_LARGE_S, np.inf)
                  for r in d.recordings))
        for d in estimation.decays
    )  # fmt: skip
    late = tuple(d for d in late if all(len(r.time_s) > 50 for r in d.recordings))
    if not late:
        return ()
    parts = normal_blocks(estimation.box, late, estimation.noise, estimation.fit.eta)
    return _amplitude(estimation, [parts[d.label] for d in late], "the small motion after 0.4 s")


def _two_heights(estimation: Estimation, runs: Mapping[str, NormalBlock]) -> tuple[Finding, ...]:
    """Compare runs over low bumps with the others, where there are two heights."""
    size = {d.label: _size(d) for d in estimation.decays}
    kinds: dict[str, list[str]] = {}
    for label in runs:
        kinds.setdefault(label.rpartition("_")[0], []).append(label)
    low = [
        label
        for members in kinds.values()
        for label in members
        if size[label] * _HEIGHTS < max(size[other] for other in members)
    ]
    if not low:
        return ()
    return _amplitude(estimation, [runs[label] for label in low], "the runs over the lower bump")


def _size(decay: FreeDecay) -> float:
    return float(np.sqrt(np.mean([np.mean(np.var(r.values, axis=0)) for r in decay.recordings])))


def _amplitude(estimation: Estimation, parts: list[NormalBlock], which: str) -> tuple[Finding, ...]:
    pull = pull_of(estimation, parts)
    if pull.strength <= 1.0 or abs(pull.change) < _MATTERS:
        return ()
    text = (
        f"{which} asks for other parameters ({pull.parameter} {pull.change * 100:+.0f} %): the "
        "vehicle is not linear; look for friction, or compare bumps of two heights"
    )
    return (Finding("amplitude", Severity.WARNING, text),)
