"""The table of what a linear model may lack, each row tested on the residuals of a fit.

Springs, dampers and unequal sides; lengths and weights; sensors that are late, turned or have a
wrong gain: each is a direction among the unknowns of the richest problem, in which all of them are
open.  At the optimum, what the fit lacks leaves a slope in that direction.  Its size, the
uncertainty of that, and the change of the parameters follow from one projection (Lagrange
multiplier test, Rao 1948): no other fit is needed.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from daq.channels import Channel, Quantity
from daq.vehicle import RICHEST, parameter_unit
from dbc.words import Finding, Severity

from ..decays.decay import with_channels
from ..fit.estimation import Estimation, linearised_at
from ..fit.grey_box import SIGNED, GreyBox
from ..fit.likelihood import PRIORS, fit, linearised
from ..fit.uncertainty import COVERAGE_95
from ..fit.varpro import NormalBlock
from ..model.chi_squared import exceeded_by_chance
from ..model.matrices import Complex, Real
from ..numbers import with_half
from .finding import Cause
from .gates import BELOW_SIGMAS
from .inputs import scale_facts

LATE_ADVICE = "state delay_s and delay_sigma_s of these channels, or correct their clock"
ROTATIONS = (
    (Quantity.PITCH_RATE, Quantity.ROLL_RATE),
    (Quantity.PITCH_ACCELERATION, Quantity.ROLL_ACCELERATION),
)
"""Quantities of the body that a turn of its axes mixes, and their exchange swaps."""
_LENGTH_ADVICE = "measure the lengths of [vehicle.geometry] again, or leave them out"
_TURN_ADVICE = "mount it with its x axis along the car, and record again"
TABLE = {
    "bars": Cause("anti-roll bars", "set anti_roll_bars = true in [vehicle.structure]"),
    "tyre damping": Cause("tyre damping", "set tyre_damping = true in [vehicle.structure]"),
    "cg": Cause("CG off the middle", "set cg_offset = true in [vehicle.structure]"),
    "sides": Cause("left and right differ", "set symmetric = false in [vehicle.structure]"),
    "length": Cause("a length is wrong", _LENGTH_ADVICE),
    "weights": Cause("added weights off by a common factor"),  # their scale, or their unit
    "late": Cause("{} late", LATE_ADVICE, of_bench=True),
    "gain": Cause("gain of {}", "check its calibration, unit and sign", of_bench=True),
    "turn": Cause("IMU turned about z", _TURN_ADVICE, of_bench=True),
}
"""Effects that a linear model may lack, without their sizes."""

_LEAST_CHANGE = 0.02
"""Change of a parameter's unknown from which runs, or the small motion, disagree."""


def kind_of_sensor(channel: Channel) -> str:
    """Return the kind of sensors that a channel is of, in words: of the body, hubs or travels."""
    if channel.corner is None:
        return "body sensors"
    return "travel sensors" if channel.quantity is Quantity.SUSPENSION_TRAVEL else "hub sensors"


class _Effect(NamedTuple):
    """One part of a hypothesis; the parts of a cause are tested together."""

    kind: str
    """Key of `TABLE`."""
    label: str
    """Name of this part among those of its cause."""
    unit: str
    """Printed unit of its size."""
    factor: float
    """From one step in its direction to that unit."""
    direction: Mapping[int, float]
    """Step of each unknown of the richest problem, by its index; 0 for the others."""


