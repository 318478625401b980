"""Defines sensors for any car: an inertial unit, hub accelerometers, suspension travels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from daq.channels import Channel, Quantity
from daq.vehicle import Corner

IMU = "IMU"
"""The message of the inertial unit: acceleration of a body point, roll and pitch rate."""
HUBS = ("HUB_Front", "HUB_Rear")
"""The messages of the hub accelerometers, two hubs each."""
TRAVELS = ("SUSP_Front", "SUSP_Rear")
"""The messages of the suspension travels, two corners each."""
MESSAGES = (IMU, *HUBS, *TRAVELS)
"""All devices."""


@dataclass(frozen=True, slots=True)
class Fitting:
    """The fitting of sensors, as known from data sheets and a tape measure."""

    messages: tuple[str, ...] = MESSAGES
    """The fitted devices, of `MESSAGES`."""
    imu_m: tuple[float, float] = (-1.05, 0.12)
    """Position of the inertial unit from the middle of the front axle: forward, left, m."""
    place_sigma_m: float = 0.0
    """Standard uncertainty of that position, m."""
    delay_s: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Stated delay of each device, s; 0 for devices that are not named."""
    delay_sigma_s: float = 0.0
    """Standard uncertainty of that delay, s."""
    low_pass_hz: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Cut-off frequency of each device's second-order Butterworth low-pass, Hz; none for devices
    that are not named."""


def channels(fitting: Fitting) -> tuple[Channel, ...]:
    """Return the channels of a set of sensors."""
    made = []
    if IMU in fitting.messages:
        x_m, y_m = fitting.imu_m
        place = (x_m, y_m, fitting.place_sigma_m)
        body = Quantity.BODY_ACCELERATION
        made.append(_channel(fitting, "body_acc_z", body, "m/s2", IMU, None, place))
        made.append(_channel(fitting, "roll_rate", Quantity.ROLL_RATE, "rad/s", IMU))
        made.append(_channel(fitting, "pitch_rate", Quantity.PITCH_RATE, "rad/s", IMU))
    at_corners = (
        ("hub_acc", Quantity.HUB_ACCELERATION, "m/s2", HUBS),
        ("travel", Quantity.SUSPENSION_TRAVEL, "m", TRAVELS),
    )
    for stem, quantity, unit, messages in at_corners:
        for corner in Corner:
            message = messages[0] if corner.front else messages[1]
            if message in fitting.messages:
                name = f"{stem}_{corner.lower()}"
                made.append(_channel(fitting, name, quantity, unit, message, corner))
    return tuple(made)


def _channel(
    fitting: Fitting,
    name: str,
    quantity: Quantity,
    unit: str,
    message: str,
    corner: Corner | None = None,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Channel:
    x_m, y_m, sigma_m = place
    return Channel(
        name=name,
        quantity=quantity,
        unit=unit,
        signal=f"{message}.{name}",
        corner=corner,
        x_m=x_m,
        y_m=y_m,
        position_sigma_m=sigma_m,
        delay_s=fitting.delay_s.get(message, 0.0),
        delay_sigma_s=fitting.delay_sigma_s,
        low_pass_hz=fitting.low_pass_hz.get(message, 0.0),
    )
