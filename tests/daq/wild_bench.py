"""A bench of three makers' sensors as it is in truth, and a recording of it at rest and pushed.

The databases are ours, of the shape of public ones: two IMUs of one maker on two buses, one of them
on its side; an IMU and hub sensors of another; four nodes of CANopen that one database describes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from daq.bench.config import Bench, bench_codec, parse_bench
from daq.bench.databases import Database, stored_text
from daq.check.push_test import ORDER
from daq.runs import BASELINE
from daq.sim.acts import Acts
from daq.sim.car import SimulatedCar
from daq.sim.ecu import on_the_buses, rig_of, sample
from dbc import FrameBatch

from .sensor_frames import START_NS

_CYCLES = """BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;
BA_DEF_DEF_ "GenMsgCycleTime" {};
"""
IMU_A = """VERSION ""
BU_: Imu
BO_ 2147484416 ImuAcceleration: 8 Imu
 SG_ AccX : 7|16@0- (0.001,0) [0|0] "m.s-2" Imu
 SG_ AccY : 23|16@0- (0.001,0) [0|0] "m.s-2" Imu
 SG_ AccZ : 39|16@0- (0.001,0) [0|0] "m.s-2" Imu
BO_ 2147484417 ImuRate: 8 Imu
 SG_ GyrX : 7|16@0- (0.0001,0) [0|0] "rad.s-1" Imu
 SG_ GyrY : 23|16@0- (0.0001,0) [0|0] "rad.s-1" Imu
 SG_ GyrZ : 39|16@0- (0.0001,0) [0|0] "rad.s-1" Imu
""" + _CYCLES.format(5)
IMU_B = """VERSION ""
BU_: Imu
BO_ 256 Motion_Accel: 8 Imu
 SG_ Accel_Longitudinal : 0|16@1- (0.0002,0) [0|0] "g" Imu
 SG_ Accel_Lateral : 16|16@1- (0.0002,0) [0|0] "g" Imu
 SG_ Accel_Vertical : 32|16@1- (0.0002,0) [0|0] "g" Imu
 SG_ Validity_Accel_Vertical : 48|8@1+ (1,0) [0|0] "g" Imu
 SG_ MsgCounter : 56|8@1+ (1,0) [0|0] "" Imu
BO_ 257 Motion_Rate: 8 Imu
 SG_ Gyro_Rate_Roll : 0|16@1- (0.005,0) [0|0] "degrees/sec" Imu
 SG_ Gyro_Rate_Pitch : 16|16@1- (0.005,0) [0|0] "degrees/sec" Imu
 SG_ Gyro_Rate_Yaw : 32|16@1- (0.005,0) [0|0] "degrees/sec" Imu
 SG_ MsgCounter : 56|8@1+ (1,0) [0|0] "" Imu
BO_ 258 Radar_Front: 8 Imu
 SG_ Radar_FL_Distance : 0|16@1+ (0.01,0) [0|0] "m" Imu
""" + _CYCLES.format(5)
HUBS = """VERSION ""
BU_: Hub
BO_ 272 WheelAccelFront: 5 Hub
 SG_ WheelAccelFL : 0|16@1- (0.01,0) [0|0] "Unit_MeterPerSeconSquar" Hub
 SG_ WheelAccelFR : 16|16@1- (0.01,0) [0|0] "Unit_MeterPerSeconSquar" Hub
 SG_ MsgCounter : 32|8@1+ (1,0) [0|0] "" Hub
BO_ 273 WheelAccelRear: 5 Hub
 SG_ WheelAccelRL : 0|16@1- (0.01,0) [0|0] "Unit_MeterPerSeconSquar" Hub
 SG_ WheelAccelRR : 16|16@1- (0.01,0) [0|0] "Unit_MeterPerSeconSquar" Hub
 SG_ MsgCounter : 32|8@1+ (1,0) [0|0] "" Hub
""" + _CYCLES.format(2)
POT = """VERSION ""
BU_: Pot
BO_ 385 TPDO1: 7 Pot
 SG_ Position_Value : 0|32@1- (0.01,0) [0|0] "mm" Pot
 SG_ Speed_Value : 32|16@1- (1,0) [0|0] "mm/s" Pot
BO_ 1793 Heartbeat: 1 Pot
 SG_ State : 0|8@1+ (1,0) [0|0] "" Pot
