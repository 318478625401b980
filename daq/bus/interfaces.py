"""Opens any interface of python-can and reads its frames in blocks.

python-can returns one object for each frame; only this module and `columns` handle these objects.
Its `Notifier` is not used: an exception in a listener or in `recv` ends its thread without a
message.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import select
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch

from ..bench.config import BusConfig
from ..errors import BusError
from ..python_can import can
from .columns import frame_columns
from .slcan.adapter import open_slcan
from .socket_drops import SocketDrops
from .socketcan.reader import open_socketcan
from .source import BLOCK_FRAMES, GATHER_S, LONG_GATHER_S, FrameSource, SourceLosses
from .steady_clock import STEADY_CLOCK

__all__ = ["FrameSource", "PythonCanSource", "SourceLosses", "open_bus", "open_source"]

FAULTS_UNTIL_GONE = 5
"""Number of consecutive faults after which the interface counts as lost.  Some interfaces report a
single fault and then continue (an interface that was down for a moment)."""
GARBLED_UNTIL_GONE = 10_000
"""Number of consecutive unreadable pieces, without a pause, after which the interface counts as
lost."""
FAULT_PAUSE_S = 0.02
"""Pause after a fault, s, so that a broken interface does not occupy a processor."""
_POLL_S = 0.002
_WALL_CLOCK_WAITS = frozenset({"pcan", "vector", "iscan", "canalystii", "robotell"})
"""Interfaces whose backends wait by the wall clock: if it is set back by an hour, they wait an
hour."""
_STAMPED_BY_KERNEL = frozenset({"socketcan", "udp_multicast"})
"""Interfaces whose frames wait in a socket's buffer, each with its time of arrival."""
_STAMPED_BY_DRIVER = frozenset({"ixxat", "kvaser", "pcan", "vector", "virtual"})
"""Interfaces whose stamped frames wait in a queue for at least a thousand frames."""
_WALL_CLOCK_STAMPS = frozenset(
    {"udp_multicast", "socketcan", "iscan", "neousys", "robotell", "seeedstudio"}
)
"""Interfaces whose frames are stamped by the host's wall clock."""
RECEIVE_BUFFER_BYTES = 8 << 20
"""Receive buffer requested from the kernel, bytes: the default one holds 31 ms of a full bus."""
_SO_RCVBUFFORCE = 33
_IP_MULTICAST_ALL = 49
_IPV6_MULTICAST_ALL = 29
_STRAY_DATAGRAMS = 10_000
"""Datagrams that a multicast socket may have received while it was opened: no buffer holds more."""

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
_DRIVERS = {
    "canalystii": "the Python package canalystii",
    "cantact": "the Python package cantact",
    "etas": "ETAS BOA, for Windows",
    "gs_usb": "the Python package gs_usb, and libusb",
    "iscan": "Thorsis isCAN",
    "ixxat": "IXXAT VCI, for Windows",
    "kvaser": "Kvaser CANlib",
    "neousys": "Neousys WDT_DIO",
    "neovi": "the Python package python-ics, of Intrepid",
    "nican": "NI-CAN, for Windows",
    "nixnet": "NI-XNET, for Windows",
    "pcan": "PEAK PCAN-Basic",
    "systec": "SYS TEC USB-CANmodul, for Windows",
    "usb2can": "8devices USB2CAN, for Windows",
    "vector": "Vector XL Driver Library, for Windows",
}
"""Driver that each interface needs beside python-can."""
_NAMED_CHANNELS = frozenset(
    {"etas", "nican", "nixnet", "pcan", "robotell", "seeedstudio", "serial", "slcan", "socketcan"}
    | {"socketcand", "udp_multicast", "usb2can", "virtual"}
)
"""Interfaces whose channel is a name even if it consists of digits; all others count channels."""

# python-can logs every vendor library that is not installed.
logging.getLogger("can").addHandler(logging.NullHandler())


