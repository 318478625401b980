"""Records the blocks in each file, so that the loss of a file is reported exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .gaps import Gap
from .names import segment_number
from .segment import Block


@dataclass(frozen=True, slots=True)
class _Span:
    first: int
    stop: int
    frames: int


class WriteLedger:
    """The blocks of a recording that are on the disk, by segment."""

    def __init__(self, recording: str) -> None:
        self._recording = recording
        self._spans: dict[Path, _Span] = {}

    @property
    def paths(self) -> tuple[Path, ...]:
        """The segments that have blocks, in order."""
        return tuple(sorted(self._spans, key=segment_number))

    def note(self, path: Path, blocks: Sequence[Block]) -> int:
        """Add blocks that are on the disk; return their number of frames."""
        frames = sum(block.frames for block in blocks)
        before = self._spans.get(path)
        self._spans[path] = _Span(
            before.first if before else blocks[0].number,
            blocks[-1].number + 1,
            frames + (before.frames if before else 0),
        )
        return frames

    def rename(self, path: Path, now: Path) -> None:
        """Note that a segment has another name."""
        if path in self._spans:
            self._spans[now] = self._spans.pop(path)

    def forget(self, path: Path) -> None:
        """Remove a segment that was deleted on purpose."""
        self._spans.pop(path, None)

    def take_gone(self, also: Path | None) -> dict[Path, Gap]:
        """Remove the segments that no longer exist; return their gaps by path.

        `also`: a segment that was replaced by another file.
        """
        gone = {p: s for p, s in self._spans.items() if p == also or not p.is_file()}
        for path in gone:
            del self._spans[path]
        return {
            path: Gap(self._recording, span.first, span.stop, span.frames, path.name)
            for path, span in gone.items()
        }