""" + _CYCLES.format(5)
DATABASES = (
    Database("imu_a.dbc", IMU_A),
    Database("imu_b.dbc", IMU_B),
    Database("hubs.dbc", HUBS),
    Database("pot.dbc", POT),
)

_HEAD = """
[[bus]]
interface = "udp_multicast"
channel = "239.74.163.21"
bitrate = 500000
[[bus]]
interface = "udp_multicast"
channel = "239.74.163.22"
bitrate = 500000
[campaign]
repeats = 2
"""
_WEIGHTS = [(32.5, 0.14, 0.55), (32.5, 0.14, -0.55), (32.5, -2.64, 0.55), (32.5, -2.64, -0.55)]
_HUB_WEIGHTS = [(4.0, "FL"), (4.0, "FR"), (5.0, "RL"), (5.0, "RR")]
_SENSORS = [
    ("imu_front", "imu_a", 0, 0), ("imu_rear", "imu_a", 1, 0), ("imu_mid", "imu_b", 0, 0),
    ("hubs", "hubs", 0, 0),
    ("node_1", "pot", 1, 0), ("node_2", "pot", 1, 1),
    ("node_3", "pot", 1, 2), ("node_4", "pot", 1, 3),
]  # fmt: skip
COUNTED = (
    "hubs.WheelAccelFront",
    "hubs.WheelAccelRear",
    "imu_mid.Motion_Accel",
    "imu_mid.Motion_Rate",
)
"""Messages with a rolling counter: those of the second maker."""
NODES = {1: "RR", 2: "FL", 3: "FR", 4: "RL"}
"""Where the nodes of CANopen are in truth; no name says so."""
POSITIONS = {"imu_front": (-0.3, 0.1), "imu_rear": (-2.2, -0.1), "imu_mid": (-1.1, 0.0)}
_CHANNELS = [
    # The front IMU lies as it should; the rear one on its side: x up, z backwards, y left.
    ("front_z", "imu_front.AccZ", "body_acceleration", 1),
    ("front_roll", "imu_front.GyrX", "roll_rate", 1),
    ("front_pitch", "imu_front.GyrY", "pitch_rate", 1),
    ("rear_z", "imu_rear.AccX", "body_acceleration", 1),
    ("rear_roll", "imu_rear.GyrZ", "roll_rate", -1),
    ("rear_pitch", "imu_rear.GyrY", "pitch_rate", 1),
    # The other maker's IMU is turned over about its x axis, which points backwards.
    ("mid_z", "imu_mid.Accel_Vertical", "body_acceleration", -1),
    ("mid_roll", "imu_mid.Gyro_Rate_Roll", "roll_rate", -1),
    ("mid_pitch", "imu_mid.Gyro_Rate_Pitch", "pitch_rate", 1),
    ("radar", "imu_mid.Radar_FL_Distance", "unused", 1),
    *((f"hub_{c}", f"hubs.WheelAccel{c}", "hub_acceleration", 1) for c in ("FL", "FR", "RL", "RR")),
    *((f"pot_{n}", f"node_{n}.Position_Value", "suspension_travel", -1) for n in NODES),
]


def _tables() -> str:
    lines = [_HEAD]
    for name, database, bus, offset in _SENSORS:
        lines.append(f'[[sensor]]\nname = "{name}"\ndbc = "{database}.dbc"\nbus = {bus}')
        lines.append(f"id_offset = {offset}")
    for name, signal, quantity, sign in _CHANNELS:
        lines.append(f'[[channel]]\nname = "{name}"\nsignal = "{signal}"')
        lines.append(f'quantity = "{quantity}"\nsign = {sign}')
        if quantity == "body_acceleration":
            x_m, y_m = POSITIONS[signal.partition(".")[0]]
            lines.append(f"x_m = {x_m}\ny_m = {y_m}\nposition_sigma_m = 0.01")
        if quantity == "hub_acceleration":
            lines.append(f'corner = "{name[-2:]}"')
        if quantity == "suspension_travel":
            lines.append(f'corner = "{NODES[int(name[-1])]}"\ntare = -0.12')
    lines += [f'[[message]]\nname = "{name}"\ncounter = "MsgCounter"' for name in COUNTED]
    lines += [f"[[weight]]\nmass_kg = {m}\nx_m = {x}\ny_m = {y}" for m, x, y in _WEIGHTS]
    lines += [f'[[weight]]\nmass_kg = {m}\nhub = "{c}"' for m, c in _HUB_WEIGHTS]
    return "\n".join(lines) + "\n"


TRUTH = _tables()


@cache
def wild_bench() -> Bench:
    """Return the bench as it is in truth."""
    return parse_bench(TRUTH, "truth.toml", Path(), stored_text(DATABASES))


@cache
def rest_and_pushes() -> tuple[FrameBatch, FrameBatch]:
    """Return three seconds of rest, and a push on each corner with rest before each."""
    bench = wild_bench()
    rig = rig_of(bench, bench_codec(bench), SimulatedCar(), 3)
    acts = Acts(bench, rig)
    plan = [(acts.rest(BASELINE), 4.0)]
    for corner in ORDER:
        plan += [(acts.push(BASELINE, corner), 1.2), (acts.rest(BASELINE), 1.0)]
    acts.close()
    rng = np.random.default_rng(5)
    free_ns, begun_s, batches = [START_NS] * 2, 0.0, []
    for act, length_s in plan:
        scene = replace(act.scene, begins_s=begun_s)
        span_s = (begun_s, begun_s + length_s)
        bursts = [sample(rig, sender, scene, span_s, rng) for sender in rig.senders]
        batches.append(on_the_buses(bursts, bench.buses, START_NS, free_ns))
        begun_s = span_s[1]
    frames = FrameBatch.concatenate(batches)
    cut_ns = START_NS + 3_000_000_000
    return frames.select(frames.t_ns < cut_ns), frames.select(frames.t_ns >= cut_ns)
