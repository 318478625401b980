"""The table of what a linear model may lack, each row tested on the residuals of a fit.

Springs, dampers and unequal sides; lengths and weights; sensors that are late, turned or have a
wrong gain: each is a direction among the unknowns of the richest problem, in which all of them are
open.  At the optimum, what the fit lacks leaves a slope in that direction.  Its size, the
uncertainty of that, and the change of the parameters follow from one projection (Lagrange
multiplier test, Rao 1948): no other fit is needed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.vehicle import RICHEST, parameter_unit
from dbc.words import Finding, Severity

from ..decays.decay import with_channels
from ..fit.estimation import Estimation, linearised_at
from ..fit.grey_box import SIGNED, GreyBox
from ..fit.likelihood import PRIORS, fit, normal_blocks
from ..fit.uncertainty import COVERAGE_95
from ..fit.varpro import NormalBlock
from ..model.chi_squared import exceeded_by_chance
from ..numbers import with_half
from .finding import Cause
from .gates import BELOW_SIGMAS
from .inputs import scale_facts

Array = NDArray[np.float64]

LATE_ADVICE = "state delay_s and delay_sigma_s of these channels, or correct their clock"
ROTATIONS = (
    (Quantity.PITCH_RATE, Quantity.ROLL_RATE),
    (Quantity.PITCH_ACCELERATION, Quantity.ROLL_ACCELERATION),
)
"""Quantities of the body that a turn of its axes mixes, and their exchange swaps."""
_ROWS = (
    Cause("anti-roll bars", "set anti_roll_bars = true in [vehicle.structure]", kind="bars"),
    Cause("tyre damping", "set tyre_damping = true in [vehicle.structure]", kind="tyre damping"),
    Cause("CG off the middle", "set cg_offset = true in [vehicle.structure]", kind="cg"),
    Cause("left and right differ", "set symmetric = false in [vehicle.structure]", kind="sides"),
    Cause(
        "a length is wrong",
        "measure the lengths of [vehicle.geometry] again, or leave them out",
        kind="length",
    ),
    Cause("added weights off by a common factor", kind="weights"),  # their scale, or their unit
    Cause("{} late", LATE_ADVICE, kind="late", of_bench=True),
    Cause("gain of {}", kind="gain", of_bench=True),
    Cause(
        "IMU turned about z",
        "mount it with its x axis along the car, and record again",
        kind="turn",
        of_bench=True,
    ),
)
TABLE = {row.kind: row for row in _ROWS}

_CHANCE = 1e-6
"""Probability that noise alone gives so large a cause; a session has some forty."""
_TYRE_BAR = 0.5
"""Strength that proves tyre damping: every tyre has some, so that one in a thousand is enough."""
_EARLY_BAR = 0.98
"""Factor on the strength of earliness: lateness of the others explains the same."""
_SEEN = 1e-9
"""Least share of an effect's information that the unknowns must leave for it to be testable."""
_PULLS = 1e-6
"""Least share of the strongest direction's information with which a direction counts in a pull."""
_LARGE_S = 0.4
"""Time, s, after which the wheels are at rest and the body moves with half its first amplitude."""
_MATTERS = 0.02
"""Relative change of a parameter from which runs, or the small motion, disagree."""
_RATE_HZ = 250.0
"""Rate of the samples on which the vehicle is fitted again, Hz."""


def kind_of_sensor(channel: Channel) -> str:
    """Return the kind of sensors that a channel belongs to, in words."""
    if channel.corner is None:
        return "body sensors"
    return "hub sensors" if channel.quantity is Quantity.HUB_ACCELERATION else "travel sensors"


class _Effect(NamedTuple):
    """One part of a hypothesis; the parts of a cause are tested together."""

    kind: str
    """Key of `TABLE`."""
    label: str
    """Name of this part among those of its cause."""
    unit: str
    factor: float
    """Printed unit of its size, and factor from one step in its direction to it."""
    direction: Mapping[int, float]
    """Step of each unknown of the richest problem, by its place; 0 for the others."""