class _Richest(GreyBox):
    """The richest problem: each IMU may be turned about z, too.

    The turn, rad, is positive to the left, as seen from above: pitch and roll then show a part of
    each other.
    """

    index_of_turn: Mapping[str, int]
    """Index of the turn of each IMU among the unknowns, by its group."""

    def __post_init__(self) -> None:
        super().__post_init__()
        first_index = len(self.parameters) + len(self.corrections)
        imus = dict.fromkeys(imu for imu, _, _ in self._rotations())
        prior_sigma = np.insert(self.prior_sigma, first_index, np.full(len(imus), np.inf))
        index_of_turn = {imu: i for i, imu in enumerate(imus, first_index)}
        object.__setattr__(self, "index_of_turn", index_of_turn)
        object.__setattr__(self, "prior_sigma", prior_sigma)

    def _rotations(self) -> Iterator[tuple[str, str, str]]:
        """Yield group, pitch channel and roll channel of each IMU."""
        for group in self.groups:
            names = {c.quantity: c.name for c in group.channels}
            for pitch, roll in ROTATIONS:
                if pitch in names and roll in names:
                    yield group.name, names[pitch], names[roll]

    def motion_rows(self, eta: Complex) -> dict[str, Complex]:
        """Return each channel's row on the seven motions, those of turned IMUs mixed."""
        rows = super().motion_rows(eta)
        for imu, pitch, roll in self._rotations():
            turn_rad = eta[:, self.index_of_turn[imu], None]
            pitch_row, roll_row = rows[pitch], rows[roll]
            rows[pitch] = pitch_row - turn_rad * roll_row
            rows[roll] = roll_row + turn_rad * pitch_row
        return rows


