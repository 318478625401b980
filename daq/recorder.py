"""The engine of a recording: journal first, then decode, watch the sensors, find the bumps.

`Recorder.step` does all of it for one block, without threads; `daq.recording` feeds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from dbc import Codec
from dbc.frames import FrameBatch

from . import health, trigger
from .campaign import Step, next_step
from .config import Bench
from .errors import InputError
from .mapping import map_channels
from .runs import Event, Losses
from .source import HopLosses

RESTAMPED = "restamped"
UNPLANNED = "unplanned_"
"""Put before the code of a bump (and of its end) that comes when the campaign is complete."""


class FrameStore(Protocol):
    """Where a recorder puts what it is given: a `Journal`, or what an import keeps of a log."""

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        """Store a block of frames, and the losses counted up to it."""

    def append_events(self, events: Sequence[Event]) -> None:
        """Store events."""


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """Where a recording stands.

    Parameters
    ----------
    t_ns : int
        Latest time stamp; 0 before the first frame.
    frames : int
        Frames stored so far.
    losses : Losses
        Counted so far, at all hops.
    step, running : Step or None
        What is to be done next (or is being done); the same once its bump has come.
    done, planned : int
        Steps of the campaign.
    events : tuple of Event
        What happened since the last status.
    """

    t_ns: int
    frames: int
    losses: Losses
    step: Step | None
    running: Step | None
    done: int
    planned: int
    events: tuple[Event, ...]


class Recorder:
    """One recording of a campaign.

    Parameters
    ----------
    bench : Bench
        Channels, campaign and trigger.
    codec : Codec
        The bench's DBC.
    journal : FrameStore
        Where everything goes; the caller closes it.

    Raises
    ------
    InputError
        If a channel and the DBC do not fit, or no channel can trigger.
    """

    def __init__(self, bench: Bench, codec: Codec, journal: FrameStore) -> None:
        self._bench = bench
        self._codec = codec
        self._journal = journal
        # All channels are mapped although only some trigger: what does not fit together is to be
        # known before the first bump, not after the last.
        mapped = map_channels(bench.channels, codec.messages, bench.dbc_name)
        names = {channel.name for channel in trigger.trigger_channels(bench.channels)}
        if not names:
            raise InputError(
                "bench.toml",
                "has no channel that can trigger",
                "add a hub_acceleration or a body_acceleration",
            )
        self._feeds = tuple(m for m in mapped if m.channel.name in names)
        self._trigger = trigger.TriggerState()
        self._health = health.HealthState()
        self._hops = HopLosses()
        self._done: list[Step] = []
        self._running: Step | None = None
        self._frames = 0
        self._t_ns = 0

    @property
    def complete(self) -> bool:
        """Whether every step of the campaign has been done."""
        return next_step(self._bench.campaign, self._done) is None

    @property
    def losses(self) -> Losses:
        """What was lost so far, at all hops."""
        hops = Losses(
            bus_dropped=self._hops.bus_dropped,
            bus_garbled=self._hops.bus_garbled,
            queue_dropped=self._hops.queue_dropped,
        )
        return health.losses_added(self._health.losses, hops)

    def step(self, batch: FrameBatch, hops: HopLosses) -> tuple[Event, ...]:
        """Take in one block of frames.

        Parameters
        ----------
        batch : FrameBatch
            In order of arrival; may be empty, if only losses are to be told.
        hops : HopLosses
            Cumulative counts up to this block.

        Returns
        -------
        tuple of Event
            What happened, as stored: `bump` and `run_end` carry the label of their step.

        Raises
        ------
        JournalError
            If the block could not be stored.  Nothing else has been done with it then.
        """
        self._journal.append(batch, hops)
        events: list[Event] = []
        if len(batch):
            self._frames += len(batch)
            self._t_ns = int(batch.t_ns[-1])
            decoded = self._codec.decode(batch)
            self._health = health.advance(self._codec.messages, self._health, decoded)
            block = {
                feed.channel.name: (samples.t_ns, feed.values(samples))
                for feed in self._feeds
                if (samples := decoded.samples.get(feed.channel.signal)) is not None
            }
            self._trigger, found = trigger.advance(self._bench.trigger, self._trigger, block)
            events += (self._labelled(event) for event in found)
        if hops.restamped and not self._hops.restamped:
            text = "time stamps of another epoch: frames are stamped on arrival"
            events.append(Event(self._t_ns, RESTAMPED, hops.restamped, text))
        self._hops = hops
        if events:
            self._journal.append_events(events)
        return tuple(events)

    def note(self, code: str, value: float, text: str) -> Event:
        """Store an event that is not in the frames, at the time of the latest one."""
        event = Event(self._t_ns, code, value, text)
        self._journal.append_events([event])
        return event

    def status(self, events: Sequence[Event]) -> RecorderStatus:
        """Return where the recording stands; `events` are those to be told with it."""
        campaign = self._bench.campaign
        return RecorderStatus(
            self._t_ns,
            self._frames,
            self.losses,
            next_step(campaign, self._done),
            self._running,
            len(self._done),
            len(campaign.steps),
            tuple(events),
        )

    def _labelled(self, event: Event) -> Event:
        """Give bumps and ends the label of the step that is due, and keep the book of steps."""
        if event.code == trigger.BUMP:
            self._running = next_step(self._bench.campaign, self._done)
        elif event.code != trigger.RUN_END:
            return event
        if self._running is None:
            return replace(event, code=UNPLANNED + event.code)
        labelled = replace(event, text=self._running.label)
        if event.code == trigger.RUN_END:
            self._done.append(self._running)
            self._running = None
        return labelled