class _Richest(GreyBox):
    """The richest problem: each IMU may be turned about z, too.

    The turn, rad, is positive to the left, as seen from above: pitch and roll then show a part of
    each other.
    """

    turns: Mapping[str, int]
    """Place of the turn of each IMU among the unknowns, by its group."""
    _turned: tuple[tuple[str, str, str], ...]
    """Group, pitch channel and roll channel."""

    def __post_init__(self) -> None:
        super().__post_init__()
        turned = []
        for group in self.groups:
            names = {c.quantity: c.name for c in group.channels}
            for pitch, roll in ROTATIONS:
                if pitch in names and roll in names:
                    turned.append((group.name, names[pitch], names[roll]))
        first = len(self.parameters) + len(self.corrections)
        turns = {imu: i for i, imu in enumerate(dict.fromkeys(t[0] for t in turned), first)}
        prior_sigma = np.insert(self.prior_sigma, first, np.full(len(turns), np.inf))
        object.__setattr__(self, "turns", turns)
        object.__setattr__(self, "_turned", tuple(turned))
        object.__setattr__(self, "prior_sigma", prior_sigma)

    def motion_rows(self, eta: NDArray[np.complex128]) -> dict[str, NDArray[np.complex128]]:
        """Return each channel's row on the seven motions, those of turned IMUs mixed."""
        rows = super().motion_rows(eta)
        for imu, pitch, roll in self._turned:
            turn = eta[:, self.turns[imu], None]
            rows[pitch], rows[roll] = (
                rows[pitch] - turn * rows[roll],
                rows[roll] + turn * rows[pitch],
            )
        return rows


def rank_causes(estimation: Estimation) -> tuple[Cause, ...]:
    """Test every hypothesis on the residuals of a linear fit; the one that explains most is first.

    Its unknowns and priors are those of the fit; a step in the direction of a hypothesis is free.
    """
    box, eta = estimation.box, estimation.fit.eta
    decays = tuple(
        with_channels(d, lambda c: replace(c, gain_sigma=0.1, delay_sigma_s=1.0))
        for d in estimation.decays
    )
    groups = tuple(dict.fromkeys(r.group for d in decays for r in d.recordings))
    states = []
    for state in box.mass_states:
        weights = tuple(replace(w, sigma_kg=w.mass_kg) for w in state.added.weights)
        states.append(replace(state, added=replace(state.added, weights=weights)))
    rich = _Richest(groups, tuple(states), None, RICHEST, box.facts)
    fitted = _places_of_unknowns(box, rich)
    # What is open here alone is zero at the fit.
    rich_eta = rich.unknowns_of(estimation.full)
    rich_eta[len(rich.parameters) :] = (fitted @ eta)[len(rich.parameters) :]
    blocks = normal_blocks(rich, decays, estimation.noise, rich_eta)
    measured = [block for label, block in blocks.items() if label != PRIORS]
    H = np.sum([block.information for block in measured], axis=0)
    g = np.sum([block.gradient for block in measured], axis=0)
    prior = box.prior_sigma**-2
    covariance = np.linalg.pinv(fitted.T @ H @ fitted + np.diag(prior), hermitian=True)
    step = covariance @ (fitted.T @ g - prior * eta)  # nothing, but for rounding and another noise

    members: dict[str, list[_Effect]] = {}
    for effect in _effects(box, rich):
        name = TABLE[effect.kind].name.format(effect.label)
        members.setdefault(name, []).append(effect)
    n_values = sum(decay.n_values for decay in decays)
    causes = []
    for name, effects in members.items():
        D = np.zeros((len(rich_eta), len(effects)))
        for k, effect in enumerate(effects):
            D[list(effect.direction), k] = list(effect.direction.values())
        mixed = D.T @ H @ fitted
        information = D.T @ H @ D
        gradient = D.T @ g - mixed @ step
        remaining = information - mixed @ covariance @ mixed.T
        scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
        values, vectors = np.linalg.eigh(remaining * np.outer(scale, scale))
        seen = values > _SEEN
        inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T * np.outer(scale, scale)
        sizes, stds = inverse @ gradient, np.sqrt(np.diag(inverse))
        gain = float(gradient @ sizes)
        moved = (-covariance @ mixed.T @ sizes)[: len(box.parameters)].tolist()
        row = TABLE[effects[0].kind]
        chance = exceeded_by_chance(len(effects), _CHANCE)
        strength = gain / max(1.0, estimation.chi2_per_n) / chance
        if row.kind == "tyre damping":
            below_zero = bool((sizes < -BELOW_SIGMAS * stds).any())
            strength = 0.0 if below_zero else strength / _TYRE_BAR
        elif row.kind == "late" and sizes[0] < 0.0:
            strength *= _EARLY_BAR
        cause = replace(
            row,
            name=name,
            sizes=_in_words(effects, sizes, stds),
            explained=gain / max((estimation.chi2_per_n - 1.0) * n_values, 1e-9),
            moved=dict(zip(box.parameters, moved, strict=True)),
            subject=effects[0].label,
            gain=gain,
            strength=strength,
        )
        causes.append(cause)
    return tuple(sorted(causes, key=lambda cause: -cause.strength))


