"""Defines a channel: which physical quantity a signal is, and how its sensor is mounted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from math import hypot
from typing import Annotated

from annotated_types import Ge, Gt, Interval, Le, MaxLen
from pydantic import BeforeValidator

from .vehicle import BY_TAPE_M, DOF, Corner


class Quantity(StrEnum):
    """Physical quantities that the method can use, all vertical (z up) or about x and y."""

    BODY_ACCELERATION = "body_acceleration"
    """Vertical acceleration of a body point, m/s2."""
    PITCH_RATE = "pitch_rate"
    ROLL_RATE = "roll_rate"
    PITCH_ACCELERATION = "pitch_acceleration"
    ROLL_ACCELERATION = "roll_acceleration"
    HUB_ACCELERATION = "hub_acceleration"
    """Vertical acceleration of a wheel hub, m/s2."""
    SUSPENSION_TRAVEL = "suspension_travel"
    """Wheel heave minus body heave at the corner, m: positive in compression."""
    BODY_DISPLACEMENT = "body_displacement"
    HUB_DISPLACEMENT = "hub_displacement"
    UNUSED = "unused"
    """Recorded but not used by the identification (a yaw rate, a longitudinal acceleration)."""


SI_UNITS = {
    Quantity.BODY_ACCELERATION: "m/s2",
    Quantity.PITCH_RATE: "rad/s",
    Quantity.ROLL_RATE: "rad/s",
    Quantity.PITCH_ACCELERATION: "rad/s2",
    Quantity.ROLL_ACCELERATION: "rad/s2",
    Quantity.HUB_ACCELERATION: "m/s2",
    Quantity.SUSPENSION_TRAVEL: "m",
    Quantity.BODY_DISPLACEMENT: "m",
    Quantity.HUB_DISPLACEMENT: "m",
}

_ORDERS = {"m/s2": 2, "rad/s2": 2, "rad/s": 1, "m": 0}
TIME_DERIVATIVE = {quantity: _ORDERS[unit] for quantity, unit in SI_UNITS.items()}
"""Order of each quantity as a time derivative of a displacement."""

LARGEST = 1e6
"""Largest magnitude of a reading, in the SI unit of any quantity: 100 000 g in m/s2; a sensor whose
signal is in the thousandth of the stated unit, or in the counts of 16 bits, stays below."""

ON_BODY = frozenset({Quantity.BODY_ACCELERATION, Quantity.BODY_DISPLACEMENT})
AT_CORNER = frozenset(
    {Quantity.HUB_ACCELERATION, Quantity.SUSPENSION_TRAVEL, Quantity.HUB_DISPLACEMENT}
)

# Limits hold for what a person writes: a larger value is in the wrong unit.
_PlaceM = Annotated[float, Interval(ge=-20, le=20)]


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured quantity, in bench.toml a `[[channel]]`.

    The stored value is ``sign * gain * SI(signal) / motion_ratio - tare``.
    """

    name: str
    """Name, unique in a session."""
    quantity: Quantity
    unit: str = ""
    """SI unit of the stored value; empty: that of the quantity."""
    signal: str = ""
    """`Message.signal` in the DBC, or the column of a file; empty for data of neither."""
    corner: Corner | None = None
    """Corner, for quantities at a wheel; may be given as text: ``"FL"``."""
    x_m: _PlaceM = 0.0
    """Mounting position on the body, forward from the middle of the front axle (`daq.vehicle`)."""
    y_m: _PlaceM = 0.0
    """Mounting position, to the left."""
    position_sigma_m: Annotated[float, Interval(ge=0, le=1)] = 0.0
    """Standard uncertainty of x_m and y_m; 0: it is not stated (`placed`)."""
    at_cg: bool = False
    """True if the position is about the CG, wherever that is; x_m and y_m are then ignored."""
    sign: float = 1.0
    """Polarity of the sensor, +1 or -1."""
    gain: Annotated[float, Gt(0)] = 1.0
    """Scale factor that corrects the sensor."""
    gain_sigma: Annotated[float, Interval(ge=0, le=0.3)] = 0.0
    """Relative standard uncertainty of the sensor's scale (from its data sheet); 0 means exact."""
    tare: float = 0.0
    """Reading to be subtracted, in the unit of the channel."""
    motion_ratio: Annotated[float, Gt(0), Le(10)] = 1.0
    """Ratio of the sensor's travel to the wheel's travel, for a suspension travel."""
    motion_ratio_sigma: Annotated[float, Ge(0)] = 0.0
    """Standard uncertainty of the motion ratio; 0 means exact."""
    delay_s: Annotated[float, Interval(ge=-1, le=1)] = 0.0
    """Known delay of the sensor, s (data sheet)."""
    delay_sigma_s: Annotated[float, Interval(ge=0, le=1)] = 0.0
    low_pass_hz: Annotated[float, Ge(0)] = 0.0
    """Cut-off frequency (-3 dB) of the sensor's Butterworth low-pass (data sheet), Hz; 0: none."""
    low_pass_order: Annotated[int, Interval(ge=1, le=8)] = 2
    signal_unit: Annotated[str, MaxLen(16)] = ""
    """Unit of the signal if the DBC states none or a wrong one; empty: as in the DBC."""
    serial_number: Annotated[str, MaxLen(60)] = ""
    calibrated: Annotated[str, BeforeValidator(str)] = ""  # TOML reads a day as a date
    """Day of its last calibration, ISO 8601; empty if it is not known."""

    def __post_init__(self) -> None:
        for name, kind in (("quantity", Quantity), ("corner", Corner)):
            value = getattr(self, name)
            if name == "quantity" or value is not None:
                if value not in set(kind):
                    problem = f"no {name} is {value!r} (it is one of {', '.join(kind)})"
                    raise ValueError(f"channel {self.name}: {problem}")
                object.__setattr__(self, name, kind(value))
        unit = SI_UNITS.get(self.quantity, self.unit)
        if self.unit not in ("", unit):
            raise ValueError(f"channel {self.name}: {self.quantity} is in {unit}, not {self.unit}")
        object.__setattr__(self, "unit", unit)
        if (self.quantity in AT_CORNER) != (self.corner is not None):
            need = "needs a" if self.quantity in AT_CORNER else "has no"
            raise ValueError(f"channel {self.name}: {self.quantity} {need} corner")

    def placed(self) -> Channel:
        """Return the channel with an uncertainty of its place: no place on a body is exact.

        Where none is stated it is that of a tape measure, or 0.2 m at the CG, which is not known.
        """
        if self.position_sigma_m or self.quantity not in ON_BODY:
            return self
        return replace(self, position_sigma_m=0.2 if self.at_cg else BY_TAPE_M)

    @property
    def scale(self) -> float:
        """Factor from the SI value of the signal to that of the channel, without the polarity."""
        return self.gain / self.motion_ratio

    @property
    def scale_sigma(self) -> float:
        """Relative standard uncertainty of that factor: of the gain and of the motion ratio."""
        return hypot(self.gain_sigma, self.motion_ratio_sigma / self.motion_ratio)


def paper_channels() -> tuple[Channel, ...]:
    """Return the seven accelerations of the paper, named as the degrees of freedom (`DOF`)."""
    body = (
        Channel("z_s", Quantity.BODY_ACCELERATION, "m/s2", at_cg=True),
        Channel("theta", Quantity.PITCH_ACCELERATION, "rad/s2"),
        Channel("phi", Quantity.ROLL_ACCELERATION, "rad/s2"),
    )
    hubs = (
        Channel(name, Quantity.HUB_ACCELERATION, "m/s2", corner=corner)
        for name, corner in zip(DOF[3:], Corner, strict=True)
    )
    return (*body, *hubs)


# Splits names of signals: ``Message.signal``, or ``sensor.Message.signal`` on a bench of sensors --
#
# Names of sensors and signals hold no dot.


def message_of(signal: str) -> str:
    """Return the name of the message that carries a signal."""
    return signal.rpartition(".")[0]


def signal_of(signal: str) -> str:
    """Return the name of a signal within its message."""
    return signal.rpartition(".")[2]


def sensor_of(message: str) -> str:
    """Return the name of the sensor that sends a message; empty on a bench with one DBC."""
    return message.rpartition(".")[0]
