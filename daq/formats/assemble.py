"""Columns as parsers have them, put together to a block of frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch


def good_frames(
    good: NDArray[np.bool_],
    t_ns: NDArray[np.int64],
    can_id: NDArray[np.int64],
    flags: NDArray[np.uint16],
    bus: NDArray[Any],
    length: NDArray[Any],
    data: NDArray[np.uint8],
) -> FrameBatch:
    """Return the frames that are `good`; the columns of the others may hold anything.

    `good`, (n,) bool: which rows to take.  `t_ns`, `can_id`, `flags`, `bus`, `length`, `data`: as
    in `FrameBatch`, in integers of any width.
    """
    if not good.all():
        t_ns, can_id, flags = t_ns[good], can_id[good], flags[good]
        bus, length, data = bus[good], length[good], data[good]
    return FrameBatch(
        t_ns,
        can_id.astype(np.uint32),
        flags,
        bus.astype(np.uint8),
        length.astype(np.uint8),
        data,
    )
