"""Classifies frames: which message each carries, by its identifier and its bus."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from .frames import FrameBatch, FrameFlag
from .layout import MessageLayout

_STANDARD_BITS, _EXTENDED_BITS = 11, 29
_STANDARD_IDS = 1 << _STANDARD_BITS
_BUSES = 256
_PRIORITY_AND_SOURCE = ~np.uint64(0x1C0000FF)
_DESTINATION = ~np.uint64(0xFF00)
_BROADCAST = 240
"""Lowest PDU format whose parameter groups have no destination (SAE J1939-21)."""


@dataclass(frozen=True, slots=True)
class Identifiers:
    """Positions of messages by identifier.

    Row 0 holds the messages that are valid on any bus.  Each bus with messages valid on that bus
    only has a row that holds both kinds.
    """

    row: NDArray[np.uint32]
    """Row of each bus, shape (256,)."""
    standard: NDArray[np.uint16]
    """Position of the message for each identifier of 11 bits; the rows follow each other."""
    extended: NDArray[np.uint64]
    """Keys made of row and identifier of 29 bits, sorted."""
    extended_index: NDArray[np.uint16]
    """Positions of the messages with these keys."""
    groups: NDArray[np.uint64]
    """Keys made of row and parameter group of J1939 messages (`parameter_groups`), sorted."""
    groups_index: NDArray[np.uint16]
    """Positions of the messages with these keys."""
    unknown: int
    """Position for a frame that belongs to no message: the number of messages."""

    @classmethod
    def of(cls, messages: Sequence[MessageLayout]) -> Self:
        """Return the table of these messages; a message of one bus precedes one of any bus."""
        buses = sorted({m.bus for m in messages if m.bus is not None})
        row = np.zeros(_BUSES, np.uint32)
        row[buses] = np.arange(1, len(buses) + 1)
        unknown = len(messages)
        standard = np.full((len(buses) + 1, _STANDARD_IDS), unknown, np.uint16)
        extended: dict[int, int] = {}
        groups: dict[int, list[int]] = defaultdict(list)
        for i in sorted(range(unknown), key=lambda i: messages[i].bus is not None):
            m = messages[i]
            rows = range(len(buses) + 1) if m.bus is None else [int(row[m.bus])]
            if m.is_extended:
                keys = [each << _EXTENDED_BITS | m.can_id for each in rows]
                extended |= dict.fromkeys(keys, i)
                for key in parameter_groups(np.array(keys, np.uint64)) if m.is_j1939 else ():
                    groups[int(key)].append(i)
            else:
                standard[list(rows), m.can_id] = i
        # Several messages of one group belong to several sources: only their identifiers differ.
        single = {key: own[0] for key, own in groups.items() if len(own) == 1}
        return cls(row, standard.ravel(), *_sorted(extended), *_sorted(single), unknown)

    def classify(self, batch: FrameBatch) -> tuple[NDArray[np.uint16], int, int]:
        """Return the positions of the frames' messages, and the numbers of error and remote frames.

        The position is `unknown` for unknown identifiers and `unknown` + 1 for error and remote
        frames, which have no data.
        """
        unknown = np.uint16(self.unknown)
        row = self.row.take(batch.bus) if len(self.standard) > _STANDARD_IDS else None
        place = batch.can_id if row is None else batch.can_id + (row << np.uint32(_STANDARD_BITS))
        index = self.standard.take(place, mode="clip")
        special = FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR
        flags = batch.flags & np.uint16(special)
        index[batch.can_id >= _STANDARD_IDS] = unknown
        if not flags.any():
            return index, 0, 0
        extended = np.flatnonzero(flags & np.uint16(FrameFlag.EXTENDED))
        index[extended] = unknown
        if len(self.extended):
            key = batch.can_id[extended].astype(np.uint64)
            if row is not None:
                key |= row[extended].astype(np.uint64) << np.uint64(_EXTENDED_BITS)
            found = np.searchsorted(self.extended, key).clip(max=len(self.extended) - 1)
            known = self.extended[found] == key
            index[extended[known]] = self.extended_index[found[known]]
            if len(self.groups):
                rest, key = extended[~known], parameter_groups(key[~known])
                found = np.searchsorted(self.groups, key).clip(max=len(self.groups) - 1)
                known = self.groups[found] == key
                index[rest[known]] = self.groups_index[found[known]]
        error = (flags & np.uint16(FrameFlag.ERROR)) != 0
        remote = ((flags & np.uint16(FrameFlag.REMOTE)) != 0) & ~error
        index[error | remote] = unknown + 1
        return index, int(np.count_nonzero(error)), int(np.count_nonzero(remote))


def parameter_groups(identifiers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return identifiers without priority, source and, where they have one, destination (J1939)."""
    group = identifiers & _PRIORITY_AND_SOURCE
    addressed = (identifiers >> np.uint64(16)) & np.uint64(0xFF) < _BROADCAST
    return np.where(addressed, group & _DESTINATION, group)


def _sorted(table: Mapping[int, int]) -> tuple[NDArray[np.uint64], NDArray[np.uint16]]:
    """Return the keys in order, and their values."""
    keys = sorted(table)
    return np.array(keys, np.uint64), np.array([table[key] for key in keys], np.uint16)
