"""The table of what a linear model may lack, tested on the residuals of a fit.

Springs, dampers and unequal sides; lengths and weights; sensors that are late, turned or have a
wrong gain; friction and dampers that differ in compression and rebound.  At the optimum, an effect
that the model lacks leaves a trace of known shape in the residuals.  Its size, the uncertainty of
that, and the change of the parameters follow from one projection (Lagrange multiplier test, Rao
1948): no other fit is needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE, Channel, Quantity
from daq.vehicle import RICHEST, parameter_unit

from ..decays.decay import ChannelGroup, FreeDecay
from ..fit.estimation import Estimation, linearised_at
from ..fit.grey_box import SIGNED, GreyBox
from ..fit.uncertainty import COVERAGE_95
from ..fit.varpro import Evaluated, evaluate, linear_parts, motion, over_two, slopes
from ..model.chi_squared import exceeded_by_chance
from ..model.matrices import loaded_model, travel_rows
from ..numbers import with_half
from .finding import Cause
from .plausibility import BELOW_SIGMAS
from .statements import scale_facts

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
    Cause(
        "friction in the suspension",
        "bump higher, so that friction counts less, or free the suspension; c_s and k_s hold for "
        "this amplitude only",
        kind="friction",
        nonlinear=True,
    ),
    Cause(
        "dampers stronger in rebound than in compression",
        "the dampers are not linear: c_s is a mean, and the other parameters suffer",
        kind="one-sided",
        nonlinear=True,
    ),
)
TABLE = {row.kind: row for row in _ROWS}

_CHANCE = 1e-6
"""Probability that noise alone gives so large a cause; a session has some forty."""
_TYRE_BAR = 0.5
"""Strength that proves tyre damping: every tyre has some, so that one in a thousand is enough."""
_EARLY_BAR = 0.98
"""Factor on the strength of earliness: lateness of the others explains the same."""
_RATE_HZ = 500.0  # the motion ends at 20 Hz; more samples say little more
_NAMED = 3  # parts of a cause that are listed, the surest first
_SEEN = 1e-9
"""Least share of an effect's information that the unknowns must leave for it to be testable."""
_LATE_S = 0.001
_GRID_S = 0.001
_FRICTION_SPEED_M_S = 0.005
"""Speed, m/s, over which friction changes its sign: a bushing deforms before a seal slides."""
_AXLES = {"front": np.array([1.0, 1.0, 0.0, 0.0]), "rear": np.array([0.0, 0.0, 1.0, 1.0])}
_FORCES = ("friction", "one-sided")


@dataclass(frozen=True, slots=True)
class _Effect:
    """One part of a hypothesis; the parts of a cause are tested together."""

    kind: str
    """Key of `TABLE`."""
    label: str
    """Name of this part among those of its cause."""
    unit: str
    factor: float = 1.0
    """Printed unit of its size, and factor from one unit of its trace to it."""
    unknowns: Mapping[str | int, float] = field(default_factory=dict)
    """Its direction among the unknowns of the richest structure, by name or position."""
    channels: Mapping[tuple[str, str], float] = field(default_factory=dict)
    """Share of a second channel's motion, or of its rate of change, that a first one shows."""

    @property
    def cause(self) -> str:
        return TABLE[self.kind].name.format(self.label)


def kind_of_sensor(channel: Channel) -> str:
    """Return the kind of sensors that a channel belongs to, in words."""
    if channel.corner is None:
        return "body sensors"
    return "hub sensors" if channel.quantity is Quantity.HUB_ACCELERATION else "travel sensors"


