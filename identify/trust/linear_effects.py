"""Linear effects that a model may lack, each with the trace of one unit of it in a decay.

Springs, dampers, unequal sides, wrong lengths; sensors that are late or have a wrong gain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import Quantity
from daq.vehicle import RICHEST, MassState, parameter_unit

from ..decays.decay import ChannelGroup
from ..fit.estimation import Estimation
from ..fit.grey_box import SIGNED, GreyBox
from ..fit.varpro import evaluate, motion, slopes
from .scale import scale_facts
from .score_test import FittedDecay

Traces = tuple[NDArray[np.float64], ...]
"""Trace of each of q effects in each recording of a decay."""

WEIGHTS = "added weights off by a common factor"
"""Name of the cause: the scale on which the weights were weighed, or their unit."""
ONE_WEIGHT = "an added weight is wrong"
TYRE_DAMPING = "tyre damping"
TURNED = "IMU turned about z"
_PITCH_AND_ROLL = (
    (Quantity.PITCH_RATE, Quantity.ROLL_RATE),
    (Quantity.PITCH_ACCELERATION, Quantity.ROLL_ACCELERATION),
)
_LATE_S = 0.001


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect."""

    cause: str
    """Suspected cause; several effects may share it (both anti-roll bars)."""
    label: str
    """Name of this effect among those of its cause."""
    unit: str
    """Printed unit of its size."""
    factor: float = 1.0
    """Factor from one unit of the trace to `unit`."""


@dataclass(frozen=True, slots=True)
class Effects:
    """Effects of one kind and how to find their traces."""

    effects: tuple[Effect, ...]
    trace_of: Callable[[FittedDecay], Traces]
    """Returns the traces of one unit of each, on the real basis of the motion, (n_channels, 28, q),
    or sampled."""


def structural(estimation: Estimation, fitted: Sequence[FittedDecay]) -> Effects:
    """Return the springs, dampers, places and differences that the structure does not have.

    `fitted`: the decays with their fits.
    """
    box = estimation.box
    states = tuple(_with_unsure_weights(state) for state in box.mass_states)
    rich = GreyBox(box.groups, states, None, RICHEST)
    n = len(box.parameters)
    stated = dict(zip(box.corrections, estimation.fit.eta[n:].tolist(), strict=False))
    eta = rich.unknowns_of(estimation.full)
    eta[len(rich.parameters) :] = [stated.get(name, 0.0) for name in rich.corrections]
    effects, directions = _lacking(box, rich)
    # All further parameters of the richest structure are zero here: its state matrix is that of the
    # fit.
    points = {
        state: evaluate(rich, eta, state, estimation.noise, modes)
        for state, modes in {one.decay.mass_state: one.at.modes for one in fitted}.items()
    }

    def trace_of(one: FittedDecay) -> Traces:
        at, z = points[one.decay.mass_state], modal_start(one)
        return tuple(slopes(at, r.group, z) @ directions for r in one.decay.recordings)

    return Effects(effects, trace_of)


def _with_unsure_weights(state: MassState) -> MassState:
    """Return a mass state whose weights are all among the unknowns."""
    weights = (replace(w, sigma_kg=w.mass_kg) for w in state.added.weights)
    return replace(state, added=replace(state.added, weights=tuple(weights)))


