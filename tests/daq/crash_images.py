"""R2: what a crash may leave of the writes since the last barrier: some of them, some torn."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.journal.folder import last_recording, segments_in
from daq.journal.writer import JournalWriter
from daq.runs import Event

from .crash_disk import LoggedDisk, QuickFile
from .crash_frames import HEAD, block, read_numbers

SECTOR = 512
KINDS = ("prefix", "subset", "torn")
_COUNT = 40


@dataclass(frozen=True, slots=True)
class History:
    """All that was written to a disk; `acknowledged[k]` frames were so after the k-th operation."""

    log: Sequence[tuple[str, str, int, bytes]]
    acknowledged: Sequence[int]


def history(folder: Path, blocks: int, rng: np.random.Generator) -> History:
    """Record blocks, with changes of segment in between, and write everything down."""
    disk = LoggedDisk()
    acknowledged: list[int] = []
    writer = JournalWriter(folder, HEAD, RecorderConfig(segment_bytes=12_000.0), disk.create)
    n = 0
    for k in range(blocks):
        acknowledged += [n] * (len(disk.log) - len(acknowledged))
        count = int(rng.integers(1, 2 * _COUNT))
        writer.append(block(n, count), HopLosses())
        n += count
        # The last operation of `append` is the barrier: from then on it is acknowledged.
        acknowledged += [acknowledged[-1]] * (len(disk.log) - len(acknowledged) - 1) + [n]
        if k % 5 == 0:
            writer.append_events([Event(k, "note", float(n), "in between")])
        writer.maintain(0.1 * k)
    acknowledged += [n] * (len(disk.log) - len(acknowledged))
    writer.close()
    return History(tuple(disk.log[: len(acknowledged)]), tuple(acknowledged))


def leave(
    folder: Path, history: History, operations: int, kind: str, rng: np.random.Generator
) -> None:
    """Write into `folder` what a crash after so many operations may leave."""
    done = history.log[:operations]
    barrier = {name: k for k, (what, name, _, _) in enumerate(done) if what == "sync"}
    images: dict[str, bytearray] = {}
    pending: list[tuple[str, int, bytes]] = []
    for k, (what, name, offset, data) in enumerate(done):
        if what == "create" and (name in barrier or rng.random() < 0.5):
            images[name] = bytearray()
        elif what == "write" and k < barrier.get(name, -1):
            _apply(images[name], offset, data)
        elif what == "write" and name in images:
            pending.append((name, offset, data))
    if kind == "prefix":
        chosen = pending[: int(rng.integers(0, len(pending) + 1))]
    elif kind == "subset":
        chosen = [write for write in pending if rng.random() < 0.5]
    else:
        chosen = [s for w in pending for s in _sectors(*w) if rng.random() < 0.6]
    for name, offset, data in chosen:
        _apply(images[name], offset, data)
    folder.mkdir()
    for name, image in images.items():
        (folder / name).write_bytes(image)


def _sectors(name: str, offset: int, data: bytes) -> list[tuple[str, int, bytes]]:
    edges = [*range(offset + SECTOR - offset % SECTOR, offset + len(data), SECTOR)]
    edges = [offset, *edges, offset + len(data)]
    return [(name, a, data[a - offset : b - offset]) for a, b in pairwise(edges)]


def _apply(image: bytearray, offset: int, data: bytes) -> None:
    image.extend(bytes(max(0, offset + len(data) - len(image))))
    image[offset : offset + len(data)] = data


def images(folder: Path, count: int, seed: int = 2) -> int:
    """Check `count` images; return how many held more than was acknowledged.

    Each is read, then taken up again by a recorder, and read once more.

    Raises
    ------
    AssertionError
        If an acknowledged frame is lost, or a frame is not what was written.
    """
    rng = np.random.default_rng(seed)
    beyond = 0
    past = history(folder / "history", 60, rng)
    for i in range(count):
        if i % 500 == 499:
            past = history(folder / f"history{i}", 60, rng)
        operations = int(rng.integers(0, len(past.log) + 1))
        acknowledged = past.acknowledged[operations - 1] if operations else 0
        place = folder / f"image{i}"
        leave(place, past, operations, KINDS[i % 3], rng)
        beyond += _check(place, acknowledged)
        shutil.rmtree(place)
    return beyond


def _check(place: Path, acknowledged: int) -> bool:
    try:
        read = len(_in_order(segments_in(place), acknowledged))
    except InputError:
        assert not acknowledged, "a journal with acknowledged frames cannot be read"
        read = 0
    tail = last_recording(place)
    head = replace(HEAD, wall_ns=HEAD.wall_ns + 5)
    with JournalWriter(place, head, RecorderConfig(), QuickFile, tail) as writer:
        writer.append(block(10**9, 7), HopLosses())
        again = read_numbers(segments_in(place))
    assert len(again) == read + 7, "taken up again, the recording lost frames"
    assert again[-7] == 10**9
    assert writer.status.recorded_frames == read + 7
    return read > acknowledged


def _in_order(segments: Sequence[Path], acknowledged: int) -> NDArray[np.int64]:
    read = read_numbers(segments)
    assert np.array_equal(read, np.arange(len(read))), "frames are missing, doubled or in disorder"
    assert len(read) >= acknowledged, f"{acknowledged - len(read)} acknowledged frames lost"
    return read