def rank_causes(estimation: Estimation) -> tuple[Cause, ...]:
    """Test every hypothesis on the residuals; the one that explains most comes first."""
    box = estimation.box
    # All weights are among the unknowns of the richest structure.
    states = tuple(
        replace(
            state,
            added=replace(
                state.added,
                weights=tuple(replace(w, sigma_kg=w.mass_kg) for w in state.added.weights),
            ),
        )
        for state in box.mass_states
    )
    rich = GreyBox(box.groups, states, None, RICHEST)
    effects = [
        *_missing_parts(box, rich),
        *_sensor_faults(box.groups),
        *(_Effect("friction", axle, "N") for axle in _AXLES),
        *(_Effect("one-sided", axle, "N s/m", 2.0) for axle in _AXLES),
    ]
    normal, n_values = _normal_matrix(estimation, rich, effects)
    P = len(estimation.fit.eta)
    covariance = np.asarray(np.linalg.pinv(normal[:P, :P], hermitian=True))
    mixed, information = normal[P:-1, :P], normal[P:-1, P:-1]
    # The optimum of thinned samples differs slightly from that of all samples.
    gradient = normal[P:-1, -1] - mixed @ covariance @ normal[:P, -1]
    members: dict[str, list[int]] = {}
    for i, effect in enumerate(effects):
        members.setdefault(effect.cause, []).append(i)
    causes = []
    for name, rows in members.items():
        X, g = mixed[rows], gradient[rows]
        remaining = information[np.ix_(rows, rows)] - X @ covariance @ X.T
        scale = 1.0 / np.sqrt(np.maximum(np.diag(information)[rows], 1e-300))
        values, vectors = np.linalg.eigh(remaining * np.outer(scale, scale))
        seen = values > _SEEN
        inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T * np.outer(scale, scale)
        sizes, stds = inverse @ g, np.sqrt(np.diag(inverse))
        gain = float(g @ sizes)
        shift = (-covariance @ X.T @ sizes)[: len(box.parameters)].tolist()
        row = TABLE[effects[rows[0]].kind]
        strength = gain / max(1.0, estimation.chi2_per_n) / exceeded_by_chance(len(rows), _CHANCE)
        if row.kind == "tyre damping":
            below_zero = bool((sizes < -BELOW_SIGMAS * stds).any())
            strength = 0.0 if below_zero else strength / _TYRE_BAR
        elif row.kind == "late" and sizes[0] < 0.0:
            strength *= _EARLY_BAR
        cause = replace(
            row,
            name=name,
            sizes=_in_words([effects[i] for i in rows], sizes, stds),
            explained=gain / max((estimation.chi2_per_n - 1.0) * n_values, 1e-9),
            moved=dict(zip(box.parameters, shift, strict=True)),
            subject=effects[rows[0]].label,
            gain=gain,
            strength=strength,
        )
        causes.append(cause)
    return tuple(sorted(causes, key=lambda cause: -cause.strength))


def _in_words(effects: Sequence[_Effect], sizes: Array, stds: Array) -> str:
    """Return the sizes of the surest parts with their 95 % intervals."""
    rows = [
        (abs(size / std), f"{effect.label} "
         f"{with_half(size * effect.factor, COVERAGE_95 * std * abs(effect.factor))} {effect.unit}")
        for effect, size, std in zip(effects, sizes.tolist(), stds.tolist(), strict=True)
        if std > 0.0
    ]  # fmt: skip
    return ", ".join(text for _, text in sorted(rows, reverse=True)[:_NAMED])


# The effects --------------------------------------------------------------------------------------


