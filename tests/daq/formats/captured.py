"""Packets of SocketCAN and what the reader of captures makes of them, for its tests."""

from __future__ import annotations

import io
import struct

from daq.formats.capture import read_capture
from daq.formats.losses import Ledger, LogLoss
from dbc import FrameBatch

from .shown import shown

SOCKET_CAN = 227
EIGHT = bytes(range(1, 9))


def can_packet(
    can_id: int = 0x123,
    length: int = 8,
    bits: int = 0,
    data: bytes = EIGHT,
    order: str = ">",
) -> bytes:
    """Return a packet of SocketCAN."""
    return struct.pack(f"{order}L", can_id) + bytes([length, bits, 0, 0]) + data


def read(raw: bytes) -> tuple[list[str], LogLoss]:
    """Return the frames of a capture, as `shown`, and what was lost."""
    ledger = Ledger()
    batches = list(read_capture(io.BytesIO(raw), "a.pcap", ledger))
    return shown(FrameBatch.concatenate(batches)), ledger.loss
