"""Reads CSV of python-can: timestamp,arbitration_id,extended,remote,error,dlc,data (base64)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .assemble import flags_of, good_frames, possible_ids
from .text import Index, Lines, Mask, Parsed, cut_lines, decimals, integers, possible_times

LACKS = "CAN FD (with its bits BRS and ESI), bus and direction"
_HEADER = b"timestamp,arbitration_id,"
_SIXTY_FOUR = np.full(256, 99, np.uint8)
for _value, _letter in enumerate(
    b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
):
    _SIXTY_FOUR[_letter] = _value


def parse_csv(block: bytes) -> Parsed:
    """Return the frames of complete lines; every line except the header should be one."""
    lines = cut_lines(block, b",")
    header = block.removeprefix(b"\xef\xbb\xbf").startswith(_HEADER)
    whole = lines.count >= 6  # no data: no seventh field
    if header:
        whole[0] = False
    rows = np.flatnonzero(whole)
    t_ns, good = _stamps(lines, rows)
    start, end = lines.token(1, rows)
    can_id, has_id = integers(lines.text, start + 2, end, 16, longest=8)  # 0x123
    marks = []
    for place in (2, 3, 4):
        mark, is_mark = integers(lines.text, *lines.token(place, rows), 2, longest=1)
        good &= is_mark
        marks.append(mark == 1)
    extended, remote, error = marks
    good &= has_id & possible_ids(can_id, extended | error)
    length, has_length = integers(lines.text, *lines.token(5, rows), 10, longest=2)
    good &= has_length & (length <= 64)
    size = np.where(good & ~remote, length, 0)
    data, is_data = _base64(lines, rows, size)
    good &= is_data
    fd = length > 8  # not stated, but no classic frame is longer
    flags = flags_of(len(rows), extended=extended, remote=remote, error=error, fd=fd)
    bus = np.zeros(len(rows), np.uint8)
    frames = good_frames(good, t_ns, can_id, flags, bus, length, data)
    torn = lines.number[~whole][1:] if header else lines.number[~whole]
    bad = np.sort(np.concatenate([torn, lines.number[rows[~good]]]))
    return Parsed(frames, bad, header)


def _stamps(lines: Lines, rows: Index) -> tuple[NDArray[np.int64], Mask]:
    """Return time stamps in ns; Python writes small ones with an exponent."""
    start, end = lines.token(0, rows)
    t_ns, good = decimals(lines.text, start, end, 9)
    for row in np.flatnonzero(~good).tolist():
        try:
            t_ns[row] = round(float(lines.text[start[row] : end[row]].tobytes()) * 1e9)
            good[row] = True
        except (ValueError, OverflowError):
            continue
    return t_ns, good & possible_times(t_ns)


def _base64(lines: Lines, rows: Index, size: Index) -> tuple[NDArray[np.uint8], Mask]:
    """Return payloads, (n, 8) or (n, 64), and a mask of those with the right text length."""
    width = 8 if size.max(initial=0) <= 8 else 64
    start, end = lines.token_or_none(6, rows)
    end = np.where(lines.count[rows] == 7, end, start)
    groups = -(-width // 3)
    value = _SIXTY_FOUR[lines.text[start[:, None] + np.arange(4 * groups)]].astype(np.uint32)
    four = value.reshape(len(rows), groups, 4)
    word = four[..., 0] << 18 | four[..., 1] << 12 | four[..., 2] << 6 | four[..., 3]
    data = np.stack([word >> 16, word >> 8, word], axis=-1).astype(np.uint8)
    data = data.reshape(len(rows), 3 * groups)[:, :width]
    # The last group of one or two bytes ends in = signs, which the table maps to invalid values:
    # these only affect bytes after the payload, or bits that 99 does not reach.
    for left in (1, 2):
        tail = np.flatnonzero(size % 3 == left)
        group = size[tail] // 3
        high, low = four[tail, group, 0], four[tail, group, 1]
        data[tail, 3 * group] = high << 2 | low >> 4
        if left == 2:
            data[tail, 3 * group + 1] = (low & 15) << 4 | four[tail, group, 2] >> 2
    characters = -(-size * 4 // 3)
    used = np.arange(4 * groups) < characters[:, None]
    good = (end - start == 4 * -(-size // 3)) & np.all((value < 64) | ~used, axis=1)
    inside = np.arange(width) < size[:, None]
    return np.where(inside, data, 0).astype(np.uint8), good
