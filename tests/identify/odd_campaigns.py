"""Campaigns of a small linear car of its own equations, and the faults of the bench in them.

`python -m tests.identify.odd_campaigns` prints the table of docs/bench-faults.md: to each fault the
verdict, the first reason, and the CPU time of the identification.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.channels import Channel, Quantity
from daq.sessions import Session, session_from_arrays
from daq.vehicle import BodyWeight, Corner, Fact, HubWeight, Vehicle
from identify import identify_parameters

Array = NDArray[np.float64]
Records = list[tuple[str, str, dict[str, tuple[Array, Array]]]]

RATE_HZ, REST_S, BUMP_S, LENGTH_S = 200.0, 0.5, 0.2, 2.5
LIFTED = {"bounce": (1, 1, 1, 1), "pitch": (1, 1, 0, 0), "roll": (1, 0, 1, 0)}
Weights = tuple[BodyWeight | HubWeight, ...]
NOISE = {"az": 0.02, "wy": 0.002, "wx": 0.002, "hub": 0.1, "tr": 0.0003}
WEIGHTS: Weights = (
    BodyWeight(25.0, 0.1, 0.45),
    BodyWeight(20.0, 0.1, -0.45),
    BodyWeight(30.0, -2.2, 0.4),
    BodyWeight(20.0, -2.2, -0.4),
    *(HubWeight(2.5, corner) for corner in Corner),
)
_X, _Y = np.array([1.05, 1.05, -1.40, -1.40]), np.array([0.66, -0.66, 0.655, -0.655])
_SPRING = np.array([17e3, 17e3, 16e3, 16e3])
_DAMPER = np.array([1100.0, 1100.0, 950.0, 950.0])
_TYRE = np.array([150e3, 150e3, 155e3, 155e3])
_MASS = np.diag([720.0, 850.0, 260.0, 28.0, 28.0, 25.0, 25.0])


def channels() -> tuple[Channel, ...]:
    """Return an IMU in the middle of the front axle, and hubs and travels at the corners."""
    hubs = [Channel(f"hub{c}", Quantity.HUB_ACCELERATION, corner=c) for c in Corner]
    travels = [Channel(f"tr{c}", Quantity.SUSPENSION_TRAVEL, corner=c) for c in Corner]
    return (
        Channel("az", Quantity.BODY_ACCELERATION, x_m=-1.0),
        Channel("wy", Quantity.PITCH_RATE),
        Channel("wx", Quantity.ROLL_RATE),
        *hubs,
        *travels,
    )


def campaign(
    kinds: Iterable[str] = ("bounce", "pitch", "roll"),
    states: Sequence[str] = ("baseline", "added"),
    noise: float = 1.0,
    seed: int = 1,
    weights: Weights = WEIGHTS,
) -> Records:
    """Return a record of each kind of bump in each state; `noise` in units of `NOISE`."""
    rng = np.random.default_rng(seed)
    runs: Records = []
    for state in states:
        for kind in kinds:
            t_s, clean = _motion(weights if state == "added" else (), kind)
            noisy = {
                name: values + noise * NOISE[name[: 3 if name[0] == "h" else 2]]
                * rng.standard_normal(len(t_s))
                for name, values in clean.items()
            }  # fmt: skip
            runs.append((state, kind, {name: (t_s, values) for name, values in noisy.items()}))
    return runs


@cache
def _motion(weights: Weights, kind: str) -> tuple[Array, dict[str, Array]]:
    """Return times and noise-free readings; travels show how far the weights sink the body."""
    force_of_travel = np.zeros((7, 4))  # travel = wheel - body, positive in compression
    for i in range(4):
        force_of_travel[:, i] = [1.0, -_X[i], _Y[i], *-np.eye(4)[i]]
    K = force_of_travel @ np.diag(_SPRING) @ force_of_travel.T
    C = force_of_travel @ np.diag(_DAMPER) @ force_of_travel.T
    K[3:, 3:] += np.diag(_TYRE)
    M, weight = _MASS.copy(), np.zeros(7)
    for w in weights:
        if isinstance(w, BodyWeight):
            row = np.array([1.0, -(w.x_m + 1.05), w.y_m, 0, 0, 0, 0])
            M += w.mass_kg * np.outer(row, row)
            weight += w.mass_kg * 9.80665 * row
        else:
            M[3 + w.corner.position, 3 + w.corner.position] += w.mass_kg
    road = np.concatenate([np.zeros(3), _TYRE * LIFTED[kind]])
    A = np.zeros((15, 15))  # the state, and the road's height as an input
    A[:7, 7:14] = np.eye(7)
    A[7:14, :7], A[7:14, 7:14] = -np.linalg.solve(M, K), -np.linalg.solve(M, C)
    A[7:14, 14] = np.linalg.solve(M, road)
    fine = 10
    step = expm(A / (fine * RATE_HZ))
    n = round(LENGTH_S * RATE_HZ)
    state_now, states = np.zeros(15), np.zeros((n, 15))
    for k in range(n * fine):
        t = (k + 0.5) / (fine * RATE_HZ) - REST_S
        if k % fine == 0:
            states[k // fine] = state_now
            height = 0.04 * np.sin(np.pi * (t - 0.5 / (fine * RATE_HZ)) / BUMP_S)
            states[k // fine, 14] = height * (0.0 <= t < BUMP_S)
        state_now[14] = 0.04 * np.sin(np.pi * t / BUMP_S) * (0.0 <= t < BUMP_S)
        state_now = step @ state_now
    rates, z, v = states @ A.T, states[:, :7], states[:, 7:14]
    accelerations = rates[:, 7:14]
    sunk = -np.linalg.solve(K, weight)
    travels = -(z + sunk) @ force_of_travel
    # The IMU is 1 m behind the front axle, 0.05 m before the centre of gravity.
    readings = {
        "az": accelerations[:, 0] - 0.05 * accelerations[:, 1],
        "wy": v[:, 1],
        "wx": v[:, 2],
    }
    readings |= {f"hub{c}": accelerations[:, 3 + c.position] for c in Corner}
    readings |= {f"tr{c}": travels[:, c.position] for c in Corner}
    return np.arange(n) / RATE_HZ, readings


# Faults -------------------------------------------------------------------------------------------

Change = Callable[[str, Array, Array], tuple[Array, Array]]
CENTRED: Weights = tuple(replace(w, y_m=0.0) if isinstance(w, BodyWeight) else w for w in WEIGHTS)


class Fault(NamedTuple):
    """A campaign with one thing wrong."""

    runs: Callable[[], Records]
    verdict: str
    words: tuple[str, ...] = ()
    """`verdict`, `words`: of the answer; the words are in its reasons."""
    weights: Weights = WEIGHTS
    """As stated."""
    facts: tuple[Fact, ...] = ()
    first: bool = False
    """True if the first reason must have the words."""

    def session(self) -> Session:
        """Return the campaign."""
        vehicle = Vehicle("small car", facts=self.facts)
        return session_from_arrays(
            self.runs(), channels(), self.weights, vehicle=vehicle, bump_s=BUMP_S
        )


def each(change: Change, names: str = "") -> Callable[[], Records]:
    """Return a campaign in which the samples of the channels that begin so are changed."""
    return lambda: [
        (state, kind, {n: change(n, *tv) if n.startswith(names) else tv for n, tv in run.items()})
        for state, kind, run in campaign()
    ]


def times(factor: float) -> Callable[[], Records]:
    return each(lambda _, t_s, values: (t_s * factor, values))


def scaled(factor: float, names: str = "") -> Callable[[], Records]:
    return each(lambda _, t_s, values: (t_s, values * factor), names)


def coarse(step: float, names: str = "") -> Callable[[], Records]:
    return each(lambda _, t_s, values: (t_s, np.round(values / step) * step), names)


def late(by_s: float, names: str) -> Callable[[], Records]:
    return each(lambda _, t_s, values: (t_s + by_s, values), names)


def drifting(per_s: float, names: str) -> Callable[[], Records]:
    return each(lambda _, t_s, values: (t_s, values + per_s * t_s), names)


def jumped(names: str = "") -> Callable[[], Records]:
    return each(lambda _, t_s, values: (t_s + 0.1 * (t_s > 1.2), values), names)


def with_one(value: float, names: str) -> Callable[[], Records]:
    def change(_: str, t_s: Array, values: Array) -> tuple[Array, Array]:
        return t_s, np.where(np.arange(len(t_s)) == 250, value, values)

    return each(change, names)


def silent_for_a_while(names: str) -> Callable[[], Records]:
    def change(_: str, t_s: Array, values: Array) -> tuple[Array, Array]:
        return t_s, np.where((t_s >= 0.7) & (t_s < 0.9), np.nan, values)

    return each(change, names)


def closed_up(share: float) -> Callable[[], Records]:
    """Return runs that have lost samples and whose times were written as if they had not."""

    def change(_: str, t_s: Array, values: Array) -> tuple[Array, Array]:
        kept = np.random.default_rng(5).random(len(t_s)) > share
        return t_s[: kept.sum()], values[kept]

    return each(change)


def struck_twice(share: float, only: str = "") -> Callable[[], Records]:
    """Return runs with a second bump a second after the first, so much as high.

    `only`: the excitation of the one loaded run that has it; all have it if it is empty.
    """

    def again(t_s: Array, values: Array) -> tuple[Array, Array]:
        later = np.interp(t_s - 1.0, t_s, values - values[0], left=0.0)
        return t_s, values + share * later

    return lambda: [
        (
            state,
            kind,
            run
            if only and (state, kind) != ("added", only)
            else {name: again(*samples) for name, samples in run.items()},
        )
        for state, kind, run in campaign()
    ]


def silent_roll(*kinds: str) -> Callable[[], Records]:
    """Return the runs of a symmetric car without roll runs, a roll rate of rounding errors."""

    def rounding(t_s: Array, values: Array) -> tuple[Array, Array]:
        return t_s, 1e-17 * values / np.std(values)

    return lambda: [
        (state, kind, {**run, "wx": rounding(*run["wx"])})
        for state, kind, run in campaign(kinds, weights=CENTRED)
    ]


def without(*names: str) -> Callable[[], Records]:
    return lambda: [
        (state, kind, {n: tv for n, tv in run.items() if not n.startswith(names)})
        for state, kind, run in campaign()
    ]


def exchanged(a: str, b: str) -> Callable[[], Records]:
    other = {a: b, b: a}
    return lambda: [
        (state, kind, {other.get(n, n): tv for n, tv in run.items()})
        for state, kind, run in campaign()
    ]


def turned(degrees: float) -> Callable[[], Records]:
    """Return the runs of an IMU that is turned to the left, as seen from above."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def shown(run: dict[str, tuple[Array, Array]]) -> dict[str, tuple[Array, Array]]:
        (t_s, roll), (_, pitch) = run["wx"], run["wy"]
        return {**run, "wx": (t_s, c * roll + s * pitch), "wy": (t_s, c * pitch - s * roll)}

    return lambda: [(state, kind, shown(run)) for state, kind, run in campaign()]


