"""The classes of the planner: sensors, runs, and a bench session that is planned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from daq.channels import SI_UNITS, Channel, Quantity
from daq.runs import Excitation
from daq.vehicle import Fact, MassState, Structure, VehicleGeometry
from dbc.errors import InputError
from dbc.frames import read_only

from ..model.matrices import FULL_NAMES, SYMMETRIC
from ..model.response import Bump
from ..nonlinear.car import KINDS, KNEE_M_S, Model
from ..nonlinear.forces import MOUNT_LABEL, Forces
from ..nonlinear.laws import knee, secant_share
from ..nonlinear.release import BY_NAME

# The nonlinear elements that a planner expects: friction, damper curves, mounts, stops ------------

USUAL_ELEMENTS = ("anti_roll_bars", "friction", "one_sided_dampers", "damper_knees")
"""Elements of every real car, as in `[vehicle.structure]`."""
_FRICTION_N = 50.0
_COMPRESSION, _REBOUND, _BEYOND, _KNEE_M_S = 0.73, 1.27, 0.6, 0.15
"""A usual damper: slopes over its coefficient in compression and in rebound, share of them beyond
the knee, and speed of the knee, m/s."""
_FASTEST_M_S = 0.6
"""Speed, m/s, up to which a curve is fitted by knees: what bumps of 50 mm reach."""
_END_SHARES = 10.0
"""Number of equal parts of a curve; the slope of the last part continues beyond its end."""
_TYPICAL = {
    "damper_mounts": {"s_m": 1e-6},
    "bump_stops": {"k_b": 1e5, "g_b": 0.025},
    "progressive_springs": {"k_2": 3e4},
    "progressive_tyres": {"b_t": 2.0},
}
_C_S = slice(FULL_NAMES.index("c_sfl"), FULL_NAMES.index("c_srr") + 1)
Curve = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Speeds, m/s, compression positive, and forces of a damper, N, (n,) each."""


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedElements:
    """Elements of the expected car; compared by identity, so that runs are computed once for it."""

    unknown: tuple[str, ...] = USUAL_ELEMENTS
    """Groups that the campaign has to determine, as in `[vehicle.structure]`."""
    values: Mapping[str, float] = field(default_factory=dict)
    """Values by the names of `identify.nonlinear.car`, SI; an element that is not named is
    absent."""
    curves: tuple[Curve, Curve] | None = None
    """Damper curves of the front and the rear axle; None: straight, by c_s."""
    knots: str = "K3"
    """Set of knees for the curves, a key of `identify.nonlinear.car.KNOTS`."""


def element_label(name: str) -> str:
    """Return the unknown of an axle in words: `front friction` of `F_cf`."""
    label = next(label for label, kind in KINDS.items() if kind == name[:-1])
    words = "compliance of the mount" if label == MOUNT_LABEL else label.replace("_", " ")
    return f"{'front' if name[-1] == 'f' else 'rear'} {words}"


