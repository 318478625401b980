"""The grey box: from a vector of unknowns to the state matrix and output rows of each mass state.

Unknowns are the parameters of the vehicle (logarithms of those that cannot be negative) and, where
the session states an uncertainty, small corrections to what is nominally known: the place of a body
sensor, the gain of a channel (calibration and motion ratio), the lateness of a channel group, the
mass of a weight and its place.  Each correction carries its standard uncertainty as a prior, so
that it widens the intervals of the parameters as much as it should and no more.  Facts (scales,
tape measure) are data like the samples.  Derivatives are exact, by a complex step.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from daq.channels import ON_BODY, TIME_DERIVATIVE, Channel
from daq.vehicle import (
    BodyWeight,
    Fact,
    HubWeight,
    MassState,
    Structure,
    VehicleGeometry,
    parameter_names,
)
from dbc.frames import read_only

from ..decays.decay import ChannelGroup
from ..model.matrices import (
    COMPLEX_STEP,
    CORNERS,
    SYMMETRIC,
    Complex,
    Full,
    Real,
    delta_mass,
    expansion,
    full_matrices,
    misfits_of,
    motion_row,
    state_matrix,
    stepped,
)

CROSS_SCALE_KG = 10.0
"""Cross weight that counts as one unknown, kg."""
SIGNED = {"k_af": 1e4, "k_ar": 1e4, "c_tf": 100.0, "c_tr": 100.0, "y_s": 0.1}
"""Parameters that may be zero or negative, each with the size that counts as one unknown."""

_DEVIATION_WORDS = {
    "x": (1.0, "m further forward", "m further back"),
    "y": (1.0, "m further left", "m further right"),
    "gain": (100.0, "% too much", "% too little"),
    "delay": (1e3, "ms later", "ms earlier"),
    "": (1.0, "kg heavier", "kg lighter"),
}
"""Size of a correction in words, by its kind: factor to the printed unit, more, and less.  That of
a gain is what the channel shows; the kind without a name is the mass of a weight."""
_WEIGHT_KINDS = ("", "x", "y")
"""Kinds of the corrections of a weight, in the order of `weight_sigmas`."""


@dataclass(frozen=True, slots=True)
class Correction:
    """One thing that is stated with an uncertainty: an unknown whose prior is its sigma."""

    kind: str
    """A key of `_DEVIATION_WORDS`."""
    subject: str
    """Channel, channel group or weight that it is of."""
    sigma: float
    """Standard uncertainty, SI; that of a gain is relative."""

    @property
    def name(self) -> str:
        """Name of what is stated."""
        return f"{self.kind} of {self.subject}" if self.kind else self.subject

    def in_words(self, size: float) -> str:
        """Return how far the true value lies from the stated one, `size` in the unit of sigma."""
        factor, more, less = _DEVIATION_WORDS[self.kind]
        words = f"{abs(size) * factor:.2g} {more if size > 0.0 else less}"
        return f"it shows {words}" if self.kind == "gain" else f"{words} than stated"


@dataclass(frozen=True, slots=True)
class System:
    """One mass state at one point of the unknowns, with its derivatives."""

    A: Real
    """State matrix, shape (14, 14)."""
    dA: Real
    """Its derivative by each unknown, shape (P, 14, 14)."""
    rows: dict[str, Real]
    """Output row of each channel (channel = row . state), each shape (14,)."""
    d_rows: dict[str, Real]
    """Its derivative, each shape (P, 14)."""


@dataclass(frozen=True, slots=True)
class GreyBox:
    """Structure of the problem: what is unknown, and how it enters.

    `names`: all parameters of the structure.  `parameters`: those that are unknown; they are the
    first unknowns, in this order.  `prior_sigma`, (P,) float64: standard uncertainty of each
    unknown before any run; infinite for the parameters.
    """

    groups: tuple[ChannelGroup, ...]
    """Every channel group of the session."""
    mass_states: tuple[MassState, ...]
    geometry: VehicleGeometry | None
    """The four lengths where they are measured; they are then no unknowns."""
    structure: Structure = field(default_factory=Structure)
    facts: tuple[Fact, ...] = ()
    """Measured quantities of the vehicle, each with its standard uncertainty."""
    may_lift: bool = False
    """True if wheels may leave the ground: then the cross weight shows without scales, too."""
    names: tuple[str, ...] = field(init=False)
    parameters: tuple[str, ...] = field(init=False)
    prior_sigma: Real = field(init=False)
    stated: tuple[Correction, ...] = field(init=False)
    """The stated uncertainties: the unknowns after the parameters, in this order."""
    _channels: tuple[Channel, ...] = field(init=False)
    _index: dict[tuple[str, str | int], int] = field(init=False)
    """Position of each correction among the unknowns, by its kind and subject; of a delay, by its
    group: groups of one clock share their name."""

    def __post_init__(self) -> None:
        measured = () if self.geometry is None else ("a", "b", "t_f", "t_r")
        names = parameter_names(self.structure)
        parameters = tuple(name for name in names if name not in measured)
        channels = {c.name: c for group in self.groups for c in group.channels}
        corrections = _corrections(tuple(channels.values()), self.groups, self.mass_states)
        sigmas = [np.inf] * len(parameters) + [c.sigma for c in corrections.values()]
        if self._has_cross_weight:
            sigmas.append(np.inf)
        index = {key: p for p, key in enumerate(corrections, len(parameters))}
        for name, value in (
            ("names", names),
            ("parameters", parameters),
            ("stated", tuple(corrections.values())),
            ("prior_sigma", read_only(np.array(sigmas))),
            ("_channels", tuple(channels.values())),
            ("_index", index),
        ):
            object.__setattr__(self, name, value)

    def with_structure(self, structure: Structure) -> GreyBox:
        """Return the grey box of the same bench for another structure."""
        return replace(self, structure=structure)

    @property
    def _has_cross_weight(self) -> bool:
        """True if the cross weight is an unknown, the last one."""
        return self.may_lift or any(fact.quantity in CORNERS for fact in self.facts)

    @property
    def corrections(self) -> tuple[str, ...]:
        """Names of the stated uncertainties, in the order of the unknowns after the parameters."""
        return tuple(correction.name for correction in self.stated)

    @property
    def fitted_gains(self) -> dict[int, Channel]:
        """Channels whose gain is fitted, by the index of its unknown."""
        indices = {self._index.get(("gain", c.name)): c for c in self._channels}
        return {index: c for index, c in indices.items() if index is not None}

    def deviations(self, eta: Real) -> Real:
        """Return how far each of `corrections` lies from what is stated, in its sigmas."""
        stated = slice(len(self.parameters), len(self.parameters) + len(self.corrections))
        return np.asarray(eta[stated] / self.prior_sigma[stated])

    def unknowns(self, theta: Real) -> Real:
        """Return the vector of unknowns, (P,), for a symmetric vehicle, (15,), no correction."""
        return self.unknowns_of(SYMMETRIC @ theta)

    def unknowns_of(self, full: Real) -> Real:
        """Return the vector of unknowns, (P,), for full parameters, (28,), and no correction.

        One parameter for both corners is their geometric mean; of `SIGNED`, it is the left one's.
        """
        to_full = expansion(self.structure)
        eta = np.zeros(len(self.prior_sigma))
        for i, name in enumerate(self.parameters):
            of_corners = full[to_full[:, self.names.index(name)] > 0]  # of one corner, or of both
            eta[i] = of_corners[0] / SIGNED[name] if name in SIGNED else np.mean(np.log(of_corners))
        return eta

    def values(self, eta: Real) -> Real:
        """Return the value of each parameter of `names`, SI."""
        return self._values(eta.astype(complex)).real

    def parameter_slopes(self, eta: Real) -> Real:
        """Return the derivative of each of `parameters` by its own unknown."""
        # The derivative of exp(x) is exp(x): the value itself.
        values = dict(zip(self.names, self.values(eta).tolist(), strict=True))
        return np.array([SIGNED.get(name, values[name]) for name in self.parameters])

    def full(self, eta: Complex) -> Complex:
        """Return the full parameters, (..., 28), at the unknowns `eta`, (..., P)."""
        return np.asarray(self._values(eta) @ expansion(self.structure).T)

    def _values(self, eta: Complex) -> Complex:
        """Return the value of each parameter of `names`, (..., n_names) SI, at `eta`, (..., P)."""
        values = np.zeros((*eta.shape[:-1], len(self.names)), dtype=complex)
        for i, name in enumerate(self.names):
            if name in self.parameters:
                unknown = eta[..., self.parameters.index(name)]
                scale = SIGNED.get(name)
                values[..., i] = np.exp(unknown) if scale is None else scale * unknown
            elif self.geometry is not None:
                values[..., i] = getattr(self.geometry, name)
        return values

    def delays_s(self, eta: Real) -> Real:
        """Return the lateness of each group beyond its nominal one, (n_groups,) s."""
        indices = [self.delay_index(group) for group in range(len(self.groups))]
        return np.array([0.0 if p is None else eta[p] for p in indices])

    def delay_index(self, group: int) -> int | None:
        """Return the index of the unknown that is a group's lateness, None if it is exact."""
        return self._index.get(("delay", group))

    def systems(self, eta: Real, mass_states: Collection[str]) -> dict[str, System]:
        """Return state matrix, output rows and their derivatives for some mass states."""
        points = stepped(eta)
        full = self.full(points)
        M, C, K = full_matrices(full)
        motion_rows = self.motion_rows(points)
        systems = {}
        for state in (s for s in self.mass_states if s.name in mass_states):
            deviations = self.off_weights(points, state)
            added = delta_mass(state.added, full[:, Full.A], full[:, Full.Y_S], deviations)
            A = state_matrix(M + added, C, K)
            rows = {c.name: _output_row(c, motion_rows[c.name], A) for c in self._channels}
            systems[state.name] = System(
                A[0].real,
                A[1:].imag / COMPLEX_STEP,
                {name: row[0].real for name, row in rows.items()},
                {name: row[1:].imag / COMPLEX_STEP for name, row in rows.items()},
            )
        return systems

    def fact_misfits(self, eta: Real) -> tuple[Real, Real]:
        """Return measured less predicted value of each fact in sigmas, and the slope of the latter.

        Returns (n_facts,) and (n_facts, P).
        """
        points = stepped(eta)
        return misfits_of(self.facts, self.full(points), self.cross_kg(points))

    def cross_kg(self, eta: Complex) -> Complex:
        """Return what the front left corner carries beyond its share, (n,) kg, at `eta`, (n, P)."""
        if not self._has_cross_weight:
            return np.zeros(len(eta), dtype=complex)
        return np.asarray(CROSS_SCALE_KG * eta[:, len(self.prior_sigma) - 1])

    @property
    def weight_masses(self) -> dict[int, float]:
        """Stated mass of each weight that has a sigma, kg, by the index of its unknown."""
        masses_kg = {
            self._index.get(("", _weight_name(state, i))): weight.mass_kg
            for state in self.mass_states
            for i, weight in enumerate(state.added.weights)
        }
        return {index: mass_kg for index, mass_kg in masses_kg.items() if index is not None}

    def off_weights(self, eta: Complex, state: MassState) -> Complex:
        """Return the deviation of each weight of a mass state from its stated mass and place.

        `eta`: unknowns, (n, P).  Returns (n, n_weights, 3): kg, and m forward and to the left.
        """
        deviations = np.zeros((len(eta), len(state.added.weights), 3), dtype=complex)
        for i in range(len(state.added.weights)):
            for k, kind in enumerate(_WEIGHT_KINDS):
                deviations[:, i, k] = self._correction(eta, kind, _weight_name(state, i))
        return deviations

    def _correction(self, eta: Complex, kind: str, subject: str) -> Complex:
        """Return the correction of what is stated, (n,) SI, at `eta`, (n, P); 0 if it is exact."""
        p = self._index.get((kind, subject))
        return np.zeros(len(eta), dtype=complex) if p is None else eta[:, p]

    def motion_rows(self, eta: Complex) -> dict[str, Complex]:
        """Return each channel's row on the seven motions, (n, 7), without its time derivative."""
        full = self.full(eta)
        lengths = full[:, [Full.A, Full.B, Full.T_F, Full.T_R, Full.Y_S]]
        rows = {}
        for channel in self._channels:
            # Stated from the front axle and the middle of the car; here from the CG.
            x, y = channel.x_m + full[:, Full.A], channel.y_m - full[:, Full.Y_S]
            if channel.at_cg:
                x, y = np.zeros_like(x), np.zeros_like(y)
            x = x + self._correction(eta, "x", channel.name)
            y = y + self._correction(eta, "y", channel.name)
            # What the channel shows over the motion: its stated scale over the true one.
            gain = 1.0 + self._correction(eta, "gain", channel.name)
            rows[channel.name] = motion_row(channel, x, y, lengths) * gain[:, None]
        return rows


