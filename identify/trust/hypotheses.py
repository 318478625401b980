"""The table of what a linear model may lack, each with the trace of one unit of it in a decay.

Springs, dampers and unequal sides; lengths and weights; sensors that are late, turned or have a
wrong gain; friction and dampers that differ in compression and rebound.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE
from daq.vehicle import RICHEST, MassState, parameter_unit

from ..decays.decay import ChannelGroup, Recording
from ..fit.estimation import Estimation
from ..fit.grey_box import SIGNED, GreyBox
from ..fit.varpro import Evaluated, evaluate, motion, slopes
from ..model.exponentials import real_part, waves
from ..model.matrices import loaded_model, travel_rows
from .faults import LATE_ADVICE, ROTATIONS
from .refit import Kind
from .score_test import FittedDecay, Trace
from .statements import scale_facts

Traces = tuple[NDArray[np.float64], ...]
"""Trace of each of q effects in each recording of a decay."""
_LATE_S = 0.001
_GRID_S = 0.001
_FRICTION_SPEED_M_S = 0.005
"""Speed, m/s, over which friction changes its sign: a bushing deforms before a seal slides."""
_AXLES = (slice(0, 2), slice(2, 4))


_BARS = Kind("anti-roll bars", "set anti_roll_bars = true in [vehicle.structure]")
TYRE_DAMPING = Kind(
    # Every tyre has some, so that it needs less proof than a fault: one in a thousand.
    "tyre damping", "set tyre_damping = true in [vehicle.structure]", bar=0.5
)  # fmt: skip
_CG = Kind("CG off the middle", "set cg_offset = true in [vehicle.structure]")
_SIDES = Kind("left and right differ", "set symmetric = false in [vehicle.structure]")
_LENGTH = Kind(
    "a length is wrong", "measure the lengths of [vehicle.geometry] again, or leave them out"
)
WEIGHTS = Kind("added weights off by a common factor")
"""The scale on which the weights were weighed, or their unit."""
LATE = Kind("{} late", LATE_ADVICE, of_bench=True)
GAIN = Kind("gain of {}", of_bench=True)
_TURNED = Kind(
    "IMU turned about z", "mount it with its x axis along the car, and record again", of_bench=True
)
_FRICTION = Kind(
    "friction in the suspension",
    "bump higher, so that friction counts less, or free the suspension; c_s and k_s hold for "
    "this amplitude only",
    nonlinear=True,
)
_ONE_SIDED = Kind(
    "dampers stronger in rebound than in compression",
    "the dampers are not linear: c_s is a mean, and the other parameters suffer",
    nonlinear=True,
)


@dataclass(frozen=True, slots=True)
class Effect:
    """One column of a hypothesis."""

    kind: Kind
    label: str
    """Name of this effect among those of its cause."""
    unit: str
    """Printed unit of its size."""
    factor: float = 1.0
    """Factor from one unit of the trace to `unit`."""

    @property
    def cause(self) -> str:
        """Name of the cause; several effects may share it (both anti-roll bars)."""
        return self.kind.name.format(self.label)


@dataclass(frozen=True, slots=True)
class _Effects:
    """Effects of one kind and how to find their traces."""

    effects: tuple[Effect, ...]
    trace_of: Callable[[FittedDecay], Traces]
    """Returns the traces of one unit of each, on the real basis of the motion, (n_channels, 28, q),
    or sampled."""


def hypotheses(
    estimation: Estimation, fitted: Sequence[FittedDecay]
) -> tuple[list[Effect], Callable[[FittedDecay], list[Trace]]]:
    """Return every effect, and what returns their traces in each recording of a fitted decay."""
    kinds = [
        _structural(estimation, fitted),
        _lateness(estimation),
        _gains(estimation),
        _turns(estimation),
    ]
    forces = _suspension_forces(estimation)

    def traces_of(one: FittedDecay) -> list[Trace]:
        parts = zip(*(kind.trace_of(one) for kind in kinds), strict=True)
        return [
            Trace(np.concatenate(part, axis=-1), sampled)
            for part, sampled in zip(parts, forces.trace_of(one), strict=True)
        ]

    return [effect for kind in (*kinds, forces) for effect in kind.effects], traces_of


def _structural(estimation: Estimation, fitted: Sequence[FittedDecay]) -> _Effects:
    """Return the springs, dampers, places and differences that the structure does not have."""
    box = estimation.box
    states = tuple(_with_unsure_weights(state) for state in box.mass_states)
    rich = GreyBox(box.groups, states, None, RICHEST)
    n = len(box.parameters)
    stated = dict(zip(box.corrections, estimation.fit.eta[n:].tolist(), strict=False))
    eta = rich.unknowns_of(estimation.full)
    eta[len(rich.parameters) :] = [stated.get(name, 0.0) for name in rich.corrections]
    effects, directions = lacking(box, rich)
    # All further parameters of the richest structure are zero here: its state matrix is that of the
    # fit.
    points = {
        state: evaluate(rich, eta, state, estimation.noise, modes)
        for state, modes in {one.decay.mass_state: one.at.modes for one in fitted}.items()
    }

    def trace_of(one: FittedDecay) -> Traces:
        at, z = points[one.decay.mass_state], _modal_start(one)
        return tuple(slopes(at, r.group, z) @ directions for r in one.decay.recordings)

    return _Effects(effects, trace_of)


def _with_unsure_weights(state: MassState) -> MassState:
    """Return a mass state whose weights are all among the unknowns."""
    weights = (replace(w, sigma_kg=w.mass_kg) for w in state.added.weights)
    return replace(state, added=replace(state.added, weights=tuple(weights)))


def lacking(box: GreyBox, rich: GreyBox) -> tuple[tuple[Effect, ...], NDArray[np.float64]]:
    """Return the effects that a structure lacks, and their directions among the unknowns of `rich`.

    `rich`: of the richest structure, its weights unsure.  Returns q effects and (P, q).
    """
    effects, columns = [], []

    def add(effect: Effect, **weights: float) -> None:
        column = np.zeros(len(rich.prior_sigma))
        for name, weight in weights.items():
            column[rich.parameters.index(name)] = weight
        effects.append(effect)
        columns.append(column)

    causes = {"k_a": _BARS, "c_t": TYRE_DAMPING, "y_s": _CG}
    for name, scale in SIGNED.items():
        if name not in box.parameters:
            add(Effect(causes[name[:3]], name, parameter_unit(name), scale), **{name: 1.0})
    if box.structure.symmetric:
        for name in ("m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "c_sf", "c_sr"):
            effect = Effect(_SIDES, name, "% more left than right", 200.0)
            add(effect, **{f"{name}l": 1.0, f"{name}r": -1.0})
    if box.geometry is not None:
        for name in ("a", "b", "t_f", "t_r"):
            add(Effect(_LENGTH, name, "%", 100.0), **{name: 1.0})
    # Decays alone do not show a factor that all weights have in common.
    if rich.weight_masses and scale_facts(box):
        together = np.zeros(len(rich.prior_sigma))
        for p, mass_kg in rich.weight_masses.items():
            together[p] = mass_kg
        effects.append(Effect(WEIGHTS, "all weights", "%", 100.0))
        columns.append(together)
    return tuple(effects), np.array(columns).reshape(-1, len(rich.prior_sigma)).T


def _lateness(estimation: Estimation) -> _Effects:
    """Return each sensor group's lateness beyond what is stated; also that of all hubs at once."""
    kinds: dict[str, tuple[str, ...]] = {}
    for group in estimation.box.groups:
        kind = "hub sensors" if group.channels[0].corner else "body sensors"
        kinds[kind] = (*kinds.get(kind, ()), group.name)
    names = dict.fromkeys(group.name for group in estimation.box.groups)
    groups: dict[str, tuple[str, ...]] = {name: (name,) for name in names}
    groups |= {kind: members for kind, members in kinds.items() if len(set(members)) > 1}
    effects = tuple(Effect(LATE, g, "ms", _LATE_S * 1e3) for g in groups)

    def trace_of(one: FittedDecay) -> Traces:
        z = _modal_start(one)
        traces = []
        for r in one.decay.recordings:
            mine = np.array([r.group.name in members for members in groups.values()], dtype=float)
            traces.append(-_LATE_S * motion(one.at, r.group, z, 1)[..., None] * mine)
        return tuple(traces)

    return _Effects(effects, trace_of)


