"""Keeps frames, samples and losses of the last seconds for bench check and verdict."""

from __future__ import annotations

from collections import deque
from dataclasses import astuple, dataclass, fields
from itertools import pairwise

import numpy as np

from dbc.frames import FrameBatch

from ..runs import Losses
from ..samples.blocks import Column, SampleBlock

CHECK_S = 10.0
"""Age up to which raw frames are kept, s."""
MOST_BLOCKS = 20_000
"""Largest number of blocks kept, half an hour at ten per second, in case the stamps of a bus do not
advance and no block grows old."""
_SLACK_NS = 1_000_000_000
"""Time for which samples and losses are kept in addition to a run, ns."""
_MOST_BYTES = 64 << 20
"""Largest number of bytes of raw frames kept."""


class RecentFrames:
    """Raw frames of the last `CHECK_S`, of data time; at most `_MOST_BYTES`."""

    def __init__(self) -> None:
        self._batches: deque[tuple[int, FrameBatch]] = deque()
        self._bytes = 0

    def add(self, batch: FrameBatch) -> None:
        """Add a block, not empty."""
        latest_ns = int(batch.t_ns.max())
        self._batches.append((latest_ns, batch))
        self._bytes += _size(batch)
        horizon_ns = latest_ns - round(CHECK_S * 1e9)
        # A block of a later time (the clock was set back) is also dropped: it would never grow old.
        while self._batches[0][0] < horizon_ns or self._bytes > _MOST_BYTES:
            self._bytes -= _size(self._batches.popleft()[1])
            if not self._batches:
                break
        while self._batches and self._batches[0][0] > latest_ns + _SLACK_NS:
            self._bytes -= _size(self._batches.popleft()[1])

    def last(self, seconds: float) -> FrameBatch:
        """Return the frames of the last seconds."""
        if not self._batches:
            return FrameBatch.empty()
        since_ns = self._batches[-1][0] - round(seconds * 1e9)
        found = FrameBatch.concatenate([b for t_ns, b in self._batches if t_ns >= since_ns])
        return found.select(found.t_ns >= since_ns)


class RecentSamples:
    """Samples of all channels of the last `kept_s` + 1 s."""

    def __init__(self, kept_s: float) -> None:
        self._kept_ns = round(kept_s * 1e9) + _SLACK_NS
        self._blocks: deque[tuple[int, SampleBlock]] = deque(maxlen=MOST_BLOCKS)

    def add(self, t_ns: int, block: SampleBlock) -> None:
        """Add a block whose latest stamp is `t_ns`."""
        # The first block after a pause of the bus may end a run from before the pause: the previous
        # block decides which blocks are too old.
        last_ns = self._blocks[-1][0] if self._blocks else t_ns
        while self._blocks and (
            last_ns - self._blocks[0][0] > self._kept_ns or self._blocks[0][0] - t_ns > _SLACK_NS
        ):
            self._blocks.popleft()
        self._blocks.append((t_ns, block))

    def between(self, start_ns: int, stop_ns: int) -> SampleBlock:
        """Return the samples of a span, by channel, in order of arrival."""
        pieces: dict[str, list[Column]] = {}
        for latest_ns, block in self._blocks:
            if latest_ns >= start_ns:
                for name, piece in block.items():
                    pieces.setdefault(name, []).append(piece)
        found: dict[str, Column] = {}
        for name, parts in pieces.items():
            t_ns = np.concatenate([part[0] for part in parts])
            value = np.concatenate([part[1] for part in parts])
            within = (t_ns >= start_ns) & (t_ns < stop_ns)
            found[name] = (t_ns[within], value[within])
        return found


@dataclass(frozen=True, slots=True)
class _Counted:
    first_ns: int
    last_ns: int
    losses: Losses


class RecentLosses:
    """Losses counted up to each block of the last `kept_s` + 1 s."""

    def __init__(self, kept_s: float) -> None:
        self._kept_ns = round(kept_s * 1e9) + _SLACK_NS
        self._blocks = deque([_Counted(0, 0, Losses())], MOST_BLOCKS)

    def add(self, first_ns: int, last_ns: int, losses: Losses) -> None:
        """Add the losses counted up to a block, and its earliest and latest stamp."""
        before_ns = self._blocks[-1].last_ns  # as in `RecentSamples`, for a pause of the bus
        self._blocks.append(_Counted(first_ns, last_ns, losses))
        while len(self._blocks) > 1 and (
            before_ns - self._blocks[1].last_ns > self._kept_ns
            or self._blocks[1].last_ns - last_ns > _SLACK_NS
        ):
            self._blocks.popleft()

    def between(self, start_ns: int, stop_ns: int) -> Losses:
        """Return the losses in a span, extended to complete blocks.

        The first block after a pause of the bus has all losses of the pause: the span gets the
        share of these losses that corresponds to its share of the pause.
        """
        blocks = list(self._blocks)
        earlier = [k for k, block in enumerate(blocks) if block.last_ns < start_ns]
        within = blocks[earlier[-1] if earlier else 0 :]
        total = np.zeros(len(fields(Losses)))
        for before, block in pairwise(within):
            share = 1.0
            if block.first_ns >= stop_ns:
                pause_ns = max(block.first_ns - before.last_ns, 1)
                share = max(stop_ns - before.last_ns, 0) / pause_ns
            total += share * np.subtract(astuple(block.losses), astuple(before.losses))
        return Losses(*np.rint(total).astype(int).tolist())


def _size(batch: FrameBatch) -> int:
    return batch.data.nbytes + 16 * len(batch)
