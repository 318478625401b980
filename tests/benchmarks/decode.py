"""Bulk decoding against cantools, frame for frame, and asammdf, in one process."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np
from cantools.database import Database, load_string

from dbc import Codec, FrameBatch, parse_codec

FRAMES = 1_000_000
CANTOOLS_FRAMES = 40_000
MESSAGES = 1000
FIRST_ID = 256


def database_text(messages: int = 4) -> str:
    """Return a DBC of messages of four 16-bit signals, three Intel and then one Motorola."""
    lines = ['VERSION ""', "", "BU_: A", ""]
    for message in range(messages):
        lines.append(f"BO_ {FIRST_ID + message} M{message}: 8 A")
        for signal in range(4):
            place = f"{16 * signal + 7}|16@0-" if message % 4 == 3 else f"{16 * signal}|16@1-"
            lines.append(f' SG_ s{signal} : {place} (0.001,0.5) [0|0] "g" A')
        lines.append("")
    return "\n".join(lines)


def interleaved_frames(n: int, seed: int, messages: int = 4) -> FrameBatch:
    """Return n frames of that many messages in turn, with random payloads."""
    rng = np.random.default_rng(seed)
    can_id = np.arange(n, dtype=np.uint32) % messages + FIRST_ID
    data = rng.integers(0, 256, (n, 8), np.uint8)
    flags, bus, length = np.zeros(n, np.uint16), np.zeros(n, np.uint8), np.full(n, 8, np.uint8)
    return FrameBatch(np.arange(n) * 100_000, can_id, flags, bus, length, data)


def main() -> None:
    """Print the rates of the decoders and their ratios, as time of this process."""
    codec = parse_codec(database_text(), "benchmark")
    large = parse_codec(database_text(MESSAGES), "benchmark")
    frames = interleaved_frames(FRAMES, seed=1)
    ours = FRAMES / _fastest(lambda: codec.decode(frames), 5)
    print(f"decode, {FRAMES:,} frames of four 16-bit signals: {ours / 1e6:.1f} M frames/s")
    database = load_string(database_text(), "dbc")
    assert isinstance(database, Database)  # load_string may also return a diagnostics database
    one_by_one = database.decode_message
    theirs = CANTOOLS_FRAMES / _fastest(lambda: _decode_each(one_by_one, frames), 3)
    print(
        f"decode, cantools decode_message: {theirs / 1e6:.2f} M frames/s, ratio {ours / theirs:.0f}"
    )
    bulk = FRAMES / _asammdf_s(frames)
    print(
        f"decode, asammdf extract_bus_logging: {bulk / 1e6:.2f} M frames/s, ratio {ours / bulk:.1f}"
    )
    loading = _fastest(lambda: parse_codec(database_text(MESSAGES), "benchmark"), 3)
    print(f"load a DBC of {MESSAGES:,} messages: {loading * 1e3:.0f} ms")
    same = FRAMES / _fastest(lambda: large.decode(frames), 5)
    print(f"decode, {MESSAGES:,} messages in the DBC, 4 on the bus: {same / 1e6:.1f} M frames/s")
    mixed = interleaved_frames(FRAMES, seed=1, messages=MESSAGES)
    every = FRAMES / _fastest(lambda: large.decode(mixed), 5)
    print(f"decode, {MESSAGES:,} messages in the DBC and on the bus: {every / 1e6:.1f} M frames/s")
    for block in (100, 1000, 10_000):
        for name, used in (("4", codec), (f"{MESSAGES:,}", large)):
            rate = _block_rate(used, frames.select(slice(block)))
            print(f"decode, blocks of {block:,}, {name} messages: {rate / 1e6:.1f} M frames/s")


def _block_rate(codec: Codec, part: FrameBatch) -> float:
    return len(part) / _fastest(partial(codec.decode, part), 20)


def write_mf4(frames: FrameBatch, path: Path) -> None:
    """Write a bus log of classic frames as asammdf has it."""
    from asammdf import MDF, Signal, Source

    fields = {
        "BusChannel": (np.uint8, np.uint8(1)),
        "ID": (np.uint32, frames.can_id),
        "IDE": (np.uint8, np.uint8(0)),
        "DLC": (np.uint8, frames.length),
        "DataLength": (np.uint8, frames.length),
        "DataBytes": ((np.uint8, (8,)), frames.data),
    }
    record = np.zeros(
        len(frames), [(f"CAN_DataFrame.{name}", kind) for name, (kind, _) in fields.items()]
    )
    for name, (_, column) in fields.items():
        record[f"CAN_DataFrame.{name}"] = column
    source = Source("CAN1", "CAN1", "", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
    signal = Signal(record, frames.t_ns / 1e9, name="CAN_DataFrame", source=source)
    with MDF(version="4.11") as writer:
        writer.append([signal], acq_source=source, common_timebase=True)
        writer.save(path)


def _asammdf_s(frames: FrameBatch) -> float:
    """Return the time that asammdf takes to decode an MF4 log of the frames, file open."""
    from asammdf import MDF

    with TemporaryDirectory() as folder:
        dbc, log = Path(folder, "x.dbc"), Path(folder, "x.mf4")
        dbc.write_text(database_text())
        write_mf4(frames, log)
        with MDF(log) as reader:
            wanted: Any = {"CAN": [(str(dbc), 0)]}
            decoded = reader.extract_bus_logging(wanted)
            assert len(decoded.get("M1.s0", raw=True)) == len(frames) // 4
            return _fastest(lambda: reader.extract_bus_logging(wanted).close(), 3)


def _decode_each(decode: Callable[[int, bytes], object], frames: FrameBatch) -> None:
    for can_id, data in zip(frames.can_id[:CANTOOLS_FRAMES].tolist(), frames.data, strict=False):
        decode(can_id, data.tobytes())


def _fastest(work: Callable[[], object], repeats: int) -> float:
    spent = []
    for _ in range(repeats):
        start = process_time()
        work()
        spent.append(process_time() - start)
    return min(spent)


if __name__ == "__main__":
    main()
