"""Simulates the wire: frames are sent by priority, and each takes its transmission time."""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from dbc import MessageLayout


def frame_time_ns(message: MessageLayout, bitrate: int) -> int:
    """Return the time that a frame occupies the bus, ns.

    Counted with the most stuff bits that can occur, and the gap between frames: no real frame is
    longer.
    """
    # From start of frame to the end of the checksum bits may be stuffed: one in four after the
    # first.  The last 13 bits (delimiters, acknowledge, end, gap) never are.
    stuffable = (54 if message.is_extended else 34) + 8 * message.length
    return round((stuffable + (stuffable - 1) // 4 + 13) * 1_000_000_000 / bitrate)


def priority(message: MessageLayout) -> int:
    """Return the message's rank in arbitration; the lowest rank wins."""
    # The 11 leading bits are compared first; a 29-bit identifier loses against an equal 11-bit one.
    return 2 * message.can_id + 1 if message.is_extended else (2 * message.can_id) << 18


def transmit(
    release_ns: NDArray[np.int64],
    rank: NDArray[np.int64],
    duration_ns: NDArray[np.int64],
    free_ns: int,
) -> NDArray[np.int64]:
    """Send frames over a bus that carries one at a time.

    `release_ns`, (n,) int64: time at which each frame is ready to be sent.  `rank`, (n,) int64: its
    rank in arbitration; equal ranks are sent in order of release.  `duration_ns`, (n,) int64: time
    for which it occupies the bus.  `free_ns`: time until which the bus is busy.  Returns (n,)
    int64: time at which each frame has been received, at the end of its transmission.
    """
    n = len(release_ns)
    order = np.argsort(release_ns, kind="stable")
    ready, waits = release_ns[order].tolist(), rank[order].tolist()
    takes = duration_ns[order].tolist()
    end = [0] * n
    queue: list[tuple[int, int]] = []
    now, arrived, sent = free_ns, 0, 0
    while sent < n:
        if not queue:
            now = max(now, ready[arrived])
        while arrived < n and ready[arrived] <= now:
            heappush(queue, (waits[arrived], arrived))
            arrived += 1
        _, frame = heappop(queue)
        now += takes[frame]
        end[frame] = now
        sent += 1
    done = np.empty(n, np.int64)
    done[order] = end
    return done
