"""Tests whether all runs, and large and small motion, show the same vehicle.

Each part of the data has its own pull on the parameters; at the common optimum the pulls cancel.
If the parts agree, each pull is noise of known covariance (Hausman 1978); a part that disagrees
pulls harder.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dbc.finding import Finding, Severity

from ..fit.estimation import Estimation, linearised_at
from ..fit.likelihood import covariance_of, fit, normal_blocks
from ..fit.varpro import NormalBlock

_LARGE_S = 0.4
"""Time, s, after which the wheels are at rest and the body moves with half its first amplitude."""
_SEEN = 1e-6
_FEWEST = 3
"""Least number of runs of which one can be odd."""
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


def repeat_findings(estimation: Estimation, rival: float) -> tuple[Finding, ...]:
    """Name runs that disagree with the others, and a dependence on amplitude.

    `rival`: strength of the likeliest cause that all runs share: it may also make runs disagree.
    """
    odd = _odd_runs(estimation, rival)
    return (odd,) if odd else tuple(_amplitude(estimation))


def some_runs_are_wrong(estimation: Estimation) -> bool:
    """Return whether a fit that does not hold would hold without the runs that pull hardest."""
    if len(estimation.decays) < _FEWEST:
        return False
    labels, _ = _hardest(estimation)
    return _mean_square(estimation, labels) <= estimation.chi2_limit


def _hardest(estimation: Estimation) -> tuple[tuple[str, ...], Pull]:
    """Return the labels of the runs that disagree most, and their pull.

    They are one run, or those of a mass state from some repeat on: its weights were changed.
    """
    blocks = linearised_at(estimation).blocks
    suspected: list[tuple[str, ...]] = [(decay.label,) for decay in estimation.decays]
    for state in dict.fromkeys(decay.mass_state for decay in estimation.decays):
        labels = [d.label for d in estimation.decays if d.mass_state == state]
        for first in sorted(set(map(_repeat, labels)))[1:]:
            later = tuple(label for label in labels if _repeat(label) >= first)
            suspected += [later] if len(later) > 1 else []
    pulls = {odd: pull_of(estimation, [blocks[label] for label in odd]) for odd in suspected}
    return max(pulls.items(), key=lambda item: item[1].strength)


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
    chance = (np.sqrt(np.sum(seen)) + 5.0) ** 2 * max(1.0, estimation.chi2_per_n)
    names = estimation.box.parameters
    worst = int(np.argmax(np.abs((g * scale)[: len(names)])))
    return Pull(square / float(chance), names[worst], float(g[worst] / diagonal[worst]))


def _odd_runs(estimation: Estimation, rival: float) -> Finding | None:
    """Return a finding if the fit holds without the runs that disagree most."""
    labels, pull = _hardest(estimation)
    odd = pull.strength > max(1.0, rival) and abs(pull.change) > _MATTERS
    if len(estimation.decays) < _FEWEST or (estimation.holds and not odd):
        return None
    every, without = _mean_square(estimation), _mean_square(estimation, labels)
    if not estimation.holds and without > 1.0 + 0.5 * (every - 1.0):
        return None
    names = ", ".join(labels)
    size = f"({pull.parameter} {pull.change * 100:+.0f} %)"
    better = f"chi2/n is {without:.3f} instead of {every:.3f}"
    if len(labels) > 1:  # and which of them are wrong is not known
        text = (
            f"runs {names} disagree with the others {size}: without them {better}; other weights "
            "were on the car: give these runs a mass state of their own, or reject those with the "
            "wrong weights"
        )
        return Finding("odd_run", Severity.ERROR, text, subject=names, value=without)
    text = (
        f"run {names} disagrees with the others {size}: without it {better}; reject it and repeat "
        "it, or look for what changed (a second bump, a warm damper, a loose weight)"
    )
    return Finding("odd_run", Severity.WARNING, text, subject=names, value=without)


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
            "the small motion after 0.4 s asks for other parameters "
            f"({pull.parameter} {pull.change * 100:+.0f} %): the vehicle is not linear; look for "
            "friction, or compare bumps of two heights"
        )
        yield Finding("amplitude", Severity.WARNING, text)
