"""Sensor sets of the studies: which sensors a campaign has, and which are sampled together."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from daq.channels import Channel, Quantity, paper_channels
from daq.vehicle import Corner

from ..decays.decay import ChannelGroup

_IMU = ChannelGroup(
    "imu",
    (
        Channel("imu_z", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.05, y_m=0.0),
        Channel("pitch_rate", Quantity.PITCH_RATE, "rad/s"),
        Channel("roll_rate", Quantity.ROLL_RATE, "rad/s"),
    ),
)
"""IMU on the tunnel, 0.2 m in front of the CG, as on the shipped bench."""

_HUBS = ChannelGroup(
    "hubs", tuple(Channel(f"hub_{c}", Quantity.HUB_ACCELERATION, "m/s2", corner=c) for c in Corner)
)
_TRAVELS = ChannelGroup(
    "travels",
    tuple(Channel(f"travel_{c}", Quantity.SUSPENSION_TRAVEL, "m", corner=c) for c in Corner),
)

SENSOR_SETS: Mapping[str, tuple[ChannelGroup, ...]] = MappingProxyType(
    {
        "paper": (ChannelGroup("acceleration", paper_channels()),),
        "imu+hubs": (_IMU, _HUBS),
        "imu+travels": (_IMU, _TRAVELS),
        "all": (_IMU, _HUBS, _TRAVELS),
    }
)
"""Name to channel groups.  The paper's seven accelerations of the degrees of freedom; an inertial
measurement unit (IMU: acceleration of a body point, pitch and roll rate) with the accelerations of
the four hubs, with the four suspension travels, or with both."""