def _gains(estimation: Estimation) -> _Effects:
    """Return each channel's error of gain."""
    groups = estimation.box.groups
    names = tuple(dict.fromkeys(c.name for group in groups for c in group.channels))
    effects = tuple(Effect(GAIN, name, "%", 100.0) for name in names)

    def trace_of(one: FittedDecay) -> Traces:
        z = _modal_start(one)
        traces = []
        for r in one.decay.recordings:
            own = np.array([[c.name == name for name in names] for c in r.group.channels], float)
            traces.append(motion(one.at, r.group, z, 0)[..., None] * own[:, None])
        return tuple(traces)

    return _Effects(effects, trace_of)


def _turns(estimation: Estimation) -> _Effects:
    """Return the turn about z of each IMU: its pitch and roll then show a part of each other.

    It is positive to the left, as seen from above.
    """
    names = dict.fromkeys(group.name for group in estimation.box.groups if _pitch_and_roll(group))
    effects = tuple(Effect(_TURNED, name, "deg", 180.0 / np.pi) for name in names)

    def trace_of(one: FittedDecay) -> Traces:
        z = _modal_start(one)
        traces = []
        for r in one.decay.recordings:
            shown = motion(one.at, r.group, z, 0)
            trace = np.zeros((*shown.shape, len(names)))
            for pitch, roll in _pitch_and_roll(r.group):
                q = tuple(names).index(r.group.name)
                trace[pitch, :, q], trace[roll, :, q] = -shown[roll], shown[pitch]
            traces.append(trace)
        return tuple(traces)

    return _Effects(effects, trace_of)