def open_source(config: BusConfig, bus: int) -> FrameSource:
    """Open a bus for reading; its frames have the number `bus` in `FrameBatch.bus`.

    Raises
    ------
    BusError
        If there is no such interface or it cannot be opened, for any reason.
    """
    if config.interface == "slcan":  # python-can reads byte by byte: too slow for a full bus
        with _one_line(config):
            return open_slcan(config.channel, config.bitrate, bus)
    if config.interface == "socketcan" and sys.platform == "linux" and sys.maxsize > 1 << 32:
        with _one_line(config):
            return open_socketcan(config.channel, bus)
    opened = open_bus(config)
    doze = doze_for(opened, config.interface)
    gathered_s = _gathered_s(opened, config.interface)
    if config.interface in _WALL_CLOCK_STAMPS:
        on_axis = STEADY_CLOCK.from_wall
        return PythonCanSource(opened, _name(config), bus, time.time_ns, doze, on_axis, gathered_s)
    return PythonCanSource(opened, _name(config), bus, doze=doze, gathered_s=gathered_s)


def _gathered_s(bus: can.BusABC, interface: str) -> float:
    """Return the time, s, for which frames may wait unread in an interface."""
    if interface in _STAMPED_BY_KERNEL:
        with contextlib.suppress(Exception), socket.socket(fileno=os.dup(bus.fileno())) as twin:
            if twin.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) >= RECEIVE_BUFFER_BYTES:
                return LONG_GATHER_S
    return GATHER_S if interface in _STAMPED_BY_KERNEL | _STAMPED_BY_DRIVER else 0.0


def open_bus(config: BusConfig) -> can.BusABC:
    """Open a bus for sending.

    Raises BusError as `open_source`.
    """
    channel: str | int | None = config.channel or None  # None: the interface's own first channel
    if config.channel.isdecimal() and config.interface not in _NAMED_CHANNELS:
        channel = int(config.channel)
    with _one_line(config):
        bus = can.Bus(
            channel=channel,
            interface=config.interface,
            ignore_config=True,  # only bench.toml decides, not a can.conf elsewhere
            bitrate=config.bitrate,
            **_OPTIONS.get(config.interface, {}),
        )
    _tune_socket(bus)
    return bus


@contextlib.contextmanager
def open_buses(configs: Sequence[BusConfig]) -> Iterator[tuple[can.BusABC, ...]]:
    """Open buses for sending, and close them at the end; raises BusError as `open_source`."""
    with contextlib.ExitStack() as stack:
        yield tuple(stack.enter_context(open_bus(config)) for config in configs)


def _name(config: BusConfig) -> str:
    return f"{config.interface} {config.channel}".rstrip()


@contextlib.contextmanager
def _one_line(config: BusConfig) -> Iterator[None]:
    """Convert any exception of a backend on opening (also NameError) to a BusError."""
    if config.interface != "slcan" and config.interface not in can.VALID_INTERFACES:
        known = sorted({*can.VALID_INTERFACES, "slcan"})
        near = get_close_matches(config.interface, known, 1)
        advice = f"did you mean {near[0]}? There are " if near else "name one of "
        what = f"python-can has no interface {config.interface!r}"
        raise BusError(_name(config), what, advice + ", ".join(known))
    try:
        yield
    except BusError:
        raise
    except TypeError as error:
        if config.channel:
            raise _closed(config, _reason(error)) from error
        raise _closed(config, "no channel is named") from error
    except (NameError, AttributeError, ImportError) as error:  # what its library would define
        raise _closed(config, "its driver does not load") from error
    except Exception as error:
        raise _closed(config, _reason(error)) from error


def _closed(config: BusConfig, reason: str) -> BusError:
    advice = _ADVICE.get(config.interface, "check [bus] in bench.toml, cable and driver")
    if driver := _DRIVERS.get(config.interface):
        advice = f"check channel and cable, and that its driver is installed: {driver}"
    advice = advice.format(channel=config.channel, bitrate=config.bitrate)
    return BusError(_name(config), f"cannot be opened: {reason}", advice)