def with_other_weights() -> Records:
    heavy = tuple(replace(w, mass_kg=2.0 * w.mass_kg) for w in WEIGHTS)
    return [*campaign(), *campaign(states=["added"], weights=heavy, seed=2)]


def with_states_exchanged() -> Records:
    other = {"baseline": "added", "added": "baseline"}
    return [(other[state], kind, run) for state, kind, run in campaign()]


def _stated(number: int, weight: BodyWeight | HubWeight) -> Weights:
    return (*WEIGHTS[:number], weight, *WEIGHTS[number + 1 :])


_POUNDS = (Fact("total_mass_kg", 1821.0, 2.0), Fact("front_axle_kg", 1029.0, 2.0))
_NO_TRAVELS = without("tr")

FAULTS: dict[str, Fault] = {
    "nothing": Fault(campaign, "ok"),
    "no roll run": Fault(
        silent_roll("bounce", "pitch"), "refused", ("I_xx, t_f, t_r: record roll runs",), CENTRED
    ),
    "pitch runs only": Fault(lambda: campaign(["pitch"]), "doubtful", ("wide intervals",)),
    "one channel": Fault(without("w", "hub", "tr"), "refused", ("one channel only (az)",)),
    "hubs only": Fault(without("az", "w", "tr"), "refused", ("do not determine",)),
    "no roll sensor": Fault(
        without("wx", "tr"), "refused", ("do not determine I_xx, t_f, t_r",)
    ),
    "times in ms": Fault(times(1e3), "refused", ("0.2 Hz", "are the times in ms?")),
    "times in minutes": Fault(times(1 / 60), "refused", ("0.04 s after the bump",)),
    "times begin at -10 s": Fault(each(lambda _, t, v: (t - 10.0, v)), "ok"),
    "no value is a number": Fault(scaled(np.nan), "refused", ("no accepted run has a sample",)),
    "all constant": Fault(scaled(0.0), "refused", ("never moves in any run: az",)),
    "one infinite value": Fault(
        with_one(np.inf, "wy"), "ok", ("values that no sensor shows: wy",)
    ),
    "values of 1e300": Fault(scaled(1e300), "refused", ("values that no sensor shows: az",)),
    "no noise": Fault(lambda: campaign(noise=0.0), "ok"),
    "nothing but noise": Fault(
        lambda: campaign(noise=1000.0), "refused", ("nothing moves in it",)
    ),
    "steps of 1 of all sensors": Fault(
        coarse(1.0), "refused", ("coarse sensors", "hubFL (1 m/s2)")
    ),
    "steps of 0.5 m/s2": Fault(
        coarse(0.5, "hub"), "doubtful", ("hubFL (0.5 m/s2)", "step/sqrt(12)")
    ),
    "a hub silent for 0.2 s": Fault(
        silent_for_a_while("hubFL"), "doubtful", ("wide intervals: m_ur, k_tr",)
    ),
    "1 % of samples lost, times closed up": Fault(
        closed_up(0.01), "doubtful", ("residuals are not white",)
    ),
    "travels in mm": Fault(
        scaled(1e3, "tr"), "refused", ("trFL, trFR, trRL and 1 more change", "are they in mm?")
    ),
    "a hub in g": Fault(
        scaled(1 / 9.80665, "hubFL"), "refused", ("gain of hubFL (it shows 0.1",), first=True
    ),
    "a hub shows 1.1 times": Fault(
        scaled(1.1, "hubFL"), "doubtful", ("gain of hubFL",)
    ),
    "a hub upside down": Fault(
        scaled(-1.0, "hubRR"), "refused", ("wrong signs, trRR",), first=True
    ),
    "a travel upside down": Fault(
        scaled(-1.0, "trFL"), "refused", ("wrong signs, trFL",), first=True
    ),
    "hubs 5 ms late": Fault(
        late(0.005, "hub"), "refused", ("hub sensors late (5.0 ms",), first=True
    ),
    "body 8 ms late": Fault(late(0.008, "a"), "refused", ("az late (8.0 ms",), first=True),
    "IMU turned by 8 deg": Fault(
        turned(8.0), "refused", ("likely cause: IMU turned about z (az 8.",), first=True
    ),
    "clocks jump by 0.1 s": Fault(jumped(), "refused", ("clocks that jump (all sensors",)),
    "one clock jumps": Fault(jumped("az"), "refused", ("clocks that jump (az",), first=True),
    "travels drift by 1 mm/s": Fault(
        drifting(1e-3, "tr"), "refused", ("likely cause: drift (trFL +0.0",), first=True
    ),
    "a gyro drifts": Fault(
        drifting(0.01, "wy"), "refused", ("likely cause: drift (wy +0.0",), first=True
    ),
    "travels drift by 0.01 mm/s": Fault(drifting(1e-5, "tr"), "ok"),
    "a second bump in every run": Fault(
        struck_twice(0.7), "refused", ("a second bump (in 6 of 6 runs",), first=True
    ),
    "a second bump in one run": Fault(
        struck_twice(0.7, "roll"), "refused", ("run added_roll_1 disagrees",)
    ),
    "mass states swapped": Fault(
        with_states_exchanged, "refused", ("mass states swapped",), first=True
    ),
    "hubs of two corners swapped": Fault(
        exchanged("hubFL", "hubRL"), "refused",
        ("hub acceleration of front left and rear left swapped",), first=True,
    ),
    "pitch and roll swapped": Fault(
        exchanged("wx", "wy"), "refused", ("wy and wx swapped",), first=True
    ),
    "other weights in some runs": Fault(
        with_other_weights, "refused",
        ("runs added_bounce_2, added_pitch_2, added_roll_2 disagree",), first=True,
    ),
    "scales in lb": Fault(
        campaign, "refused", ("likely cause: scales in lb",), facts=_POUNDS, first=True
    ),
    "a weight ten times heavier": Fault(
        campaign, "refused", ("weight 1 ",), _stated(0, BodyWeight(250.0, 0.1, 0.45)), first=True
    ),
    "a weight at half its mass": Fault(
        _NO_TRAVELS, "refused", ("weight 3 ",), _stated(2, BodyWeight(15.0, -2.2, 0.4)), first=True
    ),
    "a weight before the car": Fault(
        campaign, "refused", ("weight 3 ",), _stated(2, BodyWeight(30.0, 2.2, 0.4)), first=True
    ),
    "a weight on the other side": Fault(
        _NO_TRAVELS, "refused", ("weight 1 ",), _stated(0, BodyWeight(25.0, 0.1, -0.45)),
        first=True,
    ),
    "a weight on the other axle": Fault(
        campaign, "refused", ("weight 1 ",), _stated(0, BodyWeight(25.0, -2.2, 0.45)), first=True
    ),
    "a hub's weight ten times heavier": Fault(
        _NO_TRAVELS, "refused", ("weight 7 ",), _stated(6, HubWeight(25.0, Corner.REAR_LEFT)),
        first=True,
    ),
    "a hub's weight on another hub": Fault(
        _NO_TRAVELS, "refused", ("weight 7 ",), _stated(6, HubWeight(2.5, Corner.FRONT_LEFT)),
        first=True,
    ),
}  # fmt: skip


def main(names: Sequence[str]) -> None:
    """Print a row of the table for each named fault; for all without a name."""
    sys.stdout.write("| fault | verdict | first reason | CPU, s |\n|---|---|---|--:|\n")
    for name in names or FAULTS:
        session = FAULTS[name].session()
        began_s = time.process_time()
        quality = identify_parameters(session).quality
        cpu_s = time.process_time() - began_s
        doubts = [f.text for f in quality.findings if f.severity]
        reason = doubts[0].removeprefix("likely cause: ") if doubts else ""
        short = re.split(r"; |, explains| \(explains|: record|: check", reason)[0][:100]
        short += ")" * (short.count("(") - short.count(")"))
        sys.stdout.write(f"| {name} | {quality.verdict} | {short} | {cpu_s:.1f} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
