"""Journals read back, up to whatever a crash has left, with an exact account of what is missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
from mcap.exceptions import InvalidMagic
from mcap.records import Attachment, Channel, DataEnd, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader

from dbc.frames import FrameBatch, read_only

from .errors import InputError
from .journal_contents import HopCounts, JournalBlock, JournalContents, JournalLoss
from .journal_format import (
    BENCH_NAME,
    DBC_NAME,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    HEAD_RECORD,
    JournalHead,
    parse_head,
    unpack_events,
    unpack_frames,
)
from .runs import Event
from .source import HopLosses

LARGEST_RECORD_BYTES = 256 << 20
"""A length beyond this is a torn or foreign file, not a block."""


def read_journal(paths: Sequence[Path]) -> JournalContents:
    """Read all segments of a recording.

    Raises
    ------
    InputError
        As `JournalReader`.
    """
    reader = JournalReader(paths)
    blocks = list(reader)
    t_ns = [int(b.frames.t_ns.max()) if len(b.frames) else 0 for b in blocks]
    counts = [[getattr(b.losses, f.name) for f in fields(HopLosses)] for b in blocks]
    return JournalContents(
        reader.head,
        FrameBatch.concatenate([block.frames for block in blocks]),
        tuple(event for block in blocks for event in block.events),
        HopCounts(
            read_only(np.maximum.accumulate(np.array(t_ns, np.int64))),
            read_only(np.array(counts, np.int64).reshape(-1, len(fields(HopLosses)))),
        ),
        reader.lost,
    )


class JournalReader:
    """The blocks of a journal, one at a time: iterate once, then ask what was lost.

    Parameters
    ----------
    paths : sequence of Path
        The segments of one recording, in any order.

    Raises
    ------
    InputError
        If a file cannot be read or is no journal, if files belong to different recordings, or if
        none holds even its beginning.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._lost = JournalLoss()
        heads = {path: _read_head(path) for path in paths}
        found = {path: head for path, head in heads.items() if head is not None}
        for path in heads.keys() - found.keys():
            # Killed while it was created: nothing in it was ever reported as written.
            self._note(f"{path.name}: has no complete beginning", cut=path.stat().st_size)
        if not found:
            where = ", ".join(str(path) for path in paths) or "journal"
            raise InputError(where, "holds no recording", "name the files journal_*.mcap")
        self._paths = sorted(found, key=lambda path: found[path][1])
        self.head: JournalHead = found[self._paths[0]][0]
        for path in self._paths:
            if found[path][0] != self.head:
                raise InputError(
                    str(path),
                    f"belongs to another recording than {self._paths[0].name}",
                    "read one recording at a time",
                )

    @property
    def lost(self) -> JournalLoss:
        """What was found missing so far."""
        return self._lost

    def __iter__(self) -> Iterator[JournalBlock]:
        expected = 0
        losses = HopLosses()
        for path in self._paths:
            topics: dict[int, str] = {}
            for record in self._records(path):
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                if not isinstance(record, Message):
                    continue
                frames, counted = FrameBatch.empty(), losses
                events: tuple[Event, ...] = ()
                try:
                    if topics.get(record.channel_id) == FRAMES_TOPIC:
                        number, frames, counted = unpack_frames(record.data)
                    elif topics.get(record.channel_id) == EVENTS_TOPIC:
                        number, events = unpack_events(record.data)
                    else:
                        raise ValueError("no such channel")
                except ValueError as error:
                    self._note(f"{path.name}: block {expected} corrupt: {error}", corrupt=1)
                    expected += 1
                    continue
                if number < expected:
                    continue  # written twice: the first time its fdatasync failed
                if number > expected:
                    missing = number - expected
                    self._note(f"{path.name}: {missing} blocks missing", missing=missing)
                expected, losses = number + 1, counted
                yield JournalBlock(frames, losses, events)

    def _records(self, path: Path) -> Iterator[McapRecord]:
        size = path.stat().st_size
        good = 0
        in_body = False
        with path.open("rb") as file:
            try:
                for record in StreamReader(file, record_size_limit=LARGEST_RECORD_BYTES).records:
                    in_body |= isinstance(record, Message | DataEnd)
                    if in_body and file.tell() - good != _whole_bytes(record):
                        # The library steps over records of a kind it does not know.
                        self._note(f"{path.name}: a block is not one any more", corrupt=1)
                    if isinstance(record, DataEnd):
                        return  # what follows is a summary that we do not need
                    good = file.tell()
                    yield record
            except Exception:  # torn bytes raise whatever the parser stumbles over
                self._note(f"{path.name}: not closed", unclosed=1)
                if size > good:
                    self._note(f"{path.name}: last {size - good} bytes torn", cut=size - good)

    def _note(
        self, text: str, cut: int = 0, corrupt: int = 0, missing: int = 0, unclosed: int = 0
    ) -> None:
        lost = self._lost
        self._lost = JournalLoss(
            lost.bytes_cut + cut,
            lost.blocks_corrupt + corrupt,
            lost.blocks_missing + missing,
            lost.segments_unclosed + unclosed,
            (*lost.notes, text),
        )


def _whole_bytes(record: McapRecord) -> int:
    """Return the size in the file of a record of a body, 0 for one that is out of place."""
    if isinstance(record, Message):
        return 9 + 22 + len(record.data)
    return 9 + 4 if isinstance(record, DataEnd) else 0


def _read_head(path: Path) -> tuple[JournalHead, int] | None:
    """Return head and segment number, None if the file ends before they do."""
    metadata: dict[str, str] | None = None
    texts: dict[str, bytes] = {}
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, record_size_limit=LARGEST_RECORD_BYTES).records:
                if isinstance(record, Metadata) and record.name == HEAD_RECORD:
                    metadata = record.metadata
                elif isinstance(record, Attachment):
                    texts[record.name] = record.data
                if metadata is not None and texts.keys() >= {BENCH_NAME, DBC_NAME}:
                    return parse_head(metadata, texts[BENCH_NAME], texts[DBC_NAME])
                if isinstance(record, Message | DataEnd):
                    break
    except OSError as error:
        raise InputError(
            str(path), error.strerror or str(error), "name the files journal_*.mcap"
        ) from error
    except (InvalidMagic, ValueError, KeyError) as error:
        if path.stat().st_size >= 8:
            raise InputError(
                str(path), f"is no journal: {error}", "name the files journal_*.mcap"
            ) from error
        return None
    except Exception:  # torn bytes raise whatever the parser stumbles over
        return None
    raise InputError(str(path), "is an MCAP file of another program", "name journal_*.mcap")