def rank_causes(estimation: Estimation) -> tuple[Cause, ...]:
    """Return every hypothesis as a cause, sized by the residuals of a linear fit, the surest first.

    The unknowns and priors are those of the fit; a step in the direction of a hypothesis is free.
    With H and g, the normal matrix and the gradient of the richest problem at the fit, the best
    step of the unknowns for each step of the hypothesis is eliminated.
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
    richest = _Richest(groups, tuple(states), None, RICHEST, box.facts)
    E = _embedding(box, richest)  # (R, P): from P unknowns to the R of the richest problem
    # Unknowns that only the richest problem has are zero at the fit.
    richest_eta = richest.unknowns_of(estimation.full)
    richest_eta[len(richest.parameters) :] = (E @ eta)[len(richest.parameters) :]
    blocks = linearised(richest, decays, estimation.noise, richest_eta).blocks
    of_data = [block for label, block in blocks.items() if label != PRIORS]  # decays and facts
    H = np.sum([block.information for block in of_data], axis=0)
    g = np.sum([block.gradient for block in of_data], axis=0)
    prior = box.prior_sigma**-2
    covariance = np.linalg.pinv(E.T @ H @ E + np.diag(prior), hermitian=True)  # (P, P)
    # Zero at the optimum, but for rounding and a noise other than that of the fit.
    step = covariance @ (E.T @ g - prior * eta)

    effects_of: dict[str, list[_Effect]] = {}
    for effect in _effects(box, richest):
        name = TABLE[effect.kind].name.format(effect.label)
        effects_of.setdefault(name, []).append(effect)
    n_values = sum(decay.n_values for decay in decays)
    causes = []
    for name, effects in effects_of.items():
        D = np.zeros((len(richest_eta), len(effects)))  # (R, k): a column for each effect
        for k, effect in enumerate(effects):
            D[list(effect.direction), k] = list(effect.direction.values())
        mixed = D.T @ H @ E  # (k, P): of the effects with the unknowns of the fit
        information = D.T @ H @ D  # (k, k), of which the unknowns leave what is `remaining`
        gradient = D.T @ g - mixed @ step
        remaining = information - mixed @ covariance @ mixed.T
        scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
        values, vectors = np.linalg.eigh(remaining * np.outer(scale, scale))
        testable = values > 1e-9  # a smaller part of the effects' information is rounding
        axes = vectors[:, testable]
        inverse = (axes / values[testable]) @ axes.T * np.outer(scale, scale)  # covariance, (k, k)
        sizes, stds = inverse @ gradient, np.sqrt(np.diag(inverse))
        gain = float(gradient @ sizes)
        moved = (-covariance @ mixed.T @ sizes)[: len(box.parameters)].tolist()
        kind = effects[0].kind
        # So large by noise alone in one of a million cases; a session has some forty.
        chance = exceeded_by_chance(len(effects), 1e-6)
        strength = gain / max(1.0, estimation.chi2_per_n) / chance
        if kind == "tyre damping":
            # Every tyre has some, so that one case in a thousand is enough.
            below_zero = bool((sizes < -BELOW_SIGMAS * stds).any())
            strength = 0.0 if below_zero else 2.0 * strength
        elif kind == "late" and sizes[0] < 0.0:
            strength *= 0.98  # the lateness of the others explains the same: name that instead
        causes.append(
            replace(
                TABLE[kind],
                kind=kind,
                name=name,
                sizes=_in_words(effects, sizes, stds),
                explained=gain / max((estimation.chi2_per_n - 1.0) * n_values, 1e-9),
                moved=dict(zip(box.parameters, moved, strict=True)),
                subject=effects[0].label,
                gain=gain,
                strength=strength,
            )
        )
    return tuple(sorted(causes, key=lambda cause: -cause.strength))


def _embedding(box: GreyBox, richest: GreyBox) -> Real:
    """Return the matrix from the P unknowns of a problem to the R of the richest one, (R, P).

    A parameter of both sides is two there; a cross weight (if corners are weighed) is last in both.
    """
    E = np.zeros((len(richest.prior_sigma), len(box.prior_sigma)))
    for p, name in enumerate(box.parameters):
        sides = [name] if name in richest.parameters else [f"{name}l", f"{name}r"]
        E[[richest.parameters.index(side) for side in sides], p] = 1.0
    names = [*richest.parameters, *richest.corrections]
    for p, name in enumerate(box.corrections, len(box.parameters)):
        index = names.index(name)
        names[index] = ""  # two groups of one clock have one name
        E[index, p] = 1.0
    if len(box.prior_sigma) > len(box.parameters) + len(box.corrections):
        E[-1, -1] = 1.0
    return E


def _effects(box: GreyBox, richest: _Richest) -> Iterator[_Effect]:
    """Yield what `box` lacks of the richest problem, then errors of lengths, weights, sensors."""
    index_of = {name: i for i, name in enumerate(richest.parameters)}
    kind_of_parameter = {"k_a": "bars", "c_t": "tyre damping", "y_s": "cg"}
    for name, scale in SIGNED.items():
        if name not in box.parameters:
            kind, direction = kind_of_parameter[name[:3]], {index_of[name]: 1.0}
            yield _Effect(kind, name, parameter_unit(name), scale, direction)
    if box.structure.symmetric:
        for name in ("m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "c_sf", "c_sr"):
            sides = {index_of[f"{name}l"]: 1.0, index_of[f"{name}r"]: -1.0}  # 2 apart
            yield _Effect("sides", name, "% more left than right", 200.0, sides)
    if box.geometry is not None:
        for name in ("a", "b", "t_f", "t_r"):
            yield _Effect("length", name, "%", 100.0, {index_of[name]: 1.0})
    # Decays alone do not show a factor that all weights have in common.
    if richest.weight_masses and scale_facts(box):
        yield _Effect("weights", "all weights", "%", 100.0, richest.weight_masses)
    # A clock may be late, or all of a kind of sensors; a kind's sole clock bears the kind's name.
    # A kind of which a clock has other sensors as well is no name of it.
    late: dict[str, dict[int, float]] = {}  # delays by clock or kind
    kinds: dict[str, set[str]] = {}  # of the sensors of each clock
    for i, group in enumerate(richest.groups):
        delay = richest.delay_index(i)
        if delay is not None:
            late.setdefault(group.name, {})[delay] = 1.0
            kinds.setdefault(group.name, set()).update(map(kind_of_sensor, group.channels))
    for kind in sorted(set[str]().union(*kinds.values())):
        clocks = [name for name, of_clock in kinds.items() if kind in of_clock]
        if all(kinds[name] == {kind} for name in clocks):
            take = late.pop if len(clocks) == 1 else late.__getitem__
            late[kind] = dict(ChainMap(*map(take, clocks)))
    for name, delays in late.items():
        yield _Effect("late", name, "ms", 1e3, delays)
    for i, channel in richest.fitted_gains.items():
        yield _Effect("gain", channel.name, "% too much", 100.0, {i: 1.0})
    for name, i in richest.index_of_turn.items():
        yield _Effect("turn", name, "deg", 180.0 / np.pi, {i: 1.0})


def _in_words(effects: Sequence[_Effect], sizes: Real, stds: Real) -> str:
    """Write the sizes of the three surest effects of a cause with their 95 % intervals."""
    parts = []
    for effect, size, std in zip(effects, sizes.tolist(), stds.tolist(), strict=True):
        if std > 0.0:
            half_interval = COVERAGE_95 * std * abs(effect.factor)
            part = f"{effect.label} {with_half(size * effect.factor, half_interval)} {effect.unit}"
            parts.append((abs(size / std), part))
    return ", ".join(part for _, part in sorted(parts, reverse=True)[:3])


# Whether all runs, and the large and the small motion, show the same vehicle ----------------------


class Disagreement(NamedTuple):
    """How a part of the data disagrees with the optimum of all data."""

    strength: float
    """Its squared gradient there in units of what chance would give; noise stays below 1."""
    parameter: str
    """The parameter with the steepest gradient."""
    change: float
    """Change of its unknown that the part asks for, the others kept (units as in `Cause.moved`)."""

    @property
    def in_words(self) -> str:
        """The parameter and the change that is asked for."""
        size = SIGNED.get(self.parameter)
        unit = parameter_unit(self.parameter) if size else "%"
        digits = 3 if unit == "m" else 0
        return f"({self.parameter} {self.change * (size or 100.0):+,.{digits}f} {unit})"


def disagreement_of(estimation: Estimation, blocks: Sequence[NormalBlock]) -> Disagreement:
    """Return how a part of the data, by its normal equations, disagrees with the optimum of all.

    The gradient of a part is zero there but for noise, whose covariance V weighs it.
    """
    H = np.sum([block.information for block in blocks], axis=0)
    g = np.sum([block.gradient for block in blocks], axis=0)
    covariance = np.where(np.isfinite(estimation.fit.covariance), estimation.fit.covariance, 0.0)
    V = H - H @ covariance @ H  # covariance of the gradient
    diagonal = np.maximum(np.diag(V), 1e-300)
    scale = 1.0 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(V * np.outer(scale, scale))
    informed = values > 1e-6 * values[-1]  # weaker directions have no information
    squared = float(np.sum((vectors[:, informed].T @ (g * scale)) ** 2 / values[informed]))
    # The length of noise in n directions is about sqrt(n), and hardly ever five more.
    by_chance = float(np.sqrt(np.sum(informed)) + 5.0) ** 2 * max(1.0, estimation.chi2_per_n)
    names = estimation.box.parameters
    steepest = int(np.argmax(np.abs((g * scale)[: len(names)])))
    change = float(g[steepest] / diagonal[steepest])
    return Disagreement(squared / by_chance, names[steepest], change)


def _most_odd(estimation: Estimation) -> tuple[tuple[str, ...], Disagreement]:
    """Return the labels of the runs that disagree most with all, and how they do.

    They are one run, or those of a mass state from some repeat on: its weights were changed.
    """
    repeats: dict[str, list[tuple[int, str]]] = {}
    for decay in estimation.decays:
        suffix = decay.label.rpartition("_")[2]
        repeat = int(suffix) if suffix.isdecimal() else 0
        repeats.setdefault(decay.mass_state, []).append((repeat, decay.label))
    suspects: list[tuple[str, ...]] = [(decay.label,) for decay in estimation.decays]
    for runs_of_state in repeats.values():
        for first_odd in sorted({repeat for repeat, _ in runs_of_state})[1:]:
            suspects.append(tuple(label for repeat, label in runs_of_state if repeat >= first_odd))
    blocks = linearised_at(estimation).blocks
    disagreements = [
        (labels, disagreement_of(estimation, [blocks[label] for label in labels]))
        for labels in suspects
    ]
    return max(disagreements, key=lambda pair: pair[1].strength)


def _fit_without(estimation: Estimation, labels: Collection[str]) -> tuple[float, Real]:
    """Return chi2 per degree of freedom of a fit without the labelled runs, and its unknowns."""
    decays = tuple(d.thinned(250.0) for d in estimation.decays if d.label not in labels)
    box, noise = estimation.box, estimation.noise
    eta = fit(box, decays, noise, estimation.fit.eta, tolerance=0.1, max_iterations=20).eta
    residuals = estimation.engine.residuals(decays, noise, eta)
    freedom = sum(sum(of_run.freedom.values()) for of_run in residuals)
    return sum(of_run.chi2(noise) for of_run in residuals) / freedom, eta


def some_runs_are_wrong(estimation: Estimation) -> bool:
    """Return whether a fit that does not hold would hold without the runs that disagree most.

    Of fewer than three runs none can be called wrong.
    """
    if len(estimation.decays) < 3:
        return False
    labels, _ = _most_odd(estimation)
    return _fit_without(estimation, labels)[0] <= estimation.chi2_limit


def odd_runs(estimation: Estimation, rival: float) -> tuple[Finding, Cause] | None:
    """Return the runs that disagree with all others, as a finding and a cause; None if none does.

    In a fit that holds they must stand out from chance and `rival`, and ask for other parameters;
    else the fit without them must leave at most half of the misfit.  Of fewer than three runs none
    can be odd.

    `rival`: strength of the likeliest cause that all runs share: it may also make runs disagree.
    """
    labels, odd = _most_odd(estimation)
    matters = odd.strength > max(1.0, rival) and abs(odd.change) > _LEAST_CHANGE
    if len(estimation.decays) < 3 or (estimation.holds and not matters):
        return None
    chi2_with, (chi2_without, eta_without) = estimation.chi2_per_n, _fit_without(estimation, labels)
    if not estimation.holds and chi2_without > 1.0 + 0.5 * (chi2_with - 1.0):
        return None
    names = ", ".join(labels)
    both_chi2 = f"chi2/n is {chi2_without:.3f} instead of {chi2_with:.3f}"
    severity = Severity.WARNING
    text = (
        f"run {names} disagrees with the others {odd.in_words}: without it {both_chi2}; reject it "
        "and repeat it, or look for what changed (a second bump, a warm damper, a loose weight)"
    )
    if len(labels) > 1:
        severity = Severity.ERROR  # which of them are wrong is not known
        text = (
            f"runs {names} disagree with the others {odd.in_words}: without them {both_chi2}; "
            "other weights were on the car: give these runs a mass state of their own, or reject "
            "those with the wrong weights"
        )
    steps = (eta_without - estimation.fit.eta).tolist()
    moved = dict(zip(estimation.box.parameters, steps, strict=False))
    explained = 1.0 - (chi2_without - 1.0) / max(chi2_with - 1.0, 1e-9)
    cause = Cause(f"run {names}", explained=explained, moved=moved)
    return Finding("odd_run", severity, text, subject=names, value=chi2_without), cause


def amplitude_findings(estimation: Estimation) -> Iterator[Finding]:
    """Yield a finding where the small motion after the first 0.4 s asks for another vehicle.

    The wheels are then at rest, and the body moves with half its first amplitude.
    """
    small = [
        replace(d, recordings=tuple(r.between(0.4, np.inf) for r in d.recordings))
        for d in estimation.decays
    ]
    small = [d for d in small if all(len(r.time_s) > 50 for r in d.recordings)]  # else too short
    if not small:
        return
    box, eta = estimation.box, estimation.fit.eta
    blocks = linearised(box, tuple(small), estimation.noise, eta).blocks
    small_motion = disagreement_of(estimation, [blocks[d.label] for d in small])
    if small_motion.strength > 1.0 and abs(small_motion.change) >= _LEAST_CHANGE:
        text = (
            f"the small motion after 0.4 s asks for other parameters {small_motion.in_words}: the "
            "vehicle is not linear; look for friction, or compare bumps of two heights"
        )
        yield Finding("amplitude", Severity.WARNING, text)
