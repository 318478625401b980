"""Assembles the columns of parsers to a block of frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, FrameFlag
from dbc.words import counted

from .source import Ledger

Marks = NDArray[np.bool_] | bool


def records_at(text: NDArray[np.uint8], at: NDArray[Any], layout: np.dtype[Any]) -> NDArray[Any]:
    """Return the numbers or structures of a NumPy type that begin at positions, (n,)."""
    raw = text[at[:, None] + np.arange(layout.itemsize)]
    return np.ascontiguousarray(raw).view(layout).reshape(len(at))


def possible_ids(can_id: NDArray[np.int64], long: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask of the identifiers that fit their bits: 29 where `long` is true, else 11."""
    return np.asarray(can_id < np.where(long, 1 << 29, 1 << 11))


def count_impossible_ids(
    can_id: NDArray[np.int64],
    long: NDArray[np.bool_],
    t_ns: NDArray[np.int64],
    whole: NDArray[np.bool_],
    ledger: Ledger,
) -> NDArray[np.bool_]:
    """Return `possible_ids`; count the complete frames (`whole`) without one, and name the first.

    No bus carries such a frame, so it is left out, and the rest of the log is read.
    """
    fits = possible_ids(can_id, long)
    wrong = np.flatnonzero(whole & ~fits)
    if len(wrong):
        first = wrong[0]
        bits, when = 29 if long[first] else 11, np.datetime64(int(t_ns[first]), "ns")
        what = f"0x{int(can_id[first]):X} with {bits} bits at {when}Z"
        note = (
            f"{counted(len(wrong), 'frame has', 'frames have')} an impossible "
            f"identifier, the first {what}"
        )
        ledger.garbled(len(wrong), note)
    return fits


def flags_of(
    n: int,
    *,
    extended: Marks = False,
    remote: Marks = False,
    error: Marks = False,
    fd: Marks = False,
    bitrate_switch: Marks = False,
    error_state: Marks = False,
    sent: Marks = False,
) -> NDArray[np.uint16]:
    """Return the bits of `FrameFlag` of n frames; a property that is not given has no frame."""
    flags = np.zeros(n, np.uint16)
    for bit, marks in (
        (FrameFlag.EXTENDED, extended),
        (FrameFlag.REMOTE, remote),
        (FrameFlag.ERROR, error),
        (FrameFlag.FD, fd),
        (FrameFlag.BITRATE_SWITCH, bitrate_switch),
        (FrameFlag.ERROR_STATE, error_state),
        (FrameFlag.TRANSMITTED, sent),
    ):
        flags |= marks * np.uint16(bit)
    return flags


def interleaved(batches: Sequence[FrameBatch], places: Sequence[NDArray[Any]]) -> FrameBatch:
    """Return the frames of several batches in the order of their places in the log."""
    held = [batch for batch in batches if len(batch)]
    joined = FrameBatch.concatenate(held)
    if len(held) < 2:
        return joined
    return joined.select(np.argsort(np.concatenate(places), kind="stable"))


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

    `good`, (n,) bool: True for rows to use.  `t_ns`, `can_id`, `flags`, `bus`, `length`, `data`: as
    in `FrameBatch`, in integers of any width.
    """
    if not good.all():
        t_ns, can_id, flags = t_ns[good], can_id[good], flags[good]
        bus, length, data = bus[good], length[good], data[good]
    return FrameBatch(
        t_ns, can_id.astype(np.uint32), flags, bus.astype(np.uint8), length.astype(np.uint8), data
    )