def unknowns_with(
    model: Model, expected: ExpectedElements, vehicle: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return all unknowns of a model, (P,), at a vehicle, (28,), with its elements."""
    eta = model.unknowns(model.box.unknowns_of(vehicle))
    places = {name: i for i, name in enumerate(model.names)}
    values = dict(expected.values)
    for axle, curve in zip("fr", expected.curves or (), strict=False):
        c_s = _secants(vehicle)["fr".index(axle)]
        for j, bend in enumerate(_bends_of(curve, c_s, model.knots)):
            values[f"h_{axle}{j + 1}"] = bend
    for element in model.elements:
        if element.name in values:
            value = float(np.clip(values[element.name], element.low, element.high))
            eta[places[element.name]] = element.unknown(value)
    return eta


def _secants(vehicle: NDArray[np.float64]) -> tuple[float, float]:
    """Return c_s of the front and the rear axle, N s/m, of a vehicle, (28,)."""
    front, rear = vehicle[_C_S].reshape(2, 2).mean(axis=1).tolist()
    return front, rear


def _bends_of(curve: Curve, c_s: float, knots: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the change of slope at each knot, N s/m, that is nearest to a curve."""
    speed = np.linspace(-_FASTEST_M_S, _FASTEST_M_S, 241)
    force = _continued(curve, speed)
    columns = [knee(speed, at, KNEE_M_S) - secant_share(at, KNEE_M_S) * speed for at in knots]
    return np.asarray(np.linalg.lstsq(np.stack(columns, axis=1), force - c_s * speed)[0])


def _continued(curve: Curve, speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a curve's force at any speeds: beyond its ends it continues as a straight line.

    A measured curve ends where the speeds of the decays end; knees beyond would be random.
    """
    known, force = curve
    near = np.clip(speed, known[0], known[-1])
    step = (known[-1] - known[0]) / _END_SHARES
    result = np.interp(near, known, force)
    for end, inside in ((known[0], known[0] + step), (known[-1], known[-1] - step)):
        low, high = np.interp([end, inside], known, force)
        beyond = speed < end if end < inside else speed > end
        result = result + np.where(beyond, (low - high) / (end - inside) * (speed - end), 0.0)
    return np.asarray(result)


def typical_elements(unknown: tuple[str, ...], vehicle: NDArray[np.float64]) -> ExpectedElements:
    """Return elements of usual size for a vehicle, (28,), with the given groups unknown."""
    values: dict[str, float] = {}
    for axle in "fr":
        values |= {f"F_c{axle}": _FRICTION_N} if "friction" in unknown else {}
        for group, usual in _TYPICAL.items():
            if group in unknown:
                values |= {f"{kind}{axle}": value for kind, value in usual.items()}
    bent = {"one_sided_dampers", "damper_knees"} & set(unknown)
    front, rear = _secants(vehicle)
    curves = (_usual_curve(front), _usual_curve(rear)) if bent else None
    return ExpectedElements(unknown, values, curves)


def _usual_curve(c_s: float) -> Curve:
    speed = np.linspace(-_FASTEST_M_S, _FASTEST_M_S, 241)
    slope = np.where(speed < 0.0, _REBOUND, _COMPRESSION) * c_s
    near = np.clip(speed, -_KNEE_M_S, _KNEE_M_S)
    return speed, slope * (near + _BEYOND * (speed - near))


def identified_elements(forces: Forces) -> ExpectedElements:
    """Return the elements that an identification of a car kept of those that it tried."""
    kept = tuple(choice.name for choice in forces.choices if choice.kept)
    there = {kind for name in kept for kind in BY_NAME[name].kinds}
    values: dict[str, float] = {}
    for axle, found in zip("fr", forces.axles, strict=True):
        for label, estimate in found.values.items():
            kind = KINDS[label]
            if kind in there:
                value = 1.0 / estimate.value if label == MOUNT_LABEL else estimate.value
                values[f"{kind}{axle}"] = value
    front, rear = ((f.damper.speed_m_s, f.damper.force_n) for f in forces.axles)
    return ExpectedElements(kept, values, (front, rear), "K3")


# The design ---------------------------------------------------------------------------------------

TYPICAL_NOISE: Mapping[Quantity, float] = MappingProxyType(
    {
        Quantity.BODY_ACCELERATION: 0.03,
        Quantity.PITCH_RATE: float(np.radians(0.1)),
        Quantity.ROLL_RATE: float(np.radians(0.1)),
        # Of two body accelerations 1.4 m apart.
        Quantity.PITCH_ACCELERATION: 0.03,
        Quantity.ROLL_ACCELERATION: 0.03,
        Quantity.HUB_ACCELERATION: 0.15,
        Quantity.SUSPENSION_TRAVEL: 0.2e-3,
        Quantity.BODY_DISPLACEMENT: 0.2e-3,
        Quantity.HUB_DISPLACEMENT: 0.2e-3,
    }
)
"""Noise of one sample, rms, SI, that a usual sensor of each quantity has on a usual car."""

_RATES_HZ = (40.0, 5_000.0)  # four times the wheel modes; more than any sensor of a car


@dataclass(frozen=True, slots=True)
class Sensor:
    """A channel, with the noise and rate of its samples."""

    channel: Channel
    """Quantity and place of the sensor."""
    noise: float
    """Standard deviation of the white noise of one sample, SI."""
    rate_hz: float
    """Samples a second."""

    def __post_init__(self) -> None:
        where = f"channel {self.channel.name}"
        lowest, highest = _RATES_HZ
        if not lowest <= self.rate_hz <= highest:
            what = f"{self.rate_hz:g} samples a second"
            raise InputError(where, what, f"plan with {lowest:g} to {highest:g}")
        if not 0.0 < self.noise < np.inf:
            raise InputError(where, f"noise of {self.noise:g}", "give one above 0")


def full_vector(parameters: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the parameters of a vehicle of any structure, (28,), by their names.

    A name without a side sets both corners; parameters that are not named are zero.
    """
    values = [parameters.get(name, parameters.get(name[:-1], 0.0)) for name in FULL_NAMES]
    return np.array(values)


def sensor(channel: Channel, rate_hz: float) -> Sensor:
    """Return a sensor with the usual noise of its quantity (`TYPICAL_NOISE`)."""
    return Sensor(channel, TYPICAL_NOISE[channel.quantity], rate_hz)


def sensors_of(channels: Iterable[Channel], rate_hz: float) -> tuple[Sensor, ...]:
    """Return the sensors of all used channels, with the usual noise, all at one rate."""
    return tuple(sensor(c, rate_hz) for c in channels if c.quantity in SI_UNITS)


@dataclass(frozen=True, slots=True)
class Runs:
    """Some runs that are alike."""

    mass_state: str
    """Name of the mass state."""
    excitation: Excitation
    """Kind of bump."""
    repeats: int = 1
    """Number of repeats."""
    height_m: float | None = None
    """Height of their bump, m; None: that of the plan."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A planned bench session.

    Raises InputError if there is no sensor, a channel or a mass state is named twice, a run is in
    an unknown mass state, or a height or time is not positive.
    """

    vehicle: NDArray[np.float64]
    """Expected parameters: those of the symmetric vehicle in the order of
    `daq.vehicle.PARAMETER_NAMES`, or all of `identify.model.matrices.FULL_NAMES`; stored as the
    latter."""
    sensors: tuple[Sensor, ...]
    """Sensors of every run."""
    mass_states: tuple[MassState, ...]
    """Loading of the vehicle, with the weights."""
    runs: tuple[Runs, ...]
    """Runs to be recorded."""
    bump: Bump = field(default_factory=lambda: Bump(height_m=0.05))
    """Height and duration of the bump; its start does not matter."""
    decay_s: float = 2.5
    """Recorded duration of each free decay, from the end of the bump, s."""
    geometry: VehicleGeometry | None = None
    """The four lengths where they are measured beforehand; their values are those of `vehicle`."""
    structure: Structure = field(default_factory=Structure)
    """Structure of the vehicle: the parameters to be identified."""
    facts: tuple[Fact, ...] = ()
    """Readings of scales and tape measure; only their uncertainty counts."""
    elements: ExpectedElements | None = None
    """Friction, damper curves and further elements of a real car; None for a linear one.  They then
    determine, instead of `structure`, which of the bars, tyre damping and CG offset are unknown."""

    def __post_init__(self) -> None:
        given = np.array(self.vehicle, dtype=float)
        full = SYMMETRIC @ given if given.shape == SYMMETRIC.shape[1:] else given
        if full.shape != (len(FULL_NAMES),):
            raise ValueError(f"a vehicle has 15 or {len(FULL_NAMES)} parameters, not {given.shape}")
        object.__setattr__(self, "vehicle", read_only(full))
        if not self.sensors:
            raise InputError("plan", "no sensor that the model knows", "map sensors to quantities")
        for kind, names in (
            ("channel", [s.channel.name for s in self.sensors]),
            ("mass state", [s.name for s in self.mass_states]),
        ):
            twice = [name for name in names if names.count(name) > 1]
            if twice:
                raise InputError("plan", f"{kind} {twice[0]} occurs twice", "name each once")
        strange = {r.mass_state for r in self.runs} - {s.name for s in self.mass_states}
        if strange:
            what = f"runs in the mass state {min(strange)}, which is not described"
            raise InputError("plan", what, "describe its weights")
        for what, value in (
            *((f"a bump of {h * 1e3:g} mm", h) for h in map(self.height_m, self.runs)),
            (f"a bump of {self.bump.height_m * 1e3:g} mm", self.bump.height_m),
            (f"a bump of {self.bump.duration_s:g} s", self.bump.duration_s),
            (f"a free decay of {self.decay_s:g} s", self.decay_s),
        ):
            if not 0.0 < value < np.inf:
                raise InputError("plan", what, "give a size above 0")

    def height_m(self, runs: Runs) -> float:
        """Return the height of the bump of some runs, m."""
        return self.bump.height_m if runs.height_m is None else runs.height_m
