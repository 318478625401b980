"""Simulates a bench as a bus: the car rests, and is bumped when the recorder waits for it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dbc import Codec, FrameBatch

from ..bench.campaign import Step
from ..bench.config import Bench
from ..bus.source import SourceLosses
from ..control.messages import Phase, Status
from ..errors import BusError
from ..runlog.runlog import Remark
from ..runs import BASELINE
from ..vehicle import Corner
from .acts import Act, Acts
from .car import SimulatedCar
from .ecu import on_the_buses, rig_of, sample
from .other_bus import OtherBus
from .spoils import LOST_S, SPOILT_BUMP, UNPLUG_AFTER_S, UNPLUGGED_S, Fault

__all__ = ["Fault", "SimulatedBench"]

PIECE_S = 0.2
"""Longest piece in which the car is sampled, s: each piece takes some milliseconds, however short
it is, and the recorder decides within this time."""
BLOCK_S = 0.02
"""Host time between blocks, s: each block takes some milliseconds, however short it is."""
PATIENCE_S = (1.0, 1.6)
"""Shortest and longest time from arming to the bump, s."""


class SimulatedBench:
    """A bench whose car is bumped as in the campaign, as a `daq.bus.source.FrameSource`.

    Frames have the car's own time, which runs `speed` times as fast as the host's.  Counters,
    clocks and noise always continue, also between reads.

    `bench`: campaign, weights, channels, trigger and bit rate.  `seed`: determines every draw and
    all noise.  `speed`: speed of the car's time; infinite: `read` does not wait and returns piece
    after piece.  `wish`: function that returns the recorder's status; the car is bumped when the
    recorder is armed, with the bump that is due.  None: the car is not bumped.  `fault`: spoils
    only the second bump.  `start_ns`: time stamp of the start, ns since 1970 UTC.  Raises
    InputError as `daq.sim.ecu.campaign_frames`.
    """

    def __init__(
        self,
        bench: Bench,
        codec: Codec,
        car: SimulatedCar,
        seed: int,
        speed: float = 1.0,
        wish: Callable[[], Status | None] = lambda: None,
        fault: Fault | None = None,
        start_ns: int = 0,
    ) -> None:
        self._bench = bench
        self._rig = rig_of(bench, codec, car, seed)
        self._acts = Acts(bench, self._rig)
        self._speed = speed
        self._wish = wish
        self._fault = fault
        self._start_ns = start_ns
        self._free_ns = [start_ns] * len(bench.buses)
        self._rng = np.random.default_rng([seed, 2])
        self._mass_state = BASELINE
        self._act = self._acts.rest(BASELINE)
        self._begun_s = 0.0  # the present act
        self._done_s = 0.0  # time up to which it is sampled
        self._due_s = np.inf  # the future of the next bump
        self._bumps = 0
        self._gap_s = (np.inf, np.inf)
        self._unplug_s = np.inf
        self._plugged_s = 0.0  # again
        self._asked: deque[Corner] = deque()
        self._notes: int | None = None  # notes of the recording, already seen
        self._others: dict[int, deque[FrameBatch]] = {}
        self._host_s = time.monotonic()

    @property
    def name(self) -> str:
        """The bus, for messages to the operator."""
        return "simulated bench"

    def push(self, corner: Corner) -> None:
        """Push a corner down for a second as soon as the car is at rest; from any thread."""
        self._asked.append(corner)

    def other(self, number: int) -> OtherBus:
        """Return a further bus, which from now on is the only source of its frames."""
        self._others[number] = deque()
        return OtherBus(f"simulated bench, bus {number}", self._others[number])

    def open(self) -> SimulatedBench:
        """Return the bench, whose time has continued, as a bus that is opened again.

        Raises BusError while the adapter is unplugged.
        """
        if np.isfinite(self._speed):
            self._done_s = max(self._done_s, self._now_s())
        self._check_plug()
        return self

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames of the car's elapsed time, at most `PIECE_S`.

        Raises BusError while the adapter is unplugged.
        """
        if np.isfinite(self._speed):
            wait_s = (self._done_s - self._now_s()) / self._speed + BLOCK_S
            time.sleep(min(max(wait_s, 0.0), timeout_s))
        self._check_plug()
        self._choose(self._wish())
        stop_s = min(self._now_s(), self._done_s + PIECE_S)
        if stop_s >= self._unplug_s:
            self._unplug_s = np.inf
            host = self._speed if np.isfinite(self._speed) else 1.0
            self._plugged_s = stop_s + UNPLUGGED_S * host
        return self._sampled(stop_s)

    def losses(self) -> SourceLosses:
        """Return no losses: the counters in the frames show the losses of this bus."""
        return SourceLosses()

    def close(self) -> None:
        """Leave the bus; the car is not changed."""

    def dismantle(self) -> None:
        """End the thread that computes motions in advance."""
        self._acts.close()

    def _now_s(self) -> float:
        if not np.isfinite(self._speed):
            return self._done_s + PIECE_S
        return (time.monotonic() - self._host_s) * self._speed

    def _check_plug(self) -> None:
        if self._done_s < self._plugged_s:
            self._done_s = min(self._now_s(), self._plugged_s)  # frames sent now are lost
            where, what = self.name, "the adapter is gone (a fault of the demo)"
            raise BusError(where, what, "wait: it is plugged in again after 3 s")

    def _choose(self, status: Status | None) -> None:
        """Choose the next act of the car."""
        if self._done_s >= self._begun_s + self._act.length_s:
            self._begin(self._acts.rest(self._mass_state))
        if status is None or self._act.length_s < np.inf:
            return
        step = status.due.step if status.due else None
        if step is not None and step.mass_state in self._rig.plants:
            self._acts.prepare(step, self._next_fault)
            if step.mass_state != self._mass_state:
                self._mass_state, self._due_s = step.mass_state, np.inf
                self._begin(self._acts.rest(step.mass_state))
            elif status.phase is Phase.ARMED:
                self._wait_and_bump(step)
                return
        self._due_s = np.inf
        self._heed(status.notes)
        if self._asked:
            self._begin(self._acts.push(self._mass_state, self._asked.popleft()))

    def _heed(self, notes: Sequence[Remark]) -> None:
        """Push the corner that a new mark asks for: `push FL`, as the bench check sets it."""
        seen = len(notes) if self._notes is None else self._notes
        for note in notes[seen if seen <= len(notes) else 0 :]:  # another recording begins at 0
            word, _, corner = note.text.partition(" ")
            if word == "push" and corner in set(Corner):
                self._asked.append(Corner(corner))
        self._notes = len(notes)

    @property
    def _next_fault(self) -> Fault | None:
        return self._fault if self._bumps + 1 == SPOILT_BUMP else None

    def _wait_and_bump(self, step: Step) -> None:
        if self._due_s == np.inf:
            self._due_s = self._done_s + self._rng.uniform(*PATIENCE_S)
        if self._done_s < self._due_s:
            return
        fault = self._next_fault
        self._due_s = np.inf
        self._bumps += 1
        self._begin(self._acts.prepare(step, fault).result())
        bump_s = self._begun_s + self._act.bump_s
        if fault is Fault.LOST_FRAMES:
            self._gap_s = (bump_s + LOST_S[0], bump_s + LOST_S[1])
        elif fault is Fault.UNPLUG:
            self._unplug_s = bump_s + UNPLUG_AFTER_S

    def _begin(self, act: Act) -> None:
        self._act, self._begun_s = act, self._done_s

    def _sampled(self, stop_s: float) -> FrameBatch:
        scene = replace(self._act.scene, begins_s=self._begun_s)
        span_s = (self._done_s, max(stop_s, self._done_s))
        self._done_s = span_s[1]
        bursts = [
            sample(self._rig, sender, scene, span_s, self._rng, self._act.limits)
            for sender in self._rig.senders
        ]
        batch = on_the_buses(bursts, self._bench.buses, self._start_ns, self._free_ns)
        if not len(batch):
            return batch
        sent_s = (batch.t_ns - self._start_ns) * 1e-9
        batch = batch.select((sent_s < self._gap_s[0]) | (sent_s >= self._gap_s[1]))
        for number, waiting in tuple(self._others.items()):
            waiting.append(batch.select(batch.bus == number))
            batch = batch.select(batch.bus != number)
        return batch
