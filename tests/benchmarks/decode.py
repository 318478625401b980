"""Bulk decoding against cantools, frame for frame, in one process."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter

import numpy as np
from cantools.database import Database, load_string

from dbc import FrameBatch, parse_codec

FRAMES = 1_000_000
CANTOOLS_FRAMES = 40_000


def database_text() -> str:
    """Return a DBC of four messages of four 16-bit signals, three Intel and one Motorola."""
    lines = ['VERSION ""', "", "BU_: A", ""]
    for message in range(4):
        lines.append(f"BO_ {256 + message} M{message}: 8 A")
        for signal in range(4):
            place = f"{16 * signal + 7}|16@0-" if message == 3 else f"{16 * signal}|16@1-"
            lines.append(f' SG_ s{signal} : {place} (0.001,0.5) [0|0] "g" A')
        lines.append("")
    return "\n".join(lines)


def interleaved_frames(n: int, seed: int) -> FrameBatch:
    """Return n frames of the four messages in turn, with random payloads."""
    rng = np.random.default_rng(seed)
    can_id = np.arange(n, dtype=np.uint32) % 4 + 256
    data = rng.integers(0, 256, (n, 8), np.uint8)
    flags, bus, length = np.zeros(n, np.uint16), np.zeros(n, np.uint8), np.full(n, 8, np.uint8)
    return FrameBatch(np.arange(n) * 100_000, can_id, flags, bus, length, data)


def main() -> None:
    """Print the rate of both decoders and their ratio."""
    codec = parse_codec(database_text(), "benchmark")
    frames = interleaved_frames(FRAMES, seed=1)
    ours = FRAMES / _fastest(lambda: codec.decode(frames), 5)
    database = load_string(database_text(), "dbc")
    assert isinstance(database, Database)  # load_string may also return a diagnostics database
    one_by_one = database.decode_message
    theirs = CANTOOLS_FRAMES / _fastest(lambda: _decode_each(one_by_one, frames), 3)
    print(f"decode, {FRAMES:,} frames of four 16-bit signals: {ours / 1e6:.1f} M frames/s")
    print(
        f"decode, cantools decode_message: {theirs / 1e6:.2f} M frames/s, ratio {ours / theirs:.0f}"
    )
    for block in (100, 1000, 10_000):
        part = frames.select(slice(block))
        rate = block / _fastest(partial(codec.decode, part), 20)
        print(f"decode, blocks of {block:,}: {rate / 1e6:.1f} M frames/s")


def _decode_each(decode: Callable[[int, bytes], object], frames: FrameBatch) -> None:
    for can_id, data in zip(frames.can_id[:CANTOOLS_FRAMES].tolist(), frames.data, strict=False):
        decode(can_id, data.tobytes())


def _fastest(work: Callable[[], object], repeats: int) -> float:
    spent = []
    for _ in range(repeats):
        start = perf_counter()
        work()
        spent.append(perf_counter() - start)
    return min(spent)