def _pitch_and_roll(group: ChannelGroup) -> list[tuple[int, int]]:
    """Return the columns of pitch and roll of a group that has both."""
    at = {channel.quantity: i for i, channel in enumerate(group.channels)}
    return [(at[p], at[r]) for p, r in ROTATIONS if p in at and r in at]


def _modal_start(one: FittedDecay) -> NDArray[np.complex128]:
    """Return the fitted initial state of a decay in modal coordinates, (14,)."""
    modes = one.at.modes
    return np.asarray(modes.W @ one.linear.solution[: len(modes.poles)])


@dataclass(frozen=True, slots=True)
class _Drives:
    """One unit of each of q forces, on the two corners of an axle."""

    force: NDArray[np.float64]
    """Forces over the time grid, N, shape (q, n, 2)."""
    push: NDArray[np.float64]
    """Acceleration of the degrees of freedom by 1 N at either corner, shape (q, 7, 2)."""
    modal: NDArray[np.complex128]
    """State of the vehicle in modal coordinates, driven from rest, one for each conjugate pair,
    shape (n, q, m)."""
    V: NDArray[np.complex128]
    """Matrix from modal coordinates to the state, which is the real part of the product, shape (14,
    m)."""


def _suspension_forces(estimation: Estimation) -> _Effects:
    """Return friction, N, and excess of rebound damping over compression, N s/m, of each axle.

    They act along the fitted motion; what they add to it is computed to first order, by driving the
    fitted vehicle with them.  Their traces are sampled, (n_samples, n_channels, 4).
    """
    effects = (
        *(Effect(_FRICTION, axle, "N") for axle in ("front", "rear")),
        *(Effect(_ONE_SIDED, axle, "N s/m", 2.0) for axle in ("front", "rear")),
    )
    full = estimation.full
    travel = travel_rows(full.astype(complex)).real
    push = {
        state.name: np.asarray(-np.linalg.solve(loaded_model(full, state.added).M, travel.T), float)
        for state in estimation.box.mass_states
    }

    def trace_of(one: FittedDecay) -> Traces:
        at = one.at
        end = max(float(at.time_s(r)[-1]) for r in one.decay.recordings)
        grid = np.arange(0.0, end + 2.0 * _GRID_S, _GRID_S)
        speed = _speeds(one, grid) @ travel.T
        forces = (np.tanh(speed / _FRICTION_SPEED_M_S), -np.abs(speed))
        pushed = push[one.decay.mass_state]
        drives = _drives(
            at,
            np.stack([force[:, axle] for force in forces for axle in _AXLES]),
            np.stack([pushed[:, axle] for _ in forces for axle in _AXLES]),
        )
        return tuple(_seen(at, r, grid, drives) for r in one.decay.recordings)

    return _Effects(effects, trace_of)


