"""Extracts CAN frames from captured packets: SocketCAN packets, and Linux cooked ones."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch
from dbc.words import counted

from .assemble import count_impossible_ids, flags_of, good_frames, numbers_at
from .losses import Ledger

SOCKET_CAN, COOKED, COOKED_2 = 227, 113, 276
"""Link types."""
_HEAD_BYTES = {SOCKET_CAN: 0, COOKED: 16, COOKED_2: 20}
_CAN, _CAN_FD = 0x000C, 0x000D
_OUTGOING = 4
_BRS, _ESI, _FDF = 1, 2, 4
_EXTENDED, _REMOTE, _ERROR = 1 << 31, 1 << 30, 1 << 29
_FD_PACKET_BYTES = 72


@dataclass(slots=True)
class Packets:
    """The packets in a block of bytes."""

    t_ns: list[int] = field(default_factory=list)
    """Time stamps, ns since 1970 UTC."""
    bus: list[int] = field(default_factory=list)
    """Bus numbers."""
    sent: list[bool] = field(default_factory=list)
    """True for packets that this host sent."""
    link: list[int] = field(default_factory=list)
    """Link types."""
    start: list[int] = field(default_factory=list)
    """Start of each packet in the block."""
    size: list[int] = field(default_factory=list)
    """Number of bytes of each packet."""

    def add(self, t_ns: int, bus: int, sent: bool, link: int, start: int, size: int) -> None:
        """Add a packet."""
        self.t_ns.append(t_ns)
        self.bus.append(bus)
        self.sent.append(sent)
        self.link.append(link)
        self.start.append(start)
        self.size.append(size)


class FrameCutter:
    """Converts packets to frames; remembers the byte order that the first ones have shown."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._cooked_is_big: bool | None = None
        self._buses: dict[int, int] = {}

    def frames(self, held: bytes, packets: Packets) -> FrameBatch:
        """Return the CAN frames among packets of a block of bytes."""
        text = np.frombuffer(held + bytes(128), np.uint8)
        start = np.array(packets.start, np.int64)
        size = np.array(packets.size, np.int64)
        link = np.array(packets.link, np.int64)
        bus = np.array(packets.bus, np.int64)
        sent = np.array(packets.sent, bool)
        can, fd_packet = np.ones(len(start), bool), np.zeros(len(start), bool)
        for kind in (COOKED, COOKED_2):
            rows = np.flatnonzero(link == kind)
            if not len(rows):
                continue
            at = start[rows]
            protocol = numbers_at(text, at + (14 if kind == COOKED else 0), ">u2")
            outgoing = numbers_at(text, at, ">u2") if kind == COOKED else text[at + 10]
            can[rows] = (protocol == _CAN) | (protocol == _CAN_FD)
            can[rows] &= size[rows] > _HEAD_BYTES[kind]
            fd_packet[rows] = protocol == _CAN_FD
            sent[rows] |= outgoing == _OUTGOING
            if kind == COOKED_2:
                bus[rows] = [self._bus(index) for index in numbers_at(text, at + 4, ">u4").tolist()]
            start[rows] += _HEAD_BYTES[kind]
            size[rows] -= _HEAD_BYTES[kind]
        rows = np.flatnonzero(can)
        t_ns = np.array(packets.t_ns, np.int64)
        return self._cut(
            text, t_ns[rows], start[rows], size[rows], link[rows], bus[rows], sent[rows],
            fd_packet[rows],
        )  # fmt: skip

    def _cut(
        self,
        text: NDArray[np.uint8],
        t_ns: NDArray[np.int64],
        start: NDArray[np.int64],
        size: NDArray[np.int64],
        link: NDArray[np.int64],
        bus: NDArray[np.int64],
        sent: NDArray[np.bool_],
        fd_packet: NDArray[np.bool_],
    ) -> FrameBatch:
        word, turned = (numbers_at(text, start, kind) for kind in (">u4", "<u4"))
        cooked = link != SOCKET_CAN
        if self._cooked_is_big is None and cooked.any():
            # Older versions of libpcap wrote them in the byte order of the host, newer ones in
            # network order, which is taken where both are possible.
            big, little = _plausible(word[cooked]).sum(), _plausible(turned[cooked]).sum()
            self._cooked_is_big = bool(big >= little)
        if not self._cooked_is_big:
            word = np.where(cooked, turned, word)
        length = text[start + 4].astype(np.int64)
        bits = text[start + 5]
        error, remote = word & _ERROR != 0, word & _REMOTE != 0
        extended = (word & _EXTENDED != 0) & ~error
        fd = (bits & _FDF != 0) | fd_packet | (size == _FD_PACKET_BYTES) | (length > 8)
        fd &= ~remote & ~error
        can_id = word & 0x1FFF_FFFF
        good = (size >= 8 + np.where(remote, 0, length)) & (length <= np.where(fd, 64, 8))
        if bad := len(good) - int(good.sum()):
            note = counted(bad, "packet is not a CAN frame", "packets are not CAN frames")
            self._ledger.garbled(bad, note)
        good &= count_impossible_ids(can_id, extended | error, t_ns, good, self._ledger)
        shown = np.where(good & ~remote, length, 0)
        width = 8 if shown.max(initial=0) <= 8 else 64
        index = (start[:, None] + 8 + np.arange(width)).clip(max=len(text) - 1)
        data = np.where(np.arange(width) < shown[:, None], text[index], 0).astype(np.uint8)
        flags = flags_of(
            len(start),
            extended=extended,
            remote=remote,
            error=error,
            fd=fd,
            bitrate_switch=fd & (bits & _BRS != 0),
            error_state=fd & (bits & _ESI != 0),
            sent=sent,
        )
        return good_frames(good, t_ns, can_id, flags, bus, length, data)

    def _bus(self, index: int) -> int:
        """Return the number of an interface, in the order of first frames."""
        return self._buses.setdefault(index, min(len(self._buses), 255))


def _plausible(word: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return a mask of the numbers that can be an identifier with its flags.

    Kinds of errors have 11 bits, too.
    """
    extended = word & (_EXTENDED | _ERROR) == _EXTENDED
    return np.asarray(extended | (word & 0x1FFF_FFFF < 1 << 11), np.bool_)
