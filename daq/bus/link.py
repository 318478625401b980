"""Keeps one bus open for weeks: opens it, reads it, closes it when it fails and opens it again.

A link never raises and never ends.  With a missing adapter the recorder is degraded, but its start
does not fail; the link tries to open an unplugged adapter until it is back.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from dbc.frames import FrameBatch

from ..bench.config import BusConfig
from ..errors import BusError
from .source import FrameSource, LinkFacts, SourceLosses

BACK_OFF_S = (0.1, 2.0)
"""First and longest pause before a bus is opened again, s; each pause is twice the one before."""
SILENT_S = 5.0
"""Silence after the last frame, s, after which a bus is opened again: some drivers (gs_usb) hide
the error of an unplugged device, and stay silent."""
_REPORTS_LOSS = frozenset({"socketcan", "slcan", "virtual", "udp_multicast"})
"""Interfaces that report the loss of their device.  If one were opened again only because the car
is switched off, the first frames after switching on could be lost."""

OpenSource = Callable[[BusConfig, int], FrameSource]


class Link:
    """A bus that is opened again whenever it fails.

    `read` and `close` belong to one thread; `facts` and `halt` may be called from any.

    `index`: number of the bus in its frames.  `open_source`: opens the bus, or raises any exception
    (`daq.bus.interfaces.open_source`).  `clock`: monotonic time, s.
    """

    def __init__(
        self,
        config: BusConfig,
        index: int,
        open_source: OpenSource,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.config = config
        self.index = index
        self._open_source = open_source
        self._clock = clock
        self._halted = threading.Event()
        self._source: FrameSource | None = None
        self._before = SourceLosses()  # of the sources that are closed
        self._pause_s = BACK_OFF_S[0]
        self._next_try_s = self._alive_s = clock()
        self._had_frames = self._was_open = False
        name = f"{config.interface} {config.channel}".strip()
        none = SourceLosses()
        self._facts = LinkFacts(name, config.bitrate, False, "", "", self._alive_s, 0, none)

    def facts(self) -> LinkFacts:
        """Return the state of the link."""
        return self._facts

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames received; wait up to `timeout_s` for the first."""
        frames = FrameBatch.empty()
        if self._source is None:
            self._open(timeout_s)
        else:
            try:
                frames = self._source.read(timeout_s)
            except BaseException as error:  # drivers raise anything, even SystemExit
                self._fail(error)
        now_s = self._clock()
        if len(frames):
            self._had_frames, self._alive_s, self._pause_s = True, now_s, BACK_OFF_S[0]
        elif (
            self._source is not None
            and self._had_frames
            and self.config.interface not in _REPORTS_LOSS
            and now_s - self._alive_s >= SILENT_S
        ):
            self._alive_s = now_s
            self._drop()
        down = not len(frames) and getattr(self._source, "interface_down", False)
        self._facts = replace(
            self._facts, heartbeat_s=now_s, losses=self._losses(), interface_down=down
        )
        return frames

    def halt(self) -> None:
        """End a pause between two openings."""
        self._halted.set()

    def close(self) -> None:
        """Close the bus permanently."""
        self._halted.set()
        self._drop()
        self._facts = replace(self._facts, connected=False, losses=self._before)

    def _open(self, timeout_s: float) -> None:
        wait_s = self._next_try_s - self._clock()
        if wait_s > 0:
            self._halted.wait(min(wait_s, timeout_s))
        if self._halted.is_set() or self._clock() < self._next_try_s:
            return
        try:
            self._source = self._open_source(self.config, self.index)
        except BaseException as error:  # as above
            self._fail(error)
            return
        self._alive_s = self._clock()
        reopened = self._facts.reopened + self._was_open
        self._was_open = True
        self._facts = replace(self._facts, connected=True, error="", advice="", reopened=reopened)

    def _fail(self, error: BaseException) -> None:
        self._drop()
        self._next_try_s = self._clock() + self._pause_s
        self._pause_s = min(2 * self._pause_s, BACK_OFF_S[1])
        problem, advice = repr(error), "please report this"
        if isinstance(error, BusError):
            problem, advice = error.what, error.advice
        elif isinstance(error, OSError):
            problem, advice = error.strerror or str(error), "check plug, power and driver"
        self._facts = replace(self._facts, connected=False, error=problem, advice=advice)

    def _drop(self) -> None:
        """Close the source and keep its counts."""
        if self._source is None:
            return
        self._before = self._losses()
        source, self._source = self._source, None
        with suppress(BaseException):  # an unplugged device cannot be closed properly
            source.close()

    def _losses(self) -> SourceLosses:
        now = SourceLosses()
        if self._source is not None:
            with suppress(BaseException):
                now = self._source.losses()
        return self._before.plus(now)
