"""Holds blocks in memory while the disk refuses them, and counts frames without room."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

from .gaps import Gap
from .segment import Block

HELD_BYTES = 32_000_000
"""Bytes of frames and events held in memory: a minute of four full buses."""
EVENT_BYTES = 4_000_000
"""Additional bytes for events: they are few, and runs depend on them."""
_OVERHEAD_BYTES = 400
"""Memory of a block in addition to its message, bytes."""


@dataclass(frozen=True, slots=True)
class _Held:
    block: Block
    since_s: float


class Backlog:
    """A queue of blocks; the frames that do not fit are counted.

    `frames` and `dropped`: number of frames that wait, and of frames without room.
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
        """Size of all blocks that wait, bytes."""
        return self._bytes

    def since_s(self) -> float | None:
        """Return the time at which the oldest block was added, s; None if there is none."""
        return self._held[0].since_s if self._held else None

    def put(self, block: Block, now_s: float) -> None:
        """Append a block, or count its frames as dropped."""
        room = HELD_BYTES if block.frames else HELD_BYTES + EVENT_BYTES
        # After a drop all frames are dropped until the disk takes blocks again, so that one event
        # reports one gap.
        if self._bytes + len(block.message) > room or (self._gap is not None and block.frames):
            gap = self._gap or Gap(self._recording, block.number, block.number, 0)
            # Blocks of events between them are stored; the reader ignores this.
            self._gap = replace(gap, stop=block.number + 1, frames=gap.frames + block.frames)
            self.dropped += block.frames
            return
        self._held.append(_Held(block, now_s))
        self._bytes += len(block.message) + _OVERHEAD_BYTES
        self.frames += block.frames

    def first(self, size: int) -> Sequence[Block]:
        """Return the oldest blocks, at least one and about `size` bytes, without removing them."""
        blocks: list[Block] = []
        total = 0
        for held in self._held:
            if blocks and total + len(held.block.message) > size:
                break
            blocks.append(held.block)
            total += len(held.block.message)
        return blocks

    def remove(self, count: int) -> None:
        """Remove the oldest blocks, which are on the disk."""
        for _ in range(count):
            block = self._held.popleft().block
            self._bytes -= len(block.message) + _OVERHEAD_BYTES
            self.frames -= block.frames

    def take_gap(self) -> Gap | None:
        """Return the gap of blocks dropped since the last call, None if there is none."""
        gap, self._gap = self._gap, None
        return gap
