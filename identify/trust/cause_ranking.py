"""Ranks likely causes: the effects that the model lacks and that would explain the residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..fit.estimation import Estimation
from ..fit.uncertainty import COVERAGE_95
from ..model.chi_squared import exceeded_by_chance
from ..numbers import with_half
from .linear_effects import Effect, gains, lateness, structural, turns
from .nonlinear_effects import suspension_forces
from .refit import largest_shift
from .score_test import FittedDecay, Score, Trace, fitted_decays, scores

_NAMED = 3  # parts of a cause that are listed, the surest first
_CHANCE = 1e-6
"""Probability that noise alone gives so large a cause; a session has some forty."""
_RATE_HZ = 500.0  # the motion ends at 20 Hz; more samples say little more


@dataclass(frozen=True, slots=True)
class Suspect:
    """A cause and its significance."""

    cause: str
    """Effect that the model lacks."""
    effects: tuple[Effect, ...]
    """Its parts."""
    score: Score
    """Their sizes, and the shifts that they mean."""
    explained: float
    """Share of the excess of the squared residuals over the noise that the cause explains."""
    strength: float
    """Fall of the squared residuals in units of what chance would give with so many effects; noise
    stays below 1 except in one of a million cases."""
    shift: float
    """Largest relative change of a parameter by the cause."""
    shifted: str
    """Parameter with that change."""

    def moved(self, names: Sequence[str]) -> dict[str, float]:
        """Return the change of each parameter's unknown by the cause."""
        return dict(zip(names, self.score.shift[: len(names)].tolist(), strict=True))

    @property
    def sizes(self) -> str:
        """Sizes of the surest parts with their 95 % intervals, as text."""
        rows = [
            (abs(size / std), f"{effect.label} "
             f"{with_half(size * effect.factor, COVERAGE_95 * std * abs(effect.factor))} "
             f"{effect.unit}")
            for effect, size, std in zip(
                self.effects, self.score.sizes, self.score.stds, strict=True
            )
            if std > 0.0
        ]  # fmt: skip
        return ", ".join(text for _, text in sorted(rows, reverse=True)[:_NAMED])


def rank_causes(estimation: Estimation) -> tuple[Suspect, ...]:
    """Test every known cause on the residuals; the one that explains most comes first."""
    fitted = fitted_decays(estimation, _RATE_HZ)
    kinds = [
        structural(estimation, fitted),
        lateness(estimation),
        gains(estimation),
        turns(estimation),
    ]
    forces = suspension_forces(estimation)
    effects = [effect for kind in (*kinds, forces) for effect in kind.effects]

    def traces_of(one: FittedDecay) -> Iterator[Trace]:
        parts = zip(*(kind.trace_of(one) for kind in kinds), strict=True)
        for part, sampled in zip(parts, forces.trace_of(one), strict=True):
            yield Trace(np.concatenate(part, axis=-1), sampled)

    tests = scores(estimation, fitted, traces_of, len(effects))
    causes: dict[str, list[int]] = {}
    for i, effect in enumerate(effects):
        causes.setdefault(effect.cause, []).append(i)
    thinned = sum(one.decay.n_values for one in fitted)
    found = [
        _suspect(estimation, cause, tuple(effects[i] for i in chosen), tests.test(chosen), thinned)
        for cause, chosen in causes.items()
    ]
    return tuple(sorted(found, key=lambda suspect: -suspect.strength))


def _suspect(
    estimation: Estimation, cause: str, effects: tuple[Effect, ...], score: Score, n: int
) -> Suspect:
    chi2 = max(1.0, estimation.chi2_per_n)
    excess = max((estimation.chi2_per_n - 1.0) * n, 1e-9)
    chance = exceeded_by_chance(len(effects), _CHANCE)
    names = estimation.box.parameters
    moved = dict(zip(names, score.shift[: len(names)].tolist(), strict=True))
    shift, shifted = largest_shift(moved)
    return Suspect(
        cause,
        effects,
        score,
        explained=score.gain / excess,
        strength=score.gain / chi2 / chance,
        shift=shift,
        shifted=shifted,
    )
