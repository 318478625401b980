"""Records the blocks in each file, so that the loss of a file is reported exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from .gaps import Gap
from .names import segment_number
from .segment import Block


class WriteLedger:
    """The blocks of a recording that are on the disk, by segment."""

    def __init__(self, recording: str) -> None:
        self._recording = recording
        self._spans: dict[Path, Gap] = {}

    @property
    def paths(self) -> tuple[Path, ...]:
        """The segments that have blocks, in order."""
        return tuple(sorted(self._spans, key=segment_number))

    def note(self, path: Path, blocks: Sequence[Block]) -> int:
        """Add blocks that are on the disk; return their number of frames."""
        frames = sum(block.frames for block in blocks)
        before = self._spans.get(path)
        first = before.first if before else blocks[0].number
        total = frames + (before.frames if before else 0)
        self._spans[path] = Gap(self._recording, first, blocks[-1].number + 1, total, path.name)
        return frames

    def rename(self, path: Path, now: Path) -> None:
        """Note that a segment has another name."""
        if path in self._spans:
            self._spans[now] = replace(self._spans.pop(path), file=now.name)

    def forget(self, path: Path) -> None:
        """Remove a segment that was deleted on purpose."""
        self._spans.pop(path, None)

    def take_gone(self, also: Path | None) -> dict[Path, Gap]:
        """Remove the segments that no longer exist; return their gaps by path.

        `also`: a segment that was replaced by another file.
        """
        gone = [path for path in self._spans if path == also or not path.is_file()]
        return {path: self._spans.pop(path) for path in gone}