def _missing_parts(box: GreyBox, rich: GreyBox) -> Iterator[_Effect]:
    """Yield the springs, dampers, places and differences that a structure does not have.

    `rich`: of the richest structure, its weights unsure.
    """
    kinds = {"k_a": "bars", "c_t": "tyre damping", "y_s": "cg"}
    for name, scale in SIGNED.items():
        if name not in box.parameters:
            yield _Effect(kinds[name[:3]], name, parameter_unit(name), scale, {name: 1.0})
    if box.structure.symmetric:
        for name in ("m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "c_sf", "c_sr"):
            sides: dict[str | int, float] = {f"{name}l": 1.0, f"{name}r": -1.0}
            yield _Effect("sides", name, "% more left than right", 200.0, sides)
    if box.geometry is not None:
        for name in ("a", "b", "t_f", "t_r"):
            yield _Effect("length", name, "%", 100.0, {name: 1.0})
    # Decays alone do not show a factor that all weights have in common.
    if rich.weight_masses and scale_facts(box):
        masses: dict[str | int, float] = dict(rich.weight_masses.items())
        yield _Effect("weights", "all weights", "%", 100.0, masses)


def _sensor_faults(groups: Sequence[ChannelGroup]) -> Iterator[_Effect]:
    """Yield lateness of each group and kind of sensors, gain of each channel, turn of each IMU.

    A turn about z is positive to the left, as seen from above: pitch and roll then show a part of
    each other.
    """
    late: dict[str, list[str]] = {group.name: [] for group in groups}
    kinds: dict[str, dict[str, None]] = {}
    turns: dict[str, dict[tuple[str, str], float]] = {}
    for group in groups:
        late[group.name] += [c.name for c in group.channels]
        kinds.setdefault(kind_of_sensor(group.channels[0]), {})[group.name] = None
        of = {c.quantity: c.name for c in group.channels}
        for a, b in ROTATIONS:
            if a in of and b in of:
                turn = {(of[a], of[b]): -1.0, (of[b], of[a]): 1.0}
                turns[group.name] = turns.get(group.name, {}) | turn
    for kind, names in kinds.items():
        if len(names) > 1:
            late[kind] = [channel for name in names for channel in late[name]]
    for name, channels in late.items():
        shares = {(c, c): -_LATE_S for c in channels}
        yield _Effect("late", name, "ms", 1e3 * _LATE_S, channels=shares)
    for c in dict.fromkeys(c.name for group in groups for c in group.channels):
        yield _Effect("gain", c, "%", 100.0, channels={(c, c): 1.0})
    for name, turn in turns.items():
        yield _Effect("turn", name, "deg", 180.0 / np.pi, channels=turn)


# Their traces in the residuals --------------------------------------------------------------------


def _normal_matrix(
    estimation: Estimation, rich: GreyBox, effects: Sequence[_Effect]
) -> tuple[Array, int]:
    """Return products of unknowns, effects and residuals, everything linear projected out.

    Effects that are sums of the functions of which the motion consists need no samples; those of
    `_FORCES`, which come last, and the residuals are sampled.

    Returns (P + q + 1, P + q + 1), facts and stated uncertainties included, and the number of
    measured values.
    """
    eta, box = estimation.fit.eta, estimation.box
    P, q = len(eta), len(effects)
    misfits, by_fact = box.fact_misfits(eta)
    total = np.zeros((P + q + 1, P + q + 1))
    total[:P, :P] = np.diag(box.prior_sigma**-2) + by_fact.T @ by_fact
    total[:P, -1] = by_fact.T @ misfits - eta * box.prior_sigma**-2
    points = linearised_at(estimation).points
    # The richest structure at the fit: all its further parameters are zero there.
    stated = dict(zip(box.corrections, eta[len(box.parameters) :].tolist(), strict=False))
    rich_eta = rich.unknowns_of(estimation.full)
    rich_eta[len(rich.parameters) :] = [stated.get(name, 0.0) for name in rich.corrections]
    spectra = {state: at.modes for state, at in points.items()}
    rich_points = evaluate(rich, rich_eta, spectra, estimation.noise, spectra)
    parts = [e for e in effects if e.unknowns]
    directions = np.zeros((len(rich.prior_sigma), len(parts)))
    for k, effect in enumerate(parts):
        for name, share in effect.unknowns.items():
            directions[rich.parameters.index(name) if isinstance(name, str) else name, k] = share
    faults = [e for e in effects if e.channels]
    on_motion = len(parts) + len(faults)
    mixes: dict[ChannelGroup, Array] = {}
    """Each fault's matrix from the motion in the channels to what they show, (q, n, n)."""
    decays = [decay.thinned(_RATE_HZ) for decay in estimation.decays]
    for decay, linear in zip(decays, linear_parts(points, decays), strict=True):
        at, size = points[decay.mass_state], len(linear.solution)
        z = at.modes.W @ linear.solution[: len(at.modes.poles)]
        forces = _force_traces(estimation, at, decay, z)
        normal = np.zeros((size + P + q + 1, size + P + q + 1))
        k = size + P + on_motion
        for r, stack, force in zip(decay.recordings, linear.coefficients, forces, strict=True):
            if r.group not in mixes:
                names = [channel.name for channel in r.group.channels]
                mixes[r.group] = np.array(
                    [[[e.channels.get((a, b), 0.0) for b in names] for a in names] for e in faults]
                )
            weight, basis = at.group(r.group).weight[:, None, None], at.basis(r)
            moved = [motion(at, r.group, z, derivative) for derivative in (0, 1)]
            each = np.stack([moved[effect.kind == "late"] for effect in faults])
            J = slopes(at, r.group, z)
            columns = np.zeros((*stack.shape[:2], k))
            columns[:, :, :size] = stack
            columns[:, : J.shape[1], size : size + P] = J
            traces = slopes(rich_points[decay.mass_state], r.group, z) @ directions
            columns[:, : J.shape[1], size + P : k - len(faults)] = traces
            columns[:, : J.shape[1], k - len(faults) :] = np.moveaxis(mixes[r.group] @ each, 0, -1)
            residuals = r.values - basis @ (stack @ linear.solution).T
            sampled = np.concatenate([force, residuals[..., None]], axis=2)
            beside = basis.T @ sampled.swapaxes(0, 1)  # (n_channels, m, forces + 1)
            normal[:k, :k] += over_two(weight * columns, (basis.T @ basis) @ columns)
            normal[:k, k:] += over_two(weight * columns, beside)
            normal[k:, k:] += over_two(sampled * weight[:, 0], sampled)
        normal[k:, :k] = normal[:k, k:].T
        cross = normal[size:, :size]
        total += normal[size:, size:] - cross @ linear.normal_inverse @ cross.T
    return total, sum(decay.n_values for decay in decays)


def _force_traces(
    estimation: Estimation, at: Evaluated, decay: FreeDecay, z: NDArray[np.complex128]
) -> list[Array]:
    """Return what one unit of each of `_FORCES` on each axle adds to each recording.

    Friction, N, and the excess of rebound damping over compression, N s/m, act along the fitted
    motion; what they add to it is computed to first order, by driving the fitted vehicle with them
    from rest.  `z`: initial state in modal coordinates.  Each (n_samples, n_channels, 4).
    """
    upper = at.modes.poles.imag >= 0.0  # one of a conjugate pair stands for both
    poles = at.modes.poles[upper]
    V = at.modes.V[:, upper] * np.where(poles.imag > 0.0, 2.0, 1.0)
    end_s = max(float(at.time_s(r)[-1]) for r in decay.recordings)
    grid = np.arange(0.0, end_s + 2.0 * _GRID_S, _GRID_S)
    travel = travel_rows(estimation.full.astype(complex)).real
    moving = np.exp(np.multiply.outer(grid, poles)) * z[upper]
    speed = (moving @ V[7:].T).real @ travel.T
    laws = (np.tanh(speed / _FRICTION_SPEED_M_S), -np.abs(speed))
    force = np.stack([law * corners for law in laws for corners in _AXLES.values()])
    state = next(s for s in estimation.box.mass_states if s.name == decay.mass_state)
    push = -np.linalg.solve(loaded_model(estimation.full, state.added).M, travel.T)
    # The forces are linear between the points of the grid.
    drive = force @ (at.modes.W[upper, 7:] @ push).T  # (4, n, m)
    s = poles * _GRID_S
    step = np.exp(s)
    driven = (step - 1.0 - s) / s**2 * _GRID_S * drive
    driven[:, 1:] += (step * (s - 1.0) + 1.0) / s**2 * _GRID_S * drive[:, :-1]
    driven[:, 0] = 0.0
    reach = 1
    while reach < len(grid):  # sum of all that came before, in doubling strides
        driven[:, reach:] += step**reach * driven[:, :-reach]
        reach *= 2
    displaced = np.linalg.inv(at.system.A[7:, :7])
    traces = []
    for r in decay.recordings:
        rows = np.array([at.system.rows[c.name] for c in r.group.channels])
        # An accelerometer senses the force itself, not only the motion that the force causes.
        senses = np.array([TIME_DERIVATIVE[c.quantity] == 2 for c in r.group.channels])
        at_once = senses[:, None] * (rows[:, :7] @ displaced @ push)
        shown = (driven @ (rows @ V).T).real + force @ at_once.T  # (4, n, n_channels)
        time_s = at.time_s(r)
        before = np.clip(np.searchsorted(grid, time_s) - 1, 0, len(grid) - 2)
        share = ((time_s - grid[before]) / _GRID_S)[:, None]
        between = shown[:, before] * (1.0 - share) + shown[:, before + 1] * share
        traces.append(np.moveaxis(between, 0, -1))
    return traces
