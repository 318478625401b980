"""Opens any interface of python-can and reads its frames in blocks.

python-can returns one object for each frame; only this module handles these objects.  Its
`Notifier` is not used: an exception in a listener or in `recv` ends its thread without a message.
"""

from __future__ import annotations

import contextlib
import logging
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from operator import index
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from dbc.frames import LENGTH_ALLOWED, FrameBatch, FrameFlag

from ..bench.config import BusConfig
from .slcan import open_slcan
from .socketcan import drop_counter, enlarge_buffer, keep_to_own_group, open_socketcan, socket_of
from .source import BLOCK_FRAMES, GATHER_S, REPLUG, STEADY_CLOCK, BusError, FrameSource, HopLosses

# Converts python-can's messages to the columns of a block -----------------------------------------

_FLAGS = {
    "is_extended_id": FrameFlag.EXTENDED,
    "is_remote_frame": FrameFlag.REMOTE,
    "is_error_frame": FrameFlag.ERROR,
    "is_fd": FrameFlag.FD,
    "bitrate_switch": FrameFlag.BITRATE_SWITCH,
    "error_state_indicator": FrameFlag.ERROR_STATE,
}
"""Flag of a frame by attribute of a message."""


def _frame_fields(message: can.Message, arrived_ns: int) -> tuple[int, int, int, int, bytes]:
    """Return time stamp (0: that of the arrival), identifier, flags, length and payload.

    Raises ValueError, TypeError or OverflowError if it cannot be a frame: backends need not check.
    """
    flags = sum(int(flag) for name, flag in _FLAGS.items() if getattr(message, name))
    flags |= 0 if message.is_rx else FrameFlag.TRANSMITTED
    can_id, length, payload = index(message.arbitration_id), index(message.dlc), message.data
    is_fd, is_remote = bool(flags & FrameFlag.FD), bool(flags & FrameFlag.REMOTE)
    id_bits = 29 if flags & (FrameFlag.EXTENDED | FrameFlag.ERROR) else 11
    is_allowed = 0 <= length <= 64 and LENGTH_ALLOWED[int(is_fd), length]
    if not 0 <= can_id < 1 << id_bits or not is_allowed or (is_fd and is_remote):
        raise ValueError("no identifier or length of a frame")
    if len(payload) != (0 if is_remote else length):
        raise ValueError("another payload than the length says")
    t_ns, stamp_s = 0, message.timestamp
    # Difference from the host's clock, s, above which a stamp has another epoch (boot, reset).
    if abs(stamp_s - arrived_ns * 1e-9) < 86_400.0:  # False for NaN
        # Near 1.8e18 a float64 of nanoseconds steps by 256, and one of seconds by 238 ns.
        whole_s = int(stamp_s)
        t_ns = whole_s * 1_000_000_000 + round((stamp_s - whole_s) * 1e9)
    return t_ns, can_id, flags, length, bytes(payload)


def messages_of(frames: FrameBatch, start_ns: int = 0) -> Iterator[can.Message]:
    """Yield frames as messages of python-can, stamped in seconds from `start_ns`."""
    # Half a nanosecond is added, because the BLF writer truncates digits instead of rounding.
    since_s = ((frames.t_ns - start_ns) + 0.5) * 1e-9
    columns = (since_s, frames.can_id, frames.flags, frames.bus, frames.length)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    payload, width = frames.data.tobytes(), frames.data.shape[1]
    for i, (time_s, can_id, flags, bus, length) in enumerate(rows):
        yield can.Message(
            timestamp=time_s,
            arbitration_id=can_id,
            is_rx=not flags & FrameFlag.TRANSMITTED,
            channel=bus,
            dlc=length,
            data=None if flags & FrameFlag.REMOTE else payload[i * width : i * width + length],
            **{name: bool(flags & flag) for name, flag in _FLAGS.items()},
        )


# Opens the interfaces -----------------------------------------------------------------------------

