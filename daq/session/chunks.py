"""Packs the chunks of a dataset as HDF5's filters do: shuffle, deflate, Fletcher's checksum.

HDF5's own pipeline packs with zlib.  zlib-ng makes the same format in less than half the time, and
the same bytes of the same values each time (ISA-L, quicker still, does not: a session grown run by
run and the one recovered from its journal must be one file).  Any HDF5 library unpacks it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from zlib_ng import zlib_ng

ROWS = 8192
"""Most rows of a chunk."""
LEVEL = 1
"""Of deflate; more packs hardly better."""


def packed_chunks(values: NDArray[Any]) -> Iterator[tuple[tuple[int, ...], bytes]]:
    """Yield the offset and the packed bytes of each chunk of values; none if there are none."""
    if not values.size:
        return
    rows = min(len(values), ROWS)
    inner = (0,) * (values.ndim - 1)
    for first in range(0, len(values), rows):
        part = values[first : first + rows]
        if len(part) < rows:  # the last chunk is as long as the others; what is behind is not read
            whole = np.zeros((rows, *values.shape[1:]), values.dtype)
            whole[: len(part)] = part
            part = whole
        yield (first, *inner), _packed(part)


def _packed(chunk: NDArray[Any]) -> bytes:
    planes = np.ascontiguousarray(chunk).view(np.uint8).reshape(-1, chunk.itemsize).T
    packed: bytes = zlib_ng.compress(planes.tobytes(), LEVEL)
    return packed + fletcher32(packed).to_bytes(4, "little")


def fletcher32(content: bytes) -> int:
    """Return Fletcher's checksum of bytes, taken as big-endian words of 16 bits (HDF5's).

    Both sums are modulo 65535, where a multiple that is not zero is 65535.  To that modulus a word
    is 256 times the one with its bytes exchanged.
    """
    words = np.frombuffer(content + bytes(len(content) % 2), "<u2").astype(np.int64)
    sums = int(words.sum()), int(words @ np.arange(len(words), 0, -1))
    low, high = ((256 * total - 1) % 65535 + 1 if total else 0 for total in sums)
    return high << 16 | low