def _reason(error: BaseException) -> str:
    text = str(error) or type(error).__name__
    cause = error.__cause__
    return f"{text}: {cause}" if isinstance(cause, OSError) and str(cause) not in text else text


def _tune_socket(bus: can.BusABC) -> None:
    """Set the buffer of a bus that is a socket, so that it survives a stall of this process.

    A multicast socket is also limited to its own group: by default it receives every group that any
    process of this machine has joined.  Frames of other groups that arrived while it was opened are
    thrown away.
    """
    try:
        twin = socket.socket(fileno=os.dup(bus.fileno()))
    except Exception:  # not a socket, no descriptor, not implemented: nothing to tune
        return
    options = [
        (socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES),
        (socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES),
    ]
    if twin.family == socket.AF_INET:
        options.append((socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0))
    elif twin.family == socket.AF_INET6:
        options.append((socket.IPPROTO_IPV6, _IPV6_MULTICAST_ALL, 0))
    with twin:
        for level, option, value in options if sys.platform == "linux" else options[:1]:
            with contextlib.suppress(OSError):  # SO_RCVBUFFORCE needs a privilege
                twin.setsockopt(level, option, value)
        if sys.platform == "linux" and twin.family in (socket.AF_INET, socket.AF_INET6):
            with contextlib.suppress(OSError):  # until none waits; a busy bus never ends
                for _ in range(_STRAY_DATAGRAMS):
                    twin.recv(1, socket.MSG_DONTWAIT)


Doze = Callable[[float], object]
"""Sleeps for a number of seconds, or until a frame may have arrived."""


def doze_for(bus: can.BusABC, interface: str) -> Doze | None:
    """Return a function that waits for the bus; None if the backend itself waits correctly."""
    try:
        descriptor = bus.fileno()
    except Exception:  # not implemented, or only on another system
        descriptor = -1
    if descriptor >= 0 and hasattr(select, "poll"):
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        return lambda left_s: poll.poll(math.ceil(left_s * 1e3))
    if interface in _WALL_CLOCK_WAITS:
        return lambda left_s: time.sleep(min(left_s, _POLL_S))
    return None


