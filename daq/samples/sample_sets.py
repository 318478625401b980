"""Finds the frames that belong to one sample, by the order of arrival or by counters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dbc.samples import Samples

Bound = tuple[NDArray[np.intp], NDArray[np.int64]]


def bind(
    number: NDArray[np.int64],
    carrier_ns: NDArray[np.int64],
    rows: NDArray[np.intp],
    t_ns: NDArray[np.int64],
) -> Bound:
    """Find the sample numbers of the frames of a message from the carrier frames around them.

    A sensor sends all frames of a sample in one burst, so a frame belongs to the carrier before it
    or, for messages that are sent ahead of the carrier, to the carrier after it: to the one that is
    nearer in most cases.  If carriers are lost, the frames between the received carriers are
    assigned by their number or, if frames are lost as well, by their time.

    `number`, (n,) int64: sample number of each carrier frame, increasing.  `carrier_ns`, (n,)
    int64: their arrival, in order.  `rows`, (m,) int: names of the frames, returned with their
    numbers.  `t_ns`, (m,) int64: arrival of the frames, in order.  Returns the frames that belong
    to a known sample, one for each sample, (k,), and their sample numbers, increasing, (k,).
    """
    behind = np.searchsorted(carrier_ns, t_ns, "right") - 1
    ahead = np.searchsorted(carrier_ns, t_ns, "left")
    inside = (behind >= 0) & (ahead < len(carrier_ns))
    after = t_ns[inside] - carrier_ns[behind[inside]]
    before = carrier_ns[ahead[inside]] - t_ns[inside]
    if len(after) and np.median(before) < np.median(after):
        # The same search with reversed time.
        mirrored_rows, mirrored = _bind_behind(
            -number[::-1], -carrier_ns[::-1], rows[::-1], -t_ns[::-1]
        )
        return mirrored_rows[::-1], -mirrored[::-1]
    return _bind_behind(number, carrier_ns, rows, t_ns)


def _bind_behind(
    number: NDArray[np.int64],
    carrier_ns: NDArray[np.int64],
    rows: NDArray[np.intp],
    t_ns: NDArray[np.int64],
) -> Bound:
    place = np.searchsorted(carrier_ns, t_ns, "right") - 1
    rows, t_ns, place = rows[place >= 0], t_ns[place >= 0], place[place >= 0]
    sent = np.append(np.diff(number), 1)[place]  # samples until the next received carrier
    count = np.bincount(place, minlength=len(number))
    rank = np.arange(len(place)) - (np.cumsum(count) - count)[place]
    span = np.diff(carrier_ns)
    cycle_ns = float(np.sum(span)) / max(int(number[-1] - number[0]), 1) if len(span) else 1.0
    by_time = np.rint((t_ns - carrier_ns[place]) / max(cycle_ns, 1.0) - 0.25).astype(np.int64)
    offset = np.where(count[place] == sent, rank, np.clip(by_time, 0, sent - 1))
    found, first = np.unique(number[place] + offset, return_index=True)
    return rows[first], found


def bind_counted(
    number: NDArray[np.int64],
    carrier_value: NDArray[np.float64],
    carrier_ns: NDArray[np.int64],
    rows: NDArray[np.intp],
    own_counter: Samples,
    modulus: int,
) -> Bound:
    """Find the sample numbers of a message that also has the carrier's counter.

    `number`, `carrier_value`, `carrier_ns`, (n,) array: sample number, counter and arrival of the
    carrier frames, in order.  `rows`, (m,) int: frames of the message with a readable counter.
    `own_counter`: their counter.  `modulus`: its range.
    """
    t_ns = own_counter.t_ns[rows]
    near = np.clip(np.searchsorted(carrier_ns, t_ns), 1, max(len(carrier_ns) - 1, 1))
    if len(carrier_ns) > 1:
        near -= t_ns - carrier_ns[near - 1] < carrier_ns[near] - t_ns
    else:
        near[:] = 0
    apart = (own_counter.value[rows] - carrier_value[near]).astype(np.int64)
    apart = (apart + modulus // 2) % modulus - modulus // 2
    numbered = number[near] + apart
    kept = (numbered >= number[0]) & (numbered <= number[-1])
    found, first = np.unique(numbered[kept], return_index=True)
    return rows[kept][first], found
