"""An MF4 as a logger leaves it behind, encoded here from the public description."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from .mixed import START_S, Frame

Frames = Sequence[Frame]
FD_CODES = {length: code for code, length in enumerate([*range(9), 12, 16, 20, 24, 32, 48, 64])}


class Mdf:
    """An MDF 4 file in the making: blocks behind each other, links set afterwards."""

    def __init__(self, unfinished: bool) -> None:
        head = b"UnFinMF " if unfinished else b"MDF     "
        flags = 0b100101 if unfinished else 0  # counts, last length, bytes of variable records
        head += b"4.11    " + b"tests   " + bytes(4) + struct.pack("<H", 411) + bytes(30)
        self.raw = bytearray(head + struct.pack("<HH", flags, 0))

    def block(self, kind: str, links: Sequence[int], body: bytes) -> int:
        self.raw += bytes(-len(self.raw) % 8)
        at = len(self.raw)
        size = 24 + 8 * len(links) + len(body)
        self.raw += struct.pack(
            f"<4s4xQQ{len(links)}Q", b"##" + kind.encode(), size, len(links), *links
        )
        self.raw += body
        return at

    def link(self, at: int, place: int, target: int) -> None:
        struct.pack_into("<Q", self.raw, at + 24 + 8 * place, target)

    def text(self, text: str) -> int:
        return self.block("TX", [], text.encode() + b"\0")

    def linear(self, offset: float, factor: float) -> int:
        body = struct.pack("<BBHHH4d", 1, 0, 0, 0, 2, 0.0, 0.0, offset, factor)
        return self.block("CC", [0, 0, 0, 0], body)

    def channel(
        self,
        name: str,
        place: tuple[int, int, int],
        kind: int = 0,
        *,
        role: int = 0,
        sync: int = 0,
        conversion: int = 0,
        data: int = 0,
        inner: int = 0,
    ) -> int:
        byte, bit, bits = place
        body = struct.pack(
            "<BBBBLLLLBBH6d", role, sync, kind, bit, byte, bits, 0, 0, 0, 0, 0, *[0] * 6
        )
        links = [0, inner, self.text(name), 0, conversion, data, 0, 0]
        return self.block("CN", links, body)

    def chained(self, blocks: Sequence[int]) -> int:
        for first, second in pairwise(blocks):
            self.link(first, 0, second)
        return blocks[0]

    def group(self, number: int, channels: int, record_bytes: int, flags: int = 0) -> int:
        body = struct.pack("<QQHH4xLL", number, 0, flags, ord("."), record_bytes, 0)
        return self.block("CG", [0, channels, 0, 0, 0, 0], body)


def write_logger_mf4(path: Path, frames: Frames) -> None:
    """Write what a logger leaves behind: kinds mixed, payloads apart, counts and lengths unwritten.

    Data frames have payloads of variable length; remote frames name bus and direction as constants.
    """
    mdf = Mdf(unfinished=True)
    mdf.block("HD", [0] * 6, struct.pack("<QhhBBBBdd", START_S * 10**9, 60, 0, 2, 0, 0, 0, 0, 0))
    payloads = mdf.group(2, 0, 0, flags=1)
    kind = "CAN_DataFrame"
    fields = {
        "BusChannel": (8, 0, 2), "ID": (9, 0, 29), "IDE": (12, 7, 1), "DLC": (13, 0, 4),
        "DataLength": (14, 0, 7), "Dir": (13, 4, 1), "EDL": (13, 5, 1), "BRS": (13, 6, 1),
        "ESI": (13, 7, 1),
    }  # fmt: skip
    inner = [mdf.channel(f"{kind}.{name}", place) for name, place in fields.items()]
    inner.append(mdf.channel(f"{kind}.DataBytes", (15, 0, 64), 10, role=1, data=payloads))
    whole = mdf.channel(kind, (8, 0, 120), 10, inner=mdf.chained(inner))
    time = mdf.channel("t", (0, 0, 64), 4, role=2, sync=1, conversion=mdf.linear(0.0, 1e-9))
    data = mdf.group(1, mdf.chained([time, whole]), 23)

    kinds = [data, payloads]
    for number, kind in ((3, "CAN_RemoteFrame"), (4, "CAN_ErrorFrame")):
        for bus in range(3):
            constant = mdf.channel(
                f"{kind}.BusChannel", (0, 0, 0), role=6, conversion=mdf.linear(bus + 1, 0)
            )
            inner = [constant] + [
                mdf.channel(f"{kind}.{name}", place)
                for name, place in {"ID": (6, 0, 29), "IDE": (9, 7, 1), "Dir": (10, 4, 1)}.items()
            ]
            inner.append(mdf.channel(f"{kind}.DLC", (10, 0, 4)))
            if number == 4:
                inner.append(mdf.channel(f"{kind}.DataBytes", (11, 0, 64), 10))
            whole = mdf.channel(kind, (6, 0, 104), 10, inner=mdf.chained(inner))
            time = mdf.channel("t", (0, 0, 48), 0, role=2, sync=1, conversion=mdf.linear(0.0, 1e-6))
            kinds.append(mdf.group(8 * number + bus, mdf.chained([time, whole]), 19))
    for first, second in pairwise(kinds):
        mdf.link(first, 0, second)
    content = mdf.block("DT", [], b"")
    group = mdf.block("DG", [0, kinds[0], content, 0], bytes([1]) + bytes(7))
    mdf.link(64, 0, group)
    # The data come last: their length was never written.
    moved = mdf.block("DT", [], b"")
    mdf.link(group, 2, moved)
    offset = 0
    for frame in frames:
        number = frame.can_id | frame.extended << 31
        code = FD_CODES[frame.length] if frame.fd else frame.length
        bits = code | frame.sent << 4
        if frame.remote or frame.error:
            kind_id = 8 * (3 if frame.remote else 4) + frame.bus
            mdf.raw += bytes([kind_id]) + frame.t_us.to_bytes(6, "little")
            mdf.raw += struct.pack("<LB8s", number, bits, frame.data)
            continue
        bits |= frame.fd << 5 | frame.brs << 6 | frame.esi << 7
        mdf.raw += b"\1" + struct.pack(
            "<dBLBBQ", frame.t_us * 1e3, frame.bus + 1, number, bits, frame.length, offset
        )
        mdf.raw += b"\2" + struct.pack("<L", frame.length) + frame.data
        offset += 4 + frame.length
    path.write_bytes(mdf.raw)