class PythonCanSource:
    """A python-can bus read in blocks.

    `BusABC.recv` measures its timeout by the wall clock: if that is set back an hour while it
    waits, it waits for another hour.  So this class calls the backend's `_recv_internal`.

    `bus`: open; closed by `close`.  `name`: name of the bus in messages.  `index`: number of the
    bus in its frames.  `now_ns`: the host's clock, ns since 1970.  `doze`: waits instead of the
    backend, which is then only asked for frames that have arrived; with None the backend waits.
    `on_axis`: converts stamps of the wall clock, (n,) int64 (`SteadyClock.from_wall`).
    `gathered_s`: time, s, for which frames may collect in the interface after the first one; with 0
    each frame is read when it arrives, and the block ends `GATHER_S` after the first.
    """

    def __init__(
        self,
        bus: can.BusABC,
        name: str,
        index: int,
        now_ns: Callable[[], int] = STEADY_CLOCK.now_ns,
        doze: Doze | None = None,
        on_axis: Callable[[NDArray[np.int64]], NDArray[np.int64]] | None = None,
        gathered_s: float = 0.0,
    ) -> None:
        self.name = name
        self._bus = bus
        self._index = index
        self._now_ns = now_ns
        self._doze = doze
        self._on_axis = on_axis
        self._gathered_s = gathered_s
        self._drops = SocketDrops(lambda: bus.fileno())
        self._garbled = 0
        self._restamped = 0
        self._faults_in_a_row = 0
        self._garbled_in_a_row = 0

    def read(self, timeout_s: float) -> FrameBatch:
        """Return a block of at most `BLOCK_FRAMES` frames; see `FrameSource`."""
        messages: list[can.Message] = []
        arrived_ns: list[int] = []
        wait_s, deadline_s = timeout_s, 0.0
        while len(messages) < BLOCK_FRAMES:
            try:
                if messages and self._gathered_s:
                    self._drain(messages, arrived_ns)
                    break
                message = self._receive(wait_s)
            except Exception as error:  # backends also raise ValueError, IndexError, NameError...
                if self._failed(error):
                    if messages:
                        break  # the next call raises
                    raise self._gone(error) from error
                wait_s = 0.0
                continue
            if message is None and (wait_s == 0.0 or not messages):
                self._faults_in_a_row = self._garbled_in_a_row = 0
                break
            now_s = time.monotonic()
            if message is not None:
                self._faults_in_a_row = self._garbled_in_a_row = 0
                messages.append(message)
                arrived_ns.append(self._now_ns())
                if len(messages) == 1:
                    deadline_s = now_s + GATHER_S
                    time.sleep(self._gathered_s)
            wait_s = max(deadline_s - now_s, 0.0)
        return self._batch(messages, arrived_ns)

    def losses(self) -> SourceLosses:
        """Return the losses; for a socket the kernel's, because python-can reports none."""
        return SourceLosses(self._drops.count(), self._garbled, self._restamped)

    def close(self) -> None:
        """Shut the bus down."""
        self._drops.count()  # the last count that can be read
        with contextlib.suppress(Exception):  # some backends cannot close a lost device
            self._bus.shutdown()

    def _drain(self, messages: list[can.Message], arrived_ns: list[int]) -> None:
        """Add the frames that have arrived, up to the size of a block."""
        receive, now_ns = self._bus._recv_internal, self._now_ns
        while len(messages) < BLOCK_FRAMES:
            message = receive(0.0)[0]
            if message is None:
                break
            messages.append(message)
            arrived_ns.append(now_ns())

    def _receive(self, wait_s: float) -> can.Message | None:
        """Return the next frame; wait up to `wait_s` for it."""
        if self._doze is None or wait_s == 0.0:
            return self._bus._recv_internal(wait_s)[0]
        end_s = time.monotonic() + wait_s
        while True:
            message = self._bus._recv_internal(0.0)[0]
            left_s = end_s - time.monotonic()
            if message is not None or left_s <= 0:
                return message
            self._doze(left_s)

    def _failed(self, error: Exception) -> bool:
        """Count an exception of `recv`; return whether the bus counts as lost."""
        if _is_fault(error):
            self._faults_in_a_row += 1
            time.sleep(FAULT_PAUSE_S)
        else:
            self._garbled += 1
            self._garbled_in_a_row += 1
        return (
            self._faults_in_a_row >= FAULTS_UNTIL_GONE
            or self._garbled_in_a_row >= GARBLED_UNTIL_GONE
        )

    def _gone(self, error: Exception) -> BusError:
        return BusError(
            self.name, f"has gone: {_reason(error)}", "check plug and power, then start again"
        )

    def _batch(self, messages: list[can.Message], arrived_ns: list[int]) -> FrameBatch:
        if not messages:
            return FrameBatch.empty()
        try:
            batch, garbled, restamped = frame_columns(messages, arrived_ns, self._index)
        except (TypeError, ValueError, OverflowError):  # one of the messages cannot be a frame
            if len(messages) == 1:
                self._garbled += 1
                return FrameBatch.empty()
            half = len(messages) // 2
            first = self._batch(messages[:half], arrived_ns[:half])
            return FrameBatch.concatenate([first, self._batch(messages[half:], arrived_ns[half:])])
        self._garbled += garbled
        self._restamped += restamped
        return replace(batch, t_ns=self._on_axis(batch.t_ns)) if self._on_axis else batch


def _is_fault(error: BaseException) -> bool:
    """Return whether an exception is a fault of the interface, not of input that it could not read.

    A fault has an error of the operating system as its cause, or no other cause than the backend
    itself; unreadable input has the exception of a parser as its cause.
    """
    chain = [error]
    while (before := chain[-1].__cause__ or chain[-1].__context__) is not None:
        if before in chain:  # a driver that raises the same exception object repeatedly
            break
        chain.append(before)
    if any(isinstance(e, OSError) for e in chain):
        return True
    return isinstance(error, can.CanError) and len(chain) == 1