_QUEUED = {"ixxat", "kvaser", "pcan", "vector", "virtual", "socketcan", "udp_multicast"}
"""Interfaces that stamp frames and have a long queue, in which they may gather."""
_WALL_CLOCK = {"udp_multicast", "socketcan", "iscan", "neousys", "robotell", "seeedstudio"}
"""Interfaces whose frames are stamped by the host's wall clock."""
_OPTIONS: dict[str, dict[str, Any]] = {
    # The simulated car has its own clock; real time would make a fast replay meaningless.
    "virtual": {"preserve_timestamps": True},
    # This bus has no wires, and simulated frames must not reach other machines.
    "udp_multicast": {"hop_limit": 0},
}
_ADVICE = {
    "socketcan": "see `ip link`; `sudo ip link set {channel} up type can bitrate {bitrate}` brings "
    "a bus up",
    "slcan": "channel is the serial device, like /dev/ttyACM0 or /dev/ttyUSB0@115200",
    "udp_multicast": "channel is a multicast group, like 239.74.163.2",
}

# python-can logs every vendor library that is not installed.
logging.getLogger("can").addHandler(logging.NullHandler())


def open_source(config: BusConfig, bus: int) -> FrameSource:
    """Open a bus for reading; its frames have the number `bus` in `FrameBatch.bus`.

    Raises BusError if there is no such interface or it cannot be opened, for any reason.
    """
    with _backend_errors(config):
        if config.interface == "slcan":  # python-can reads byte by byte: too slow for a full bus
            return open_slcan(config.channel, config.bitrate, bus)
        if config.interface == "socketcan" and sys.platform == "linux" and sys.maxsize > 1 << 32:
            return open_socketcan(config.channel, bus)
    opened = open_bus(config)
    gather_s = GATHER_S if config.interface in _QUEUED else 0.0
    clock = (time.time_ns, STEADY_CLOCK.from_wall) if config.interface in _WALL_CLOCK else ()
    return PythonCanSource(opened, _name(config), bus, gather_s, *clock)


def open_bus(config: BusConfig) -> can.BusABC:
    """Open a bus for sending, or for `open_source`; raises BusError as that does."""
    channel: str | int | None = config.channel or None  # None: the interface's own first channel
    if config.channel.isdecimal() and config.interface != "usb2can":  # its digits are a name
        channel = int(config.channel)
    with _backend_errors(config):
        bus = can.Bus(
            channel=channel,
            interface=config.interface,
            ignore_config=True,  # only bench.toml decides, not a can.conf elsewhere
            bitrate=config.bitrate,
            **_OPTIONS.get(config.interface, {}),
        )
    with contextlib.suppress(Exception), socket_of(bus.fileno) as sock:  # most are no socket
        enlarge_buffer(sock)
        keep_to_own_group(sock)  # udp_multicast: that of its channel
    return bus


@contextlib.contextmanager
def open_buses(configs: Sequence[BusConfig]) -> Iterator[tuple[can.BusABC, ...]]:
    """Open buses for sending, and close them at the end; raises BusError as `open_source`."""
    with contextlib.ExitStack() as stack:
        yield tuple(stack.enter_context(open_bus(config)) for config in configs)


def _name(config: BusConfig) -> str:
    """Return the name of a bus for messages, like `socketcan can0`."""
    return f"{config.interface} {config.channel}".rstrip()


@contextlib.contextmanager
def _backend_errors(config: BusConfig) -> Iterator[None]:
    """Convert any exception of a backend on opening to a BusError, whose text is one line."""
    known = sorted({*can.VALID_INTERFACES, "slcan"})
    if config.interface not in known:
        problem = f"python-can has no interface {config.interface!r}"
        raise BusError(_name(config), problem, f"name one of {', '.join(known)}")
    try:
        yield
    except BusError:
        raise
    except Exception as error:
        reason = _reason(error)
        if isinstance(error, NameError | AttributeError | ImportError):  # of a vendor's library
            reason = "its driver does not load"
        elif isinstance(error, TypeError) and not config.channel:
            reason = "no channel is named"
        vendors = "check channel and cable, and that the driver of its vendor is installed"
        advice = _ADVICE.get(config.interface, vendors)
        advice = advice.format(channel=config.channel, bitrate=config.bitrate)
        raise BusError(_name(config), f"cannot be opened: {reason}", advice) from error


def _reason(error: BaseException) -> str:
    """Return the text of an exception, with that of the system's error which caused it."""
    text, cause = str(error) or type(error).__name__, error.__cause__
    return f"{text}: {cause}" if isinstance(cause, OSError) and str(cause) not in text else text


