"""Reads CSV of SavvyCAN, GVRET: Time Stamp (µs),ID,Extended,Dir,Bus,LEN,D1,D2,...; old: no Dir."""

from __future__ import annotations

import numpy as np

from .assemble import flags_of, good_frames
from .text import Parsed, cut_lines, integers, is_word, spaced_bytes

LACKS = "remote and error frames, and of CAN FD all but the longer payloads"
_HEADER = b"time stamp,id,extended,"


def parse_gvret(block: bytes) -> Parsed:
    """Return the frames of complete lines; every line except the header should be one."""
    lines = cut_lines(block, b",")
    header = block.removeprefix(b"\xef\xbb\xbf")[: len(_HEADER)].lower() == _HEADER
    whole = lines.count >= 5
    if header:
        whole[:1] = False
    rows = np.flatnonzero(whole)
    t_us, good = integers(lines.text, *lines.token(0, rows), 10)
    can_id, has_id = integers(lines.text, *lines.token(1, rows), 16, longest=8)
    extended = is_word(lines, *lines.token(2, rows), b"true")
    extended |= is_word(lines, *lines.token(2, rows), b"1")
    good &= extended | is_word(lines, *lines.token(2, rows), b"false")
    sent = is_word(lines, *lines.token(3, rows), b"tx")
    directed = sent | is_word(lines, *lines.token(3, rows), b"rx")
    good &= lines.count[rows] >= 5 + directed
    first = lines.first[rows] + 3 + np.where(good, directed, 0)
    bus, has_bus = integers(lines.text, lines.start[first], lines.end[first], 10, longest=3)
    length, has_length = integers(
        lines.text, lines.start[first + 1], lines.end[first + 1], 10, longest=2
    )
    # Receivers that do not know the kind of an identifier write "false" for all.
    extended |= can_id >= 1 << 11
    good &= has_id & has_bus & has_length & (can_id < 1 << 29) & (length <= 64) & (bus < 256)
    good &= t_us < 1 << 53
    good &= lines.count[rows] >= 5 + directed + length
    data, is_hex = spaced_bytes(lines, first + 2, np.where(good, length, 0), 16)
    good &= is_hex
    flags = flags_of(len(rows), extended=extended, fd=length > 8, sent=sent)
    t_ns = np.where(good, t_us, 0) * 1000
    frames = good_frames(good, t_ns, can_id, flags, bus, length, data)
    torn = lines.number[~whole][1:] if header else lines.number[~whole]
    bad = np.sort(np.concatenate([torn, lines.number[rows[~good]]]))
    return Parsed(frames, bad, header)
