"""Describes and counts the error frames of SocketCAN.

They are not frames of the bus: the driver uses them to report errors of the controller.  The class
is in the identifier (bits of linux/can/error.h), the details are in the payload.
"""

from __future__ import annotations

from enum import IntFlag, StrEnum
from functools import lru_cache
from typing import NamedTuple

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
    PASSIVE = "error-passive"
    BUS_OFF = "bus-off"


_RX_OVERFLOW, _TX_OVERFLOW, _WARNINGS, _PASSIVE, _ACTIVE = 0x01, 0x02, 0x0C, 0x30, 0x40
"""Bits of the controller's byte."""


class ErrorFrame(NamedTuple):
    """The content of an error frame; None for what it does not state."""

    classes: ErrorClass
    state: ControllerState | None
    """State of the controller after the error."""
    tx_errors: int | None
    rx_errors: int | None
    """Transmit and receive error counter of the controller."""
    overrun: bool
    """True if the controller has lost received frames."""
    text: str
    """The whole content as text in one line."""


@lru_cache(4096)
def describe_error_frame(can_id: int, data: bytes) -> ErrorFrame:
    """Return the content of an error frame.

    The counters are valid if the frame says so (Linux 6.0), or if they are not zero and the frame
    reports a change of state, as from older drivers.  `can_id`: identifier, with or without its
    flag bits.  `data`: payload; missing bytes (of 8) count as zero, which means "not specified".
    """
    classes = ErrorClass(can_id & sum(ErrorClass))  # unknown bits are left out
    _, controller, _, _, _, _, tx, rx = data[:8].ljust(8, b"\0")
    if ErrorClass.CONTROLLER not in classes:
        controller = 0  # the byte then has another meaning
    changed = classes & (ErrorClass.CONTROLLER | ErrorClass.BUS_OFF)
    is_counted = ErrorClass.COUNTERS in classes or bool(changed and (tx or rx))
    state = None
    if ErrorClass.BUS_OFF in classes:
        state = ControllerState.BUS_OFF
    elif controller & _PASSIVE:
        state = ControllerState.PASSIVE
    elif controller & (_WARNINGS | _ACTIVE) or ErrorClass.RESTARTED in classes:
        state = ControllerState.ACTIVE
    elif is_counted:  # the limit of ISO 11898-1
        state = ControllerState.PASSIVE if max(tx, rx) >= 128 else ControllerState.ACTIVE
    parts = [
        name.lower().replace("_", " ")
        for name, error_class in ErrorClass.__members__.items()
        if error_class in classes and error_class is not ErrorClass.COUNTERS
    ]
    overrun = bool(controller & _RX_OVERFLOW)
    parts += ["receive buffer overflow"] if overrun else []
    parts += ["transmit buffer overflow"] if controller & _TX_OVERFLOW else []
    if is_counted:
        parts.append(f"{tx} transmit and {counted(rx, 'receive error')} counted")
    tx_errors, rx_errors = (tx, rx) if is_counted else (None, None)
    text = ", ".join(parts) or "unknown error"
    return ErrorFrame(classes, state, tx_errors, rx_errors, overrun, text)


def error_frames_of(frames: FrameBatch) -> list[ErrorFrame]:
    """Return the contents of error frames, in order."""
    payload, width = frames.data.tobytes(), frames.data.shape[1]
    return [
        describe_error_frame(can_id, payload[row * width : row * width + 8])
        for row, can_id in enumerate(frames.can_id.tolist())
    ]