def _output_row(channel: Channel, row: Complex, A: Complex) -> Complex:
    """Return the output row of a channel on the state (X, dX/dt), (n, 14).

    `row`, (n, 7): on the seven motions.  `A`, (n, 14, 14): gives the accelerations by its lower
    half.
    """
    zero = np.zeros_like(row)
    match TIME_DERIVATIVE[channel.quantity]:
        case 2:
            return np.asarray((row[:, None] @ A[:, row.shape[1] :])[:, 0])
        case 1:
            return np.concatenate([zero, row], axis=-1)
    return np.concatenate([row, zero], axis=-1)


def _corrections(
    channels: Sequence[Channel], groups: Sequence[ChannelGroup], mass_states: Sequence[MassState]
) -> dict[tuple[str, str | int], Correction]:
    """Return what is stated with an uncertainty above zero, by the keys of `GreyBox._index`."""
    corrections: dict[tuple[str, str | int], Correction] = {
        (axis, c.name): Correction(axis, c.name, c.position_sigma_m)
        for c in channels
        if c.quantity in ON_BODY
        for axis in "xy"
    }
    corrections |= {("gain", c.name): Correction("gain", c.name, c.scale_sigma) for c in channels}
    corrections |= {
        ("delay", i): Correction("delay", group.name, group.delay_sigma_s)
        for i, group in enumerate(groups)
    }
    corrections |= {
        (kind, _weight_name(state, i)): Correction(kind, _weight_name(state, i), sigma)
        for state in mass_states
        for i, weight in enumerate(state.added.weights)
        # The weight of a hub has no place.
        for kind, sigma in zip(_WEIGHT_KINDS, weight_sigmas(weight), strict=False)
    }
    return {key: correction for key, correction in corrections.items() if correction.sigma > 0}


def weight_sigmas(weight: BodyWeight | HubWeight) -> tuple[float, ...]:
    """Return the standard uncertainty of mass, kg, and of place forward and to the left, m."""
    if isinstance(weight, BodyWeight):
        return weight.sigma_kg, weight.position_sigma_m, weight.position_sigma_m
    return (weight.sigma_kg,)


def _weight_name(state: MassState, index: int) -> str:
    """Return how a weight of a mass state is named; `index`: from 0."""
    return f"weight {index + 1} of state {state.name}"