def _speeds(one: FittedDecay, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the fitted velocities of the degrees of freedom, (n, 7)."""
    modes = one.at.modes
    z = _modal_start(one)
    upper = modes.poles.imag >= 0
    share = np.where(modes.poles[upper].imag > 0, 2.0, 1.0)  # a conjugate pair counts twice
    wave = waves(time_s, modes.poles[upper])
    return real_part(wave, modes.V[7:, upper] * (z[upper] * share))


def _drives(at: Evaluated, force: NDArray[np.float64], push: NDArray[np.float64]) -> _Drives:
    """Drive the vehicle from rest with forces, (q, n, 2), linear between the points of the grid."""
    # One of a conjugate pair represents both.
    upper = at.modes.poles.imag >= 0.0
    poles, W = at.modes.poles[upper], at.modes.W[upper, 7:]
    V = at.modes.V[:, upper] * np.where(poles.imag > 0.0, 2.0, 1.0)
    inward = (W @ push).swapaxes(1, 2)  # (q, 2, m)
    s = poles * _GRID_S
    step = np.exp(s)
    now, before = (step - 1.0 - s) / s**2 * _GRID_S, (step * (s - 1.0) + 1.0) / s**2 * _GRID_S
    gains = np.ascontiguousarray(np.concatenate([now * inward, before * inward], axis=1))
    pushed = np.zeros((*force.shape[:2], 4))
    pushed[:, 1:, :2], pushed[:, 1:, 2:] = force[:, 1:], force[:, :-1]
    gained = (pushed @ gains.view(np.float64)).view(np.complex128).swapaxes(0, 1)
    return _Drives(force, push, _driven(gained, step), V)


def _driven(gained: NDArray[np.complex128], step: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return ``z[k] = step z[k - 1] + gained[k]``, (n, q, len(step)), from rest.

    Segments of the grid are driven from rest in parallel; then each continues the one before.
    """
    n, width = len(gained), isqrt(len(gained))
    stretches = -(-n // width)
    z = np.zeros((stretches * width, *gained.shape[1:]), dtype=complex)
    z[:n] = gained
    z = z.reshape(stretches, width, *gained.shape[1:])
    for k in range(1, width):
        z[:, k] += step * z[:, k - 1]
    carried = step ** np.arange(1, width + 1)[:, None]  # (width, len(step))
    for i in range(1, stretches):
        z[i] += carried[:, None] * z[i - 1, -1]
    return z.reshape(stretches * width, *gained.shape[1:])[:n]


def _seen(
    at: Evaluated, recording: Recording, grid: NDArray[np.float64], drives: _Drives
) -> NDArray[np.float64]:
    """Return the driven motions in each channel, (n_samples, n_channels, q)."""
    time = at.time_s(recording)
    channels = recording.group.channels
    rows = np.array([at.system.rows[c.name] for c in channels])
    # An accelerometer senses the force itself, not only the motion that the force causes.
    accelerations = np.array([TIME_DERIVATIVE[c.quantity] == 2 for c in channels])
    displaced = rows[:, :7] @ np.linalg.inv(at.system.A[7:, :7]) * accelerations[:, None]
    at_once = drives.force @ (displaced @ drives.push).swapaxes(1, 2)  # (q, n, n_channels)
    on_grid = real_part(drives.modal, rows @ drives.V) + at_once.swapaxes(0, 1)
    before = np.clip(np.searchsorted(grid, time) - 1, 0, len(grid) - 2)
    share = ((time - grid[before]) / _GRID_S)[:, None, None]
    between = on_grid[before] * (1.0 - share) + on_grid[before + 1] * share
    return np.asarray(between.swapaxes(1, 2))