def _places_of_unknowns(box: GreyBox, rich: GreyBox) -> Array:
    """Return the matrix from the unknowns of a problem to those of the richest one, (R, P).

    A parameter of both sides is two there; the cross weight, if there is one, is the last of both.
    """
    E = np.zeros((len(rich.prior_sigma), len(box.prior_sigma)))
    for p, name in enumerate(box.parameters):
        sides = [name] if name in rich.parameters else [f"{name}l", f"{name}r"]
        E[[rich.parameters.index(side) for side in sides], p] = 1.0
    open_names = list(rich.corrections)
    for p, name in enumerate(box.corrections, len(box.parameters)):
        place = open_names.index(name)
        open_names[place] = ""  # two groups of one clock have one name
        E[len(rich.parameters) + place, p] = 1.0
    if len(box.prior_sigma) > len(box.parameters) + len(box.corrections):
        E[-1, -1] = 1.0
    return E


def _effects(box: GreyBox, rich: _Richest) -> Iterator[_Effect]:
    """Yield what the structure lacks, then what may be wrong with lengths, weights and sensors."""
    place = {name: i for i, name in enumerate(rich.parameters)}
    kinds = {"k_a": "bars", "c_t": "tyre damping", "y_s": "cg"}
    for name, scale in SIGNED.items():
        if name not in box.parameters:
            yield _Effect(kinds[name[:3]], name, parameter_unit(name), scale, {place[name]: 1.0})
    if box.structure.symmetric:
        for name in ("m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "c_sf", "c_sr"):
            sides = {place[f"{name}l"]: 1.0, place[f"{name}r"]: -1.0}
            yield _Effect("sides", name, "% more left than right", 200.0, sides)
    if box.geometry is not None:
        for name in ("a", "b", "t_f", "t_r"):
            yield _Effect("length", name, "%", 100.0, {place[name]: 1.0})
    # Decays alone do not show a factor that all weights have in common.
    if rich.weight_masses and scale_facts(box):
        yield _Effect("weights", "all weights", "%", 100.0, rich.weight_masses)
    late: dict[str, dict[int, float]] = {}
    of_kind: dict[str, list[str]] = {}
    for i, group in enumerate(rich.groups):
        kind, delay = kind_of_sensor(group.channels[0]), rich.delay_index(i)
        if delay is not None:
            late.setdefault(group.name, {})[delay] = 1.0
            late.setdefault(kind, {})[delay] = 1.0
            of_kind.setdefault(kind, []).append(group.name)
    for names in of_kind.values():
        if len(names) == 1:  # the kind has no other group
            late.pop(names[0], None)
    for name, delays in late.items():
        yield _Effect("late", name, "ms", 1e3, delays)
    for i, channel in rich.scaled.items():
        yield _Effect("gain", channel.name, "%", 100.0, {i: 1.0})
    for name, i in rich.turns.items():
        yield _Effect("turn", name, "deg", 180.0 / np.pi, {i: 1.0})


def _in_words(effects: Sequence[_Effect], sizes: Array, stds: Array) -> str:
    """Return the sizes of the three surest parts with their 95 % intervals."""
    rows = []
    for effect, size, std in zip(effects, sizes.tolist(), stds.tolist(), strict=True):
        if std > 0.0:
            half = COVERAGE_95 * std * abs(effect.factor)
            text = f"{effect.label} {with_half(size * effect.factor, half)} {effect.unit}"
            rows.append((abs(size / std), text))
    return ", ".join(text for _, text in sorted(rows, reverse=True)[:3])


# Whether all runs, and the large and the small motion, show the same vehicle ----------------------


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
    seen = values > _PULLS * values[-1]
    square = float(np.sum((vectors[:, seen].T @ (g * scale)) ** 2 / values[seen]))
    chance = (np.sqrt(np.sum(seen)) + 5.0) ** 2 * max(1.0, estimation.chi2_per_n)
    names = estimation.box.parameters
    worst = int(np.argmax(np.abs((g * scale)[: len(names)])))
    return Pull(square / float(chance), names[worst], float(g[worst] / diagonal[worst]))


def _hardest(estimation: Estimation) -> tuple[tuple[str, ...], Pull]:
    """Return the labels of the runs that disagree most, and their pull.

    They are one run, or those of a mass state from some repeat on: its weights were changed.
    """
    repeats: dict[str, list[tuple[int, str]]] = {}
    for decay in estimation.decays:
        number = decay.label.rpartition("_")[2]
        repeat = int(number) if number.isdecimal() else 0
        repeats.setdefault(decay.mass_state, []).append((repeat, decay.label))
    suspected: list[tuple[str, ...]] = [(decay.label,) for decay in estimation.decays]
    for of_state in repeats.values():
        for first in sorted({repeat for repeat, _ in of_state})[1:]:
            later = tuple(label for repeat, label in of_state if repeat >= first)
            suspected += [later] if len(later) > 1 else []
    blocks = linearised_at(estimation).blocks
    pulls = {odd: pull_of(estimation, [blocks[label] for label in odd]) for odd in suspected}
    return max(pulls.items(), key=lambda item: item[1].strength)


def _fit_without(estimation: Estimation, labels: Collection[str]) -> tuple[float, Array]:
    """Return chi2 per degree of freedom of a fit without some runs, and its unknowns."""
    decays = tuple(d.thinned(_RATE_HZ) for d in estimation.decays if d.label not in labels)
    box, noise = estimation.box, estimation.noise
    eta = fit(box, decays, noise, estimation.fit.eta, 0.1, 20).eta
    parts = estimation.engine.residuals(decays, noise, eta)
    squares = sum(
        float(v @ v) / noise[name] ** 2 for part in parts for name, v in part.values.items()
    )
    return squares / sum(sum(part.freedom.values()) for part in parts), eta


def some_runs_are_wrong(estimation: Estimation) -> bool:
    """Return whether a fit that does not hold would hold without the runs that pull hardest."""
    if len(estimation.decays) < 3:
        return False
    labels, _ = _hardest(estimation)
    return _fit_without(estimation, labels)[0] <= estimation.chi2_limit


def odd_runs(estimation: Estimation, rival: float) -> tuple[Finding, Cause] | None:
    """Return the runs without which the fit holds, or nearly; None if all agree.

    `rival`: strength of the likeliest cause that all runs share: it may also make runs disagree.
    """
    labels, pull = _hardest(estimation)
    odd = pull.strength > max(1.0, rival) and abs(pull.change) > _MATTERS
    if len(estimation.decays) < 3 or (estimation.holds and not odd):
        return None
    chi2, (without, eta) = estimation.chi2_per_n, _fit_without(estimation, labels)
    if not estimation.holds and without > 1.0 + 0.5 * (chi2 - 1.0):
        return None
    names = ", ".join(labels)
    better = f"chi2/n is {without:.3f} instead of {chi2:.3f}"
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
    moved = dict(zip(estimation.box.parameters, (eta - estimation.fit.eta).tolist(), strict=False))
    explained = 1.0 - (without - 1.0) / max(chi2 - 1.0, 1e-9)
    cause = Cause(f"run {names}", explained=explained, moved=moved)
    return Finding("odd_run", severity, text, subject=names, value=without), cause


def amplitude_findings(estimation: Estimation) -> Iterator[Finding]:
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
