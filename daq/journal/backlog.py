"""Blocks that wait in memory while the disk refuses, and a count of those that found no room."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

from .gaps import Gap
from .segment import Block

HELD_BYTES = 32_000_000
"""A minute of four full buses."""
EVENT_BYTES = 4_000_000
"""Kept beyond that for events: they are few, and runs hang on them."""


_OVERHEAD_BYTES = 400
"""What a small block costs beyond its message."""


@dataclass(frozen=True, slots=True)
class _Held:
    block: Block
    since_s: float


class Backlog:
    """A queue of blocks; what does not fit is counted.

    Parameters
    ----------
    recording : str
        Identity of the recording.

    Attributes
    ----------
    frames, dropped : int
        Frames that wait, and frames that found no room so far.
    """

    def __init__(self, recording: str) -> None:
        self.dropped = 0
        self.frames = 0
        self._recording = recording
        self._held: deque[_Held] = deque()
        self._bytes = 0
        self._gap: Gap | None = None

    def __len__(self) -> int:
        return len(self._held)

    @property
    def bytes(self) -> int:
        """Size of all that waits."""
        return self._bytes

    def since_s(self) -> float | None:
        """Return since when the oldest waits, s; None if nothing does."""
        return self._held[0].since_s if self._held else None

    def put(self, block: Block, now_s: float) -> None:
        """Take a block in, or count its frames as dropped."""
        room = HELD_BYTES if block.frames else HELD_BYTES + EVENT_BYTES
        # Once something was dropped, the next frames are too, until the disk takes blocks again:
        # one gap is told by one event.
        if self._bytes + len(block.message) > room or (self._gap is not None and block.frames):
            gap = self._gap or Gap(self._recording, block.number, block.number, 0)
            # Blocks of events in between are there; the reader does not mind.
            self._gap = replace(gap, stop=block.number + 1, frames=gap.frames + block.frames)
            self.dropped += block.frames
            return
        self._held.append(_Held(block, now_s))
        self._bytes += len(block.message) + _OVERHEAD_BYTES
        self.frames += block.frames

    def first(self, size: int) -> Sequence[Block]:
        """Return the oldest blocks, at least one and about `size` bytes; they stay."""
        blocks: list[Block] = []
        total = 0
        for held in self._held:
            if blocks and total + len(held.block.message) > size:
                break
            blocks.append(held.block)
            total += len(held.block.message)
        return blocks

    def remove(self, count: int) -> None:
        """Let the oldest go: they are on the disk."""
        for _ in range(count):
            block = self._held.popleft().block
            self._bytes -= len(block.message) + _OVERHEAD_BYTES
            self.frames -= block.frames

    def take_gap(self) -> Gap | None:
        """Return what was dropped since this was last asked, None if nothing."""
        gap, self._gap = self._gap, None
        return gap
