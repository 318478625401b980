"""Compares what the planner expects of a real car with the bounds of an independent prototype."""

from __future__ import annotations

import time
from dataclasses import replace

from daq.runs import BASELINE, Excitation
from identify.plan import Plan, sensors_of

from ..identify.nonlinear.truth import channels
from ..identify.plan.real_plans import BOTH, SCALES, TAPE, THREE, deviations, standard_plan

_WARP, _REAR = Excitation.WARP, Excitation.REAR_PITCH


def _at(rate_hz: float, plan: Plan) -> Plan:
    sensed = [channel for clock in channels() for channel in clock]
    return replace(plan, sensors=sensors_of(sensed, rate_hz))


def _rows() -> list[tuple[str, float | None, Plan]]:
    """Return campaigns with the prototype's bound, worst of 13 parameters, %, where it has one."""
    both = (0.03, 0.05)
    return [
        ("12 runs of 30 and 50 mm", 0.86, standard_plan(heights_m=both)),
        ("the same, IMU and hubs", 1.44, standard_plan(heights_m=both, travels=False)),
        ("6 runs of 50 mm", 0.98, standard_plan()),
        ("the same, IMU and hubs", 1.66, standard_plan(travels=False)),
        ("6 runs of 30 mm", 1.88, standard_plan(heights_m=(0.03,))),
        ("6 runs of 15 mm", 3.74, standard_plan(heights_m=(0.015,))),
        ("12 runs, 50 mm twice", 0.69, standard_plan(heights_m=(0.05, 0.05))),
        ("8 runs of 50 mm with warp", 0.94, standard_plan((*THREE, _WARP))),
        ("8 runs of 50 mm with rear pitch", 0.74, standard_plan((*THREE, _REAR))),
        ("4 runs of 50 mm, pitch and roll", 1.26, standard_plan(THREE[1:])),
        ("4 runs of 50 mm, bounce and roll", 1.43, standard_plan((THREE[0], THREE[2]))),
        ("12 runs at 100 Hz", 1.22, _at(100.0, standard_plan(heights_m=both))),
        ("12 runs at 400 Hz", 0.61, _at(400.0, standard_plan(heights_m=both))),
        ("3 runs of 50 mm, scales", 1.02, standard_plan(states=(BASELINE,), facts=SCALES)),
        (
            "the same, IMU and hubs",
            1.86,
            standard_plan(states=(BASELINE,), facts=SCALES, travels=False),
        ),
        (
            "3 runs of 50 mm, scales and tape",
            0.49,
            standard_plan(states=(BASELINE,), facts=SCALES + TAPE),
        ),
        (
            "8 runs with warp, IMU and hubs",
            None,
            standard_plan((*THREE, _WARP), travels=False, states=BOTH),
        ),
        (
            "8 runs with rear pitch, IMU and hubs",
            None,
            standard_plan((*THREE, _REAR), travels=False, states=BOTH),
        ),
    ]


def main() -> None:
    """Print the worst standard deviation of each campaign, and the CPU time that it took."""
    for what, bound, plan in _rows():
        began = time.process_time()
        found = deviations(plan)
        name = max(found, key=lambda n: found[n])
        mean = sum(found.values()) / len(found)
        beside = "" if bound is None else f" prototype {bound:.2f} %;"
        print(
            f"{what:40} {found[name]:.2f} % ({name:4}), mean {mean:.2f} %;{beside}"
            f" {time.process_time() - began:.1f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
