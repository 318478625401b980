"""Columns of the tangents side by side, for machine code (Numba): reading, summing, writing.

Columns are stored in blocks of `LANES`, one row of the state after the other: the distances between
rows are then constants, from which the compiler knows that rows do not overlap.
"""

from __future__ import annotations

from numba import njit

LANES = 88
"""Columns in a block: an odd number of cache lines, so that rows do not evict each other."""


@njit(forceinline=True)
def read7(block, row, j):
    """Return seven rows of a column."""
    k = row * LANES + j
    return (
        block[k], block[k + LANES], block[k + 2 * LANES], block[k + 3 * LANES],
        block[k + 4 * LANES], block[k + 5 * LANES], block[k + 6 * LANES],
    )  # fmt: skip


@njit(forceinline=True)
def read4(block, row, j):
    """Return four rows of a column."""
    k = row * LANES + j
    return block[k], block[k + LANES], block[k + 2 * LANES], block[k + 3 * LANES]


@njit(forceinline=True)
def plus7(a, h, b):
    """Return `a + h b`."""
    return (
        a[0] + h * b[0], a[1] + h * b[1], a[2] + h * b[2], a[3] + h * b[3],
        a[4] + h * b[4], a[5] + h * b[5], a[6] + h * b[6],
    )  # fmt: skip


@njit(forceinline=True)
def plus4(a, h, b):
    """Return `a + h b`."""
    return a[0] + h * b[0], a[1] + h * b[1], a[2] + h * b[2], a[3] + h * b[3]


@njit(forceinline=True)
def corner_slopes(s, i):
    """Return the slopes that act at a corner."""
    return (
        s[i, 0], s[i, 1], s[i, 2], s[i, 3], s[i, 4], s[i, 5], s[i, 6],
        s[i, 7], s[i, 8], s[i, 9], s[i, 10], s[i, 11], s[i, 12],
    )  # fmt: skip


@njit(forceinline=True)
def node_slopes(s):
    """Return the slopes at the four corners, and the inverse of the body's mass."""
    body = s[4, 0], s[4, 1], s[4, 2], s[4, 3], s[4, 4], s[4, 5]
    return corner_slopes(s, 0), corner_slopes(s, 1), corner_slopes(s, 2), corner_slopes(s, 3), body


@njit(forceinline=True)
def mean7(a, b, c, d):
    """Return six times the mean of the four stages."""
    return (
        a[0] + 2.0 * (b[0] + c[0]) + d[0], a[1] + 2.0 * (b[1] + c[1]) + d[1],
        a[2] + 2.0 * (b[2] + c[2]) + d[2], a[3] + 2.0 * (b[3] + c[3]) + d[3],
        a[4] + 2.0 * (b[4] + c[4]) + d[4], a[5] + 2.0 * (b[5] + c[5]) + d[5],
        a[6] + 2.0 * (b[6] + c[6]) + d[6],
    )  # fmt: skip


@njit(forceinline=True)
def mean4(a, b, c, d):
    """Return six times the mean of the four stages."""
    return (
        a[0] + 2.0 * (b[0] + c[0]) + d[0], a[1] + 2.0 * (b[1] + c[1]) + d[1],
        a[2] + 2.0 * (b[2] + c[2]) + d[2], a[3] + 2.0 * (b[3] + c[3]) + d[3],
    )  # fmt: skip


@njit(forceinline=True)
def write7(out, row, j, a):
    """Write seven rows of a column."""
    k = row * LANES + j
    out[k], out[k + LANES], out[k + 2 * LANES], out[k + 3 * LANES] = a[0], a[1], a[2], a[3]
    out[k + 4 * LANES], out[k + 5 * LANES], out[k + 6 * LANES] = a[4], a[5], a[6]


@njit(forceinline=True)
def write4(out, row, j, a):
    """Write four rows of a column."""
    k = row * LANES + j
    out[k], out[k + LANES], out[k + 2 * LANES], out[k + 3 * LANES] = a[0], a[1], a[2], a[3]
