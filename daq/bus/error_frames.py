"""Describes and counts the error frames of SocketCAN.

They are not frames of the bus: the driver uses them to report errors of the controller.  The class
is in the identifier (bits of linux/can/error.h), the details are in the payload.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag, StrEnum

import numpy as np

from dbc.frames import FrameBatch
from dbc.words import counted


class ErrorClass(IntFlag):
    """Kind of error, as bits of the identifier."""

    TX_TIMEOUT = 0x001
    LOST_ARBITRATION = 0x002
    CONTROLLER = 0x004
    PROTOCOL = 0x008
    TRANSCEIVER = 0x010
    NO_ACK = 0x020
    BUS_OFF = 0x040
    BUS_ERROR = 0x080
    RESTARTED = 0x100
    COUNTERS = 0x200


class ControllerState(StrEnum):
    """Error state of a controller, by its error counters."""

    ACTIVE = "error-active"
    WARNING = "error-warning"
    PASSIVE = "error-passive"
    BUS_OFF = "bus-off"


_CLASSES = {
    ErrorClass.TX_TIMEOUT: "sending timed out",
    ErrorClass.LOST_ARBITRATION: "arbitration lost",
    ErrorClass.CONTROLLER: "controller",
    ErrorClass.PROTOCOL: "protocol violated",
    ErrorClass.TRANSCEIVER: "transceiver",
    ErrorClass.NO_ACK: "no node acknowledges",
    ErrorClass.BUS_OFF: "bus-off",
    ErrorClass.BUS_ERROR: "bus error",
    ErrorClass.RESTARTED: "controller restarted",
}
_RX_OVERFLOW, _TX_OVERFLOW = 0x01, 0x02
_CONTROLLER = {
    _RX_OVERFLOW: "receive buffer overflow",
    _TX_OVERFLOW: "transmit buffer overflow",
    0x04: "many receive errors",
    0x08: "many transmit errors",
    0x10: "passive by receive errors",
    0x20: "passive by transmit errors",
    0x40: "error-active again",
}
_STATES = {  # bits of the controller byte, the most severe last
    0x40: ControllerState.ACTIVE,
    0x0C: ControllerState.WARNING,
    0x30: ControllerState.PASSIVE,
}
_VIOLATIONS = {
    0x01: "single bit",
    0x02: "frame format",
    0x04: "bit stuffing",
    0x08: "dominant bit not sent",
    0x10: "recessive bit not sent",
    0x20: "overload",
    0x40: "active error flag",
    0x80: "while sending",
}


@dataclass(frozen=True, slots=True)
class ErrorFrame:
    """The content of an error frame."""

    classes: ErrorClass
    state: ControllerState | None
    """State of the controller after the error; None if the frame does not state it."""
    tx_errors: int | None
    """Transmit error counter of the controller; None if the frame does not state it."""
    rx_errors: int | None
    """Receive error counter of the controller; None if the frame does not state it."""
    overrun: bool
    """True if the controller has lost received frames."""
    text: str
    """The whole content as text in one line."""


def describe_error_frame(can_id: int, data: bytes) -> ErrorFrame:
    """Return the content of an error frame.

    The counters are valid if the frame says so (Linux 6.0), or if they are not zero and the frame
    reports a change of state, as from older drivers.

    `can_id`: identifier, with or without its flag bits.  `data`: payload; missing bytes (of 8)
    count as zero, which means "not specified".
    """
    classes = ErrorClass(can_id & 0x1FFFFFFF & sum(ErrorClass))
    _, controller, violation, _, _, _, tx, rx = data[:8].ljust(8, b"\0")
    controller *= ErrorClass.CONTROLLER in classes
    is_counted = ErrorClass.COUNTERS in classes or bool(
        classes & (ErrorClass.CONTROLLER | ErrorClass.BUS_OFF) and (tx or rx)
    )
    details = {
        ErrorClass.CONTROLLER: _named(_CONTROLLER, controller),
        ErrorClass.PROTOCOL: _named(_VIOLATIONS, violation),
    }
    parts = [
        f"{text} ({detail})" if (detail := details.get(bit, "")) else text
        for bit, text in _CLASSES.items()
        if bit in classes
    ]
    if is_counted:
        parts.append(f"{tx} transmit and {counted(rx, 'receive error')} counted")
    return ErrorFrame(
        classes,
        _state(classes, controller, max(tx, rx) if is_counted else None),
        tx if is_counted else None,
        rx if is_counted else None,
        bool(controller & _RX_OVERFLOW),
        ", ".join(parts) or "unknown error",
    )


@dataclass(frozen=True, slots=True)
class ErrorTally:
    """Summary of the error frames of one bus in a block."""

    frames: int
    """Number of error frames."""
    bus_off: int
    """Number of error frames that report bus-off."""
    overruns: int
    """Number of error frames that report lost received frames."""
    state: ControllerState | None
    """The last state reported; None if there is none."""
    state_row: int
    """Row of the frame that reported it; -1 if there is none."""
    tx_errors: int | None
    """The last transmit error counter reported; None if there is none."""
    rx_errors: int | None
    """The last receive error counter reported; None if there is none."""
    text: str
    """Text of the last error frame."""


def tally_error_frames(frames: FrameBatch) -> ErrorTally:
    """Return the summary of one or more error frames; fast enough for thousands per second."""
    classes = frames.can_id
    controller = np.where(classes & ErrorClass.CONTROLLER, frames.data[:, 1], 0)
    off = (classes & ErrorClass.BUS_OFF) != 0
    changed = (classes & (ErrorClass.CONTROLLER | ErrorClass.BUS_OFF)) != 0
    is_counted = (classes & ErrorClass.COUNTERS) != 0
    is_counted |= changed & (frames.data[:, 6:8].any(axis=1))
    named = (controller & sum(_STATES)) != 0
    has_state = off | named | is_counted | ((classes & ErrorClass.RESTARTED) != 0)
    rows = np.arange(len(frames))
    state_row = int(rows[has_state].max(initial=-1))
    counted_row = int(rows[is_counted].max(initial=-1))
    with_state, numbers = (
        describe_error_frame(int(classes[row]), frames.data[row].tobytes())
        for row in (state_row, counted_row)
    )
    last = describe_error_frame(int(classes[-1]), frames.data[-1].tobytes())
    return ErrorTally(
        len(frames),
        int(np.count_nonzero(off)),
        int(np.count_nonzero(controller & _RX_OVERFLOW)),
        with_state.state if state_row >= 0 else None,
        state_row,
        numbers.tx_errors if counted_row >= 0 else None,
        numbers.rx_errors if counted_row >= 0 else None,
        last.text,
    )


def _state(classes: ErrorClass, controller: int, errors: int | None) -> ControllerState | None:
    if ErrorClass.BUS_OFF in classes:
        return ControllerState.BUS_OFF
    named = [state for bits, state in _STATES.items() if controller & bits]
    if named:
        return named[-1]
    if ErrorClass.RESTARTED in classes:
        return ControllerState.ACTIVE
    if errors is None:
        return None
    if errors < 96:
        return ControllerState.ACTIVE
    return ControllerState.WARNING if errors < 128 else ControllerState.PASSIVE


def _named(names: dict[int, str], bits: int) -> str:
    return ", ".join(name for bit, name in names.items() if bits & bit)
