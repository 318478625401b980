"""Reads CRTD of the Open Vehicle Monitoring System: ``1320745424.002 R11 402 FA 01 C3 A0``.

A number before the kind is the bus, counted from 1; records of other kinds are comments.
"""

from __future__ import annotations

import numpy as np

from .assemble import flags_of, good_frames, possible_ids
from .text import Parsed, character, cut_lines, decimals, integers, spaced_bytes

LACKS = "remote and error frames, and CAN FD"


def parse_crtd(block: bytes) -> Parsed:
    """Return the frames of complete lines."""
    lines = cut_lines(block)
    rows = np.flatnonzero(lines.count >= 2)
    t_ns, timed = decimals(lines.text, *lines.token(0, rows), 9)
    start, end = lines.token(1, rows)
    bus, numbered = integers(lines.text, start, start + 1, 10)
    bus, start = np.where(numbered, bus, 0), start + numbered
    kind = character(lines, start)
    comment = timed & (kind == ord("c")) & (end > start)
    matching = timed & ((kind == ord("r")) | (kind == ord("t"))) & (end - start == 3)
    matching &= lines.count[rows] >= 3
    bits, is_kind = integers(lines.text, start + 1, np.where(matching, end, start + 1), 10)
    matching &= is_kind & ((bits == 11) | (bits == 29))
    other = np.concatenate(
        [lines.number[lines.count < 2], lines.number[rows[~matching & ~comment]]]
    )
    rows, bus, kind, bits, t_ns = (
        rows[matching],
        bus[matching],
        kind[matching],
        bits[matching],
        t_ns[matching],
    )

    extended, sent = bits == 29, kind == ord("t")
    can_id, good = integers(lines.text, *lines.token(2, rows), 16, longest=8)
    good &= possible_ids(can_id, extended)
    length = lines.count[rows] - 3
    good &= length <= 8
    data, is_hex = spaced_bytes(lines, lines.first[rows] + 3, np.where(good, length, 0), 16)
    good &= is_hex
    flags = flags_of(len(rows), extended=extended, sent=sent)
    frames = good_frames(good, t_ns, can_id, flags, np.maximum(bus, 1) - 1, length, data)
    bad = np.sort(np.concatenate([other, lines.number[rows[~good]]]))
    return Parsed(frames, bad, header=bool(comment.any()))