def _lacking(box: GreyBox, rich: GreyBox) -> tuple[tuple[Effect, ...], NDArray[np.float64]]:
    """Return the effects and the direction of each among the unknowns of the richest structure."""
    effects, columns = [], []

    def add(effect: Effect, **weights: float) -> None:
        column = np.zeros(len(rich.prior_sigma))
        for name, weight in weights.items():
            column[rich.parameters.index(name)] = weight
        effects.append(effect)
        columns.append(column)

    causes = {"k_a": "anti-roll bars", "c_t": TYRE_DAMPING, "y_s": "CG off the middle"}
    for name, scale in SIGNED.items():
        if name not in box.parameters:
            add(Effect(causes[name[:3]], name, parameter_unit(name), scale), **{name: 1.0})
    if box.structure.symmetric:
        for name in ("m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "c_sf", "c_sr"):
            effect = Effect("left and right differ", name, "% more left than right", 200.0)
            add(effect, **{f"{name}l": 1.0, f"{name}r": -1.0})
    if box.geometry is not None:
        for name in ("a", "b", "t_f", "t_r"):
            add(Effect("a length is wrong", name, "%", 100.0), **{name: 1.0})
    weights = {
        f"weight {i} of state {state.name}": weight.mass_kg
        for state in box.mass_states
        for i, weight in enumerate(state.added.weights, start=1)
    }
    every = (*rich.parameters, *rich.corrections)
    together = np.array([weights.get(name, 0.0) for name in every])
    if weights and scale_facts(box):
        effects.append(Effect(WEIGHTS, "all weights", "%", 100.0))
        columns.append(together)
    return tuple(effects), np.array(columns).reshape(-1, len(rich.prior_sigma)).T


def lateness(estimation: Estimation) -> Effects:
    """Return each sensor group's lateness beyond what is stated; also that of all hubs at once."""
    kinds: dict[str, tuple[str, ...]] = {}
    for group in estimation.box.groups:
        kind = "hub sensors" if group.channels[0].corner else "body sensors"
        kinds[kind] = (*kinds.get(kind, ()), group.name)
    names = dict.fromkeys(group.name for group in estimation.box.groups)
    groups: dict[str, tuple[str, ...]] = {name: (name,) for name in names}
    groups |= {kind: members for kind, members in kinds.items() if len(set(members)) > 1}
    effects = tuple(Effect(f"{g} late", g, "ms", _LATE_S * 1e3) for g in groups)

    def trace_of(one: FittedDecay) -> Traces:
        z = modal_start(one)
        traces = []
        for r in one.decay.recordings:
            mine = np.array([r.group.name in members for members in groups.values()], dtype=float)
            traces.append(-_LATE_S * motion(one.at, r.group, z, 1)[..., None] * mine)
        return tuple(traces)

    return Effects(effects, trace_of)


def gains(estimation: Estimation) -> Effects:
    """Return each channel's error of gain."""
    groups = estimation.box.groups
    names = tuple(dict.fromkeys(c.name for group in groups for c in group.channels))
    effects = tuple(Effect(f"gain of {name}", name, "%", 100.0) for name in names)

    def trace_of(one: FittedDecay) -> Traces:
        z = modal_start(one)
        traces = []
        for r in one.decay.recordings:
            own = np.array([[c.name == name for name in names] for c in r.group.channels], float)
            traces.append(motion(one.at, r.group, z, 0)[..., None] * own[:, None])
        return tuple(traces)

    return Effects(effects, trace_of)


def turns(estimation: Estimation) -> Effects:
    """Return the turn about z of each IMU: its pitch and roll then show a part of each other.

    It is positive to the left, as seen from above.
    """
    names = dict.fromkeys(group.name for group in estimation.box.groups if _pitch_and_roll(group))
    effects = tuple(Effect(TURNED, name, "deg", 180.0 / np.pi) for name in names)

    def trace_of(one: FittedDecay) -> Traces:
        z = modal_start(one)
        traces = []
        for r in one.decay.recordings:
            shown = motion(one.at, r.group, z, 0)
            trace = np.zeros((*shown.shape, len(names)))
            for pitch, roll in _pitch_and_roll(r.group):
                q = tuple(names).index(r.group.name)
                trace[pitch, :, q], trace[roll, :, q] = -shown[roll], shown[pitch]
            traces.append(trace)
        return tuple(traces)

    return Effects(effects, trace_of)


def _pitch_and_roll(group: ChannelGroup) -> list[tuple[int, int]]:
    """Return the columns of pitch and roll of a group that has both."""
    at = {channel.quantity: i for i, channel in enumerate(group.channels)}
    return [(at[p], at[r]) for p, r in _PITCH_AND_ROLL if p in at and r in at]


def modal_start(one: FittedDecay) -> NDArray[np.complex128]:
    """Return the fitted initial state of a decay in modal coordinates, (14,)."""
    modes = one.at.modes
    return np.asarray(modes.W @ one.linear.solution[: len(modes.poles)])
