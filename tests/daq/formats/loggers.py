"""Logs as loggers and other tools write them, each encoded here from its public description."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path

from .mixed import START_S, Frame

Frames = Sequence[Frame]
FD_CODES = {length: code for code, length in enumerate([*range(9), 12, 16, 20, 24, 32, 48, 64])}
SOCKET_CAN, COOKED, COOKED_2 = 227, 113, 276


def _stamp_ns(frame: Frame) -> int:
    return START_S * 10**9 + frame.t_us * 1000


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


def socket_can(frame: Frame, order: str = ">") -> bytes:
    """Return a frame as it stands in a packet of SocketCAN."""
    number = frame.can_id | frame.extended << 31 | frame.remote << 30 | frame.error << 29
    bits = frame.brs | frame.esi << 1 | frame.fd << 2
    data = frame.data.ljust(64 if frame.fd else 8, b"\0")
    return struct.pack(f"{order}L", number) + bytes([frame.length, bits, 0, 0]) + data


def write_pcap(path: Path, frames: Frames, link: int = SOCKET_CAN, order: str = "<") -> None:
    """Write a capture of one interface, times in ns; cooked ones have the order of the host."""
    parts = [struct.pack(f"{order}LHHlLLL", 0xA1B23C4D, 2, 4, 0, 0, 65535, link)]
    for frame in frames:
        packet = socket_can(frame, ">" if link == SOCKET_CAN else "<")
        protocol = 0x0D if frame.fd else 0x0C
        if link == COOKED:
            packet = struct.pack(">HHH8sH", 4 * frame.sent, 280, 0, b"", protocol) + packet
        elif link == COOKED_2:
            packet = (
                struct.pack(">HHLHBB8s", protocol, 0, 7 + frame.bus, 280, 4 * frame.sent, 0, b"")
                + packet
            )
        seconds, part = divmod(_stamp_ns(frame), 10**9)
        parts += [struct.pack(f"{order}4L", seconds, part, len(packet), len(packet)), packet]
    path.write_bytes(b"".join(parts))


def write_pcapng(path: Path, frames: Frames) -> None:
    """Write a capture of vcan0, vcan1 and vcan2 with their directions, times in ns."""

    def block(kind: int, body: bytes) -> bytes:
        size = struct.pack("<L", 12 + len(body))
        return struct.pack("<L", kind) + size + body + size

    def option(code: int, value: bytes) -> bytes:
        return struct.pack("<HH", code, len(value)) + value + bytes(-len(value) % 4)

    parts = [block(0x0A0D0D0A, struct.pack("<LHHq", 0x1A2B3C4D, 1, 0, -1))]
    for bus in (2, 0, 1):
        about = option(2, f"vcan{bus}".encode()) + option(9, b"\x09") + bytes(4)
        parts.append(block(1, struct.pack("<HHL", SOCKET_CAN, 0, 0) + about))
    for frame in frames:
        packet, stamp = socket_can(frame), _stamp_ns(frame)
        head = struct.pack(
            "<5L", (frame.bus + 1) % 3, stamp >> 32, stamp & 0xFFFFFFFF, len(packet), len(packet)
        )
        about = option(2, struct.pack("<L", 1 + frame.sent)) + bytes(4)
        parts.append(block(6, head + packet + bytes(-len(packet) % 4) + about))
    path.write_bytes(b"".join(parts))


def write_console(path: Path, frames: Frames) -> None:
    """Write what candump -x -t a shows."""
    lines = []
    for f in frames:
        number = f.can_id | 0x20000000 * f.error
        can_id = f"{number:08X}" if f.extended or f.error else f"{number:03X}"
        mark = f"{'TX' if f.sent else 'RX'} {'B' if f.brs else '-'} {'E' if f.esi else '-'}"
        length = f"[{f.length:02d}]" if f.fd else f" [{f.length}]"
        body = "remote request" if f.remote else f.data.hex(" ").upper()
        tail = "   ERRORFRAME" if f.error else ""
        stamp = f"({START_S + f.t_us // 10**6}.{f.t_us % 10**6:06d})"
        lines.append(f" {stamp}  vcan{f.bus}  {mark}  {can_id}  {length}  {body}{tail}\n")
    path.write_text("".join(lines))


def write_gvret(path: Path, frames: Frames) -> None:
    """Write what SavvyCAN saves."""
    width = max(f.length for f in frames)
    lines = ["Time Stamp,ID,Extended,Dir,Bus,LEN," + ",".join(f"D{n + 1}" for n in range(width))]
    for f in frames:
        cells = [str(START_S * 10**6 + f.t_us), f"{f.can_id:08X}", str(f.extended).lower()]
        cells += [
            "Tx" if f.sent else "Rx",
            str(f.bus),
            str(f.length),
            *f.data.hex(" ").upper().split(),
        ]
        lines.append(",".join(cells) + ",")
    path.write_text("\n".join(lines) + "\n")


def write_crtd(path: Path, frames: Frames) -> None:
    """Write CRTD with a bus in front of each kind."""
    lines = [f"{START_S}.000 CXX made for a test\n"]
    for f in frames:
        stamp = f"{START_S + f.t_us // 10**6}.{f.t_us % 10**6:06d}"
        kind = f"{f.bus + 1}{'T' if f.sent else 'R'}{29 if f.extended else 11}"
        lines.append(f"{stamp} {kind} {f.can_id:X} {f.data.hex(' ').upper()}\n")
    path.write_text("".join(lines))


def write_busmaster(path: Path, frames: Frames) -> None:
    """Write a log with the time of day to a tenth of a millisecond."""
    start = datetime.fromtimestamp(START_S)
    lines = [
        "***BUSMASTER Ver 3.2.2***",
        "***PROTOCOL CAN***",
        "***[START LOGGING SESSION]***",
        f"***START DATE AND TIME {start:%d:%m:%Y %H:%M:%S}:000***",
        "***HEX***",
        "***SYSTEM MODE***",
        "***<Time><Tx/Rx><Channel><CAN ID><Type><DLC><DataBytes>***",
    ]
    for f in frames:
        when = start + timedelta(microseconds=f.t_us)
        kind = ("x" if f.extended else "s") + "r" * f.remote
        stamp = f"{when:%H:%M:%S}:{when.microsecond // 100:04d}"
        lines.append(
            f"{stamp} {'Tx' if f.sent else 'Rx'} {f.bus + 1} 0x{f.can_id:X} {kind} {f.length} "
            f"{f.data.hex(' ').upper()}"
        )
    path.write_text(
        "\n".join([*lines, "***END DATE AND TIME***", "***[STOP LOGGING SESSION]***\n"])
    )


def write_ros2(path: Path, frames: Frames, packing: str = "zstd") -> None:
    """Write three topics as rosbag2 does, through the library of the format."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4096, compression=CompressionType[packing.upper()])
        writer.start(profile="ros2", library="tests")
        schemas = {
            name: writer.register_schema(name, "ros2msg", b"uint32 id")
            for name in (
                "can_msgs/msg/Frame",
                "ros2_socketcan_msgs/msg/FdFrame",
                "std_msgs/msg/String",
            )
        }
        classic, flexible, other = schemas.values()
        extra = writer.register_channel("/rosout", "cdr", other)
        channels = [
            {
                False: writer.register_channel(f"/can{bus}", "cdr", classic),
                True: writer.register_channel(f"/can{bus}", "cdr", flexible),
            }
            for bus in range(3)
        ]
        for number, f in enumerate(frames):
            writer.add_message(extra, _stamp_ns(f), b"\0\1\0\0\2\0\0\0a\0", _stamp_ns(f))
            stamp = _stamp_ns(f)
            writer.add_message(channels[f.bus][f.fd], stamp, _cdr(f, number), stamp)
        finish: Callable[[], None] = writer.finish
        finish()


def _cdr(f: Frame, number: int) -> bytes:
    name = f"can{number % 20}".encode() + b"\0"
    seconds, rest = divmod(_stamp_ns(f), 10**9)
    body = struct.pack("<iLL", seconds, rest, len(name)) + name
    body += bytes(-len(body) % 4) + struct.pack("<L", f.can_id)
    if f.fd:
        body += bytes([f.extended, f.error, f.length])
        body += bytes(-len(body) % 4) + struct.pack("<L", len(f.data)) + f.data
    else:
        body += bytes([f.remote, f.extended, f.error, f.length]) + f.data.ljust(8, b"\0")
    return b"\0\1\0\0" + body


WRITERS: dict[str, tuple[str, Callable[[Path, Frames], None]]] = {
    "mf4": (".mf4", write_logger_mf4),
    "pcap": (".pcap", write_pcap),
    "pcapng": (".pcapng", write_pcapng),
    "console": (".txt", write_console),
    "gvret": (".csv", write_gvret),
    "crtd": (".txt", write_crtd),
    "busmaster": (".log", write_busmaster),
    "ros2": (".mcap", write_ros2),
}
"""Suffix and writer of each format."""