# Reads them ---------------------------------------------------------------------------------------


class PythonCanSource:
    """A python-can bus, open, read in blocks of frames with the bus number `index`.

    `gather_s`: time, s, for which stamped frames may collect in the interface; `recv` is then never
    let wait: backends measure its wait by the wall clock, which may be set.  With 0 each
    frame is read when it arrives, and the block ends `GATHER_S` after the first.  `now_ns`: the
    host's clock. `on_axis`: converts stamps of the wall clock, (n,) int64
    (`SteadyClock.from_wall`).
    """

    def __init__(
        self,
        bus: can.BusABC,
        name: str,
        index: int,
        gather_s: float = 0.0,
        now_ns: Callable[[], int] = STEADY_CLOCK.now_ns,
        on_axis: Callable[[NDArray[np.int64]], NDArray[np.int64]] | None = None,
    ) -> None:
        self.name = name
        self._bus, self._index, self._gather_s = bus, index, gather_s
        self._now_ns, self._on_axis = now_ns, on_axis
        self._dropped = self._garbled = self._restamped = self._garbled_in_a_row = 0

    def read(self, timeout_s: float) -> FrameBatch:
        """Return a block of at most `BLOCK_FRAMES` frames; see `FrameSource`."""
        received: list[tuple[can.Message, int]] = []  # with the time of arrival, ns
        end_s = time.monotonic() + timeout_s
        # Frames that gather in the interface are asked for; otherwise `recv` waits for each.
        while len(received) < BLOCK_FRAMES:
            wait_s = 0.0 if self._gather_s and received else max(end_s - time.monotonic(), 0.0)
            try:
                message = self._bus.recv(0.0 if self._gather_s else wait_s)
            except Exception as error:  # backends also raise ValueError, IndexError, NameError...
                self._garbled_in_a_row += 1
                # After so many consecutive unreadable pieces the interface counts as lost.
                if _is_fault(error) or self._garbled_in_a_row >= 10_000:
                    if received:
                        break  # the next call raises
                    raise BusError(self.name, f"has gone: {_reason(error)}", REPLUG) from error
                self._garbled += 1
                continue
            self._garbled_in_a_row = 0
            if message is not None:
                received.append((message, self._now_ns()))
                if len(received) == 1:
                    time.sleep(self._gather_s)
                    end_s = time.monotonic() + GATHER_S
            elif received or not wait_s:
                break
            elif self._gather_s:
                time.sleep(min(wait_s, GATHER_S))
        return self._batch(received)

    def losses(self) -> HopLosses:
        """Return the losses; for a socket the kernel's, because python-can reports none."""
        with contextlib.suppress(Exception), socket_of(self._bus.fileno) as sock:
            self._dropped = drop_counter(sock) or self._dropped
        return HopLosses(self._dropped, self._garbled, self._restamped)

    def close(self) -> None:
        """Shut the bus down."""
        self.losses()  # the last count that can be read
        with contextlib.suppress(Exception):  # some backends cannot close a lost device
            self._bus.shutdown()

    def _batch(self, received: list[tuple[can.Message, int]]) -> FrameBatch:
        """Return the messages that are frames, stamped on arrival where they have no stamp."""
        rows = []
        for message, arrived_ns in received:
            try:
                stamp_ns, can_id, flags, length, payload = _frame_fields(message, arrived_ns)
            except (TypeError, ValueError, OverflowError):
                self._garbled += 1
            else:
                self._restamped += not stamp_ns
                rows.append((stamp_ns or arrived_ns, can_id, flags, self._index, length, payload))
        frames = FrameBatch.from_rows(rows)
        return replace(frames, t_ns=self._on_axis(frames.t_ns)) if self._on_axis else frames


def _is_fault(error: BaseException) -> bool:
    """Return whether an exception is a fault of the interface, not of input that it could not read.

    A fault has an error of the operating system as its cause, or no other cause than the backend
    itself; unreadable input has the exception of a parser as its cause.
    """
    causes: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and cause not in causes:  # a driver may raise one object repeatedly
        causes.append(cause)
        cause = cause.__cause__ or cause.__context__
    is_of_backend = isinstance(error, can.CanError) and len(causes) == 1
    return is_of_backend or any(isinstance(each, OSError) for each in causes)
