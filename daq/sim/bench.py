"""Simulates a bench as a bus: the car rests, and is bumped when the recorder waits for it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from enum import StrEnum
from queue import Empty, SimpleQueue

import numpy as np

from dbc import Codec, FrameBatch

from ..bench.campaign import Method, Step
from ..bench.config import Bench
from ..bus.source import BusError, FrameSource
from ..check.pushes import ORDER
from ..control.messages import Phase, Status
from ..runs import BASELINE, RunStatus
from ..vehicle import Corner
from .car import SimulatedCar
from .ecu import Manoeuvre, Rig, rig_of
from .motion import PUSHED_S, Bump, Motion, Moving, Push, Spliced, dropped, pushed, pushed_down

PIECE_S = 0.2
"""Longest piece in which the car is sampled, s: each piece takes some milliseconds, however short
it is, and the recorder decides within this time."""
BLOCK_S = 0.02
"""Host time between blocks, s: each block takes some milliseconds, however short it is."""
LEAD_S = 0.1
"""Rest at the beginning of a manoeuvre, s, longer than the delay of any sensor."""
SWING_S = 4.0
"""Time, s, after which the motion of a car with a damping of 0.25 at 1 Hz has decayed to 1/500."""
PUSH_N, PUSH_S, PAUSE_S = 400.0, 1.2, 1.6
"""Force and duration of a push by a person on a corner, who lets go gently; rest after it, s."""
_MARGIN_S = 0.2
"""Margin at the end of a manoeuvre, s, because it ends with the piece that is being sampled."""
_SECOND_BUMP_S = 0.84
"""Time between the two bumps of a double bump, s."""
_LOST_S = (0.3, 0.42)
"""Begin and end of the time after a bump in which frames are lost, s: more frames than the few that
are harmless, and shorter than the silence of a sensor that stopped."""


class Fault(StrEnum):
    """Kinds of spoilt runs: one of the motion, one of the frames, one of the plug."""

    DOUBLE_BUMP = "double-bump"
    LOST_FRAMES = "lost-frames"
    UNPLUG = "unplug"


def _standing(rig: Rig, mass_state: str) -> Manoeuvre:
    """Return the manoeuvre of a car that remains at rest: a push that changes nothing."""
    pose = rig.plants[mass_state].rest
    return rig.manoeuvre(Push(pose, np.zeros((7, 1)), 1.0), 0.0, np.inf)


def _pushed(rig: Rig, mass_state: str, corner: Corner) -> Manoeuvre:
    """Return a push by a person on a corner."""
    return rig.manoeuvre(pushed(rig.plants[mass_state], corner, PUSH_N, PUSH_S), PUSH_S, PUSH_S)


def _bumped(rig: Rig, step: Step, twice: bool) -> Manoeuvre:
    """Return a bump as the campaign makes it; a double bump is always rolled over."""
    plant, kind, campaign = rig.plants[step.mass_state], step.excitation, rig.bench.campaign
    height_m = campaign.bump_height_m
    length_s, lead_s = LEAD_S + SWING_S, LEAD_S
    motion: Moving
    if campaign.method is Method.ROLL_OVER or twice:
        bump = Bump(kind, height_m, LEAD_S, campaign.bump_s)
        motion = plant.drive(bump, length_s + _MARGIN_S)
        if twice:
            second_s = LEAD_S + _SECOND_BUMP_S
            length_s += _SECOND_BUMP_S
            pose, velocity, _ = motion.at(np.array([second_s]))
            again = Motion.over(replace(bump, start_s=second_s), plant, pose, velocity)
            motion = Spliced(motion, again, second_s)
    elif campaign.method_of(kind) is Method.PUSH:
        length_s += PUSHED_S
        motion = pushed_down(plant, kind, height_m, LEAD_S)
    else:  # it is on the blocks before they are removed
        lead_s += rig.bench.trigger.pre_s
        length_s += rig.bench.trigger.pre_s
        motion = dropped(plant, kind, height_m, lead_s)
    return rig.manoeuvre(motion, length_s + _MARGIN_S, length_s, lead_s)


def push_frames(
    bench: Bench, codec: Codec, car: SimulatedCar, seed: int, start_ns: int, rest_s: float
) -> Iterator[FrameBatch]:
    """Yield the frames of a car that is at rest, is pushed at each corner, and is at rest again.

    The car then remains at rest: the caller ends the iteration.  Arguments and errors are those of
    `daq.sim.ecu.campaign_frames`; `rest_s`: time before the first push, s.
    """
    rig = rig_of(bench, codec, car, seed)
    standing = _standing(rig, BASELINE)
    plan = [(standing, rest_s)]  # manoeuvres and their lengths, s
    for corner in ORDER:
        plan += [(_pushed(rig, BASELINE, corner), PUSH_S), (standing, PAUSE_S)]
    rng, free_ns = np.random.default_rng([seed, 2]), [start_ns] * len(bench.buses)
    sampled_s = 0.0  # time up to which the car is sampled
    for manoeuvre, length_s in [*plan, (standing, np.inf)]:
        begun_s = sampled_s
        while sampled_s < begun_s + length_s:
            span_s = (sampled_s, min(sampled_s + PIECE_S, begun_s + length_s))
            sampled_s = span_s[1]
            if len(batch := rig.frames(manoeuvre, begun_s, span_s, rng, start_ns, free_ns)):
                yield batch


class SimulatedBench(FrameSource):
    """A bench whose car is bumped as in the campaign; the counters in its frames show losses.

    Frames have the car's own time, which runs `speed` times as fast as the host's; infinite:
    `read` returns piece after piece.  Counters, clocks and noise always continue.  `seed`:
    determines every draw and all noise.  `recorder_status`: the car is bumped when the recorder is
    armed, with the bump that is due; it is not bumped while this returns None.  `fault`: spoils
    only the second bump.  `start_ns`: time stamp of the start.  Raises InputError as
    `daq.sim.ecu.campaign_frames`.
    """

    def __init__(
        self,
        bench: Bench,
        codec: Codec,
        car: SimulatedCar,
        seed: int,
        speed: float = 1.0,
        recorder_status: Callable[[], Status | None] = lambda: None,
        fault: Fault | None = None,
        start_ns: int = 0,
    ) -> None:
        self._rig = rig_of(bench, codec, car, seed)
        self._speed, self._recorder_status, self._fault = speed, recorder_status, fault
        self._piece_s = PIECE_S if np.isinf(speed) else max(PIECE_S, BLOCK_S * speed)
        self._start_ns, self._free_ns = start_ns, [start_ns] * len(bench.buses)
        self._rng = np.random.default_rng([seed, 2])
        self._mass_state = BASELINE
        self._manoeuvre = _standing(self._rig, BASELINE)
        # Times since the start, s, in the car's time; infinite: never.
        self._begun_s = 0.0  # when the present manoeuvre began
        self._sampled_s = 0.0  # up to which the car is sampled
        self._bump_due_s = np.inf  # of the next bump
        self._unjudged_bump_s = 0.0  # earliest time of a bump without a new verdict
        self._lost_s = (np.inf, np.inf)  # begin and end of the time without frames
        self._unplug_s = np.inf  # when the adapter is unplugged
        self._plugged_s = 0.0  # from which the adapter is there again
        self._n_bumps = 0
        self._n_judged = -1  # runs that the recorder had judged at the last bump
        self._asked_pushes: deque[Corner] = deque()
        self._notes_read: int | None = None  # number of the recording's notes that were read
        self._others: dict[int, SimpleQueue[FrameBatch]] = {}  # frames of further buses, by number
        self._start_host_s = time.monotonic()

    def other(self, number: int) -> OtherBus:
        """Return a further bus, which from now on is the only source of its frames."""
        self._others[number] = SimpleQueue()
        return OtherBus(self._others[number])

    def open(self) -> SimulatedBench:
        """Return the bench, whose time has continued, as a bus that is opened again.

        Raises BusError while the adapter is unplugged.
        """
        if np.isfinite(self._speed):
            self._sampled_s = max(self._sampled_s, self._now_s())
        self._check_plug()
        return self

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames since the last call, of one piece of the car's time at most.

        Raises BusError while the adapter is unplugged.
        """
        if np.isfinite(self._speed):
            wait_s = (self._sampled_s - self._now_s()) / self._speed + BLOCK_S
            time.sleep(min(max(wait_s, 0.0), timeout_s))
        self._check_plug()
        self._choose(self._recorder_status())
        stop_s = min(self._now_s(), self._sampled_s + self._piece_s)
        if stop_s >= self._unplug_s:
            self._unplug_s = np.inf
            speed = self._speed if np.isfinite(self._speed) else 1.0
            self._plugged_s = stop_s + 3.0 * speed  # 3 s of the host
        span_s = (self._sampled_s, max(stop_s, self._sampled_s))
        self._sampled_s = span_s[1]
        batch = self._rig.frames(
            self._manoeuvre, self._begun_s, span_s, self._rng, self._start_ns, self._free_ns
        )
        if not len(batch):
            return batch
        sent_s = (batch.t_ns - self._start_ns) * 1e-9
        batch = batch.select((sent_s < self._lost_s[0]) | (sent_s >= self._lost_s[1]))
        for number, waiting in tuple(self._others.items()):
            waiting.put(batch.select(batch.bus == number))
            batch = batch.select(batch.bus != number)
        return batch

    def _now_s(self) -> float:
        """Return the present time of the car, s."""
        if not np.isfinite(self._speed):
            return self._sampled_s + PIECE_S
        return (time.monotonic() - self._start_host_s) * self._speed

    def _check_plug(self) -> None:
        """Raise BusError while the adapter is unplugged."""
        if self._sampled_s < self._plugged_s:
            self._sampled_s = min(self._now_s(), self._plugged_s)  # frames sent now are lost
            what = "the adapter is gone (a fault of the demo)"
            raise BusError("simulated bench", what, "wait: it is plugged in again after 3 s")

    def _choose(self, status: Status | None) -> None:
        """Begin the next manoeuvre of the car, if it is time for one: rest, a bump, or a push."""
        if self._sampled_s >= self._begun_s + self._manoeuvre.length_s:
            self._begin(_standing(self._rig, self._mass_state))
        if status is None or self._manoeuvre.length_s < np.inf:
            return
        step = status.due.step if status.due else None
        if step is not None and step.mass_state in self._rig.plants:
            if step.mass_state != self._mass_state:
                self._mass_state, self._bump_due_s = step.mass_state, np.inf
                self._begin(_standing(self._rig, step.mass_state))
            elif status.phase is Phase.ARMED:
                self._wait_and_bump(step, status)
                return
        self._bump_due_s = np.inf
        n_read = len(status.notes) if self._notes_read is None else self._notes_read
        if n_read > len(status.notes):  # another recording begins at 0
            n_read = 0
        for note in status.notes[n_read:]:  # the bench check marks `push FL`
            word, _, corner = note.text.partition(" ")
            if word == "push" and corner in set(Corner):
                self._asked_pushes.append(Corner(corner))
        self._notes_read = len(status.notes)
        if self._asked_pushes:
            self._begin(_pushed(self._rig, self._mass_state, self._asked_pushes.popleft()))

    def _wait_and_bump(self, step: Step, status: Status) -> None:
        """Bump an armed car after a person's time to react."""
        n_judged = sum(run.status is not RunStatus.OPEN for run in status.runs)
        if n_judged == self._n_judged and self._sampled_s < self._unjudged_bump_s:
            return  # on a busy machine its status is that before the last bump
        if self._bump_due_s == np.inf:
            self._bump_due_s = self._sampled_s + self._rng.uniform(1.0, 1.6)
        if self._sampled_s < self._bump_due_s:
            return
        fault = self._fault if self._n_bumps == 1 else None  # only the second, after a good run
        self._bump_due_s, self._n_judged = np.inf, n_judged
        self._n_bumps += 1
        self._begin(_bumped(self._rig, step, fault is Fault.DOUBLE_BUMP))
        bump_s = self._begun_s + self._manoeuvre.bump_s
        self._unjudged_bump_s = bump_s + 10.0  # then the recorder will judge no run any more
        if fault is Fault.LOST_FRAMES:
            self._lost_s = (bump_s + _LOST_S[0], bump_s + _LOST_S[1])
        elif fault is Fault.UNPLUG:
            self._unplug_s = bump_s + 0.5

    def _begin(self, manoeuvre: Manoeuvre) -> None:
        self._manoeuvre, self._begun_s = manoeuvre, self._sampled_s


class OtherBus(FrameSource):
    """The frames of one further bus of a simulated bench.

    `waiting`: its frames, which the bench adds from another thread.
    """

    def __init__(self, waiting: SimpleQueue[FrameBatch]) -> None:
        self._waiting = waiting

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the block of frames that waits longest; wait up to `timeout_s` for one."""
        try:
            return self._waiting.get(timeout=timeout_s)
        except Empty:
            return FrameBatch.empty()
