"""Scores the table of hypotheses on a fit, refits what large faults explain, and names one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dbc.finding import Finding

from ..fit.estimation import Estimation
from ..fit.uncertainty import COVERAGE_95
from ..model.chi_squared import exceeded_by_chance
from ..numbers import with_half
from .faults import gain_of, swapped_labels, wrong_sensors
from .hypotheses import GAIN, LATE, TYRE_DAMPING, WEIGHTS, Effect, hypotheses
from .plausibility import BELOW_SIGMAS
from .refit import Cause
from .score_test import Score, fitted_decays, scores
from .statements import scale_facts, shift_without_scales

_NAMED = 3  # parts of a cause that are listed, the surest first
_CHANCE = 1e-6
"""Probability that noise alone gives so large a cause; a session has some forty."""
_RATE_HZ = 500.0  # the motion ends at 20 Hz; more samples say little more
_EXPLAINS = 0.35
"""Share of the misfit above which an effect is called its cause."""
_CLEARLY = 0.9
"""Share of the misfit above which no other cause is sought."""
_AHEAD = 0.95
"""Share of a sensor's explanation that an effect of the vehicle must reach to be preferred."""
_ALIKE = 0.98
"""Ratio of strengths above which lateness of some is preferred to earliness of the others."""
_SCALES = "scales off by a common factor"
"""The cause of weights that disagree with the scales if the weights are right."""


@dataclass(frozen=True, slots=True)
class Causes:
    """The named causes of a misfit, and all that were tried."""

    findings: tuple[Finding, ...] = ()
    """Findings on what is named."""
    tried: tuple[Cause, ...] = ()
    """Every cause that stands out of the noise."""
    linear: bool = True
    """False if a named cause is that the car is not linear."""


def rank_causes(estimation: Estimation) -> tuple[Cause, ...]:
    """Test every hypothesis on the residuals; the one that explains most comes first."""
    fitted = fitted_decays(estimation, _RATE_HZ)
    effects, traces_of = hypotheses(estimation, fitted)
    tests = scores(estimation, fitted, traces_of, len(effects))
    columns: dict[str, list[int]] = {}
    for i, effect in enumerate(effects):
        columns.setdefault(effect.cause, []).append(i)
    n = sum(one.decay.n_values for one in fitted)
    excess = max((estimation.chi2_per_n - 1.0) * n, 1e-9)
    names = estimation.box.parameters
    found = []
    for chosen in columns.values():
        score, mine = tests.test(chosen), [effects[i] for i in chosen]
        kind = mine[0].kind
        strength = score.gain / max(1.0, estimation.chi2_per_n)
        strength /= exceeded_by_chance(len(chosen), _CHANCE) * kind.bar
        if kind is TYRE_DAMPING and (score.sizes < -BELOW_SIGMAS * score.stds).any():
            strength = 0.0
        if kind is LATE and score.sizes[0] < 0.0:
            strength *= _ALIKE
        found.append(
            Cause(
                mine[0].cause,
                _sizes(mine, score),
                kind.advice,
                score.gain / excess,
                dict(zip(names, score.shift[: len(names)].tolist(), strict=True)),
                gain=score.gain,
                strength=strength,
                kind=kind,
                subject=mine[0].label,
            )
        )
    return tuple(sorted(found, key=lambda cause: -cause.strength))


def _sizes(effects: Sequence[Effect], score: Score) -> str:
    """Return the sizes of the surest parts with their 95 % intervals, as text."""
    rows = [
        (abs(size / std), f"{effect.label} "
         f"{with_half(size * effect.factor, COVERAGE_95 * std * abs(effect.factor))} {effect.unit}")
        for effect, size, std in zip(effects, score.sizes, score.stds, strict=True)
        if std > 0.0
    ]  # fmt: skip
    return ", ".join(text for _, text in sorted(rows, reverse=True)[:_NAMED])


def causes_of(estimation: Estimation, suspects: Sequence[Cause]) -> Causes:
    """Name the likely cause of a misfit, or an effect that matters although there is no misfit.

    `suspects`: its causes as `rank_causes` has them.
    """
    ranked = [one for one in suspects if one.strength > 1.0]
    if estimation.holds:
        ranked = [replace(one, explained=0.0) for one in ranked]
    tried = list(ranked)
    for one in ranked:
        if one.kind is WEIGHTS:
            tried.append(replace(one, name=_SCALES, moved=shift_without_scales(estimation)))
    if ranked or not estimation.holds:
        swap = swapped_labels(estimation)
        if swap is not None:
            return Causes((swap.finding,), (*tried, swap))
    if not ranked:
        return Causes()
    first = _sized(estimation, ranked[0])
    found = [first] if estimation.holds or first.explained > _EXPLAINS else []
    if not estimation.holds and first.explained < _CLEARLY:
        others = wrong_sensors(estimation, [one.subject for one in ranked if one.kind is GAIN])
        tried += others
        found += [other for other in others if other.explained * _AHEAD > first.explained]
    named = tuple(one.finding for one in found[-1:])
    linear = not any(one.kind and one.kind.nonlinear for one in found[-1:])
    return Causes(named, tuple(tried), linear)


def _sized(estimation: Estimation, cause: Cause) -> Cause:
    """Return a scored cause with what is known of it beyond its score."""
    if cause.kind is GAIN:
        found = gain_of(estimation, cause.subject)
        return replace(cause, sizes=found.sizes, advice=found.advice)
    if cause.kind is WEIGHTS:
        scales = replace(cause, moved=shift_without_scales(estimation))
        facts = " and ".join(scale_facts(estimation.box))
        advice = f"weigh them again, or {facts}: one of the two scales shows too much"
        return replace(max(cause, scales, key=lambda one: one.shift), advice=advice)
    return cause
