"""Defines CAN frames as a struct of arrays, the only form of frames inside the program."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray


class FrameFlag(IntFlag):
    """Properties of one frame, as bits of `FrameBatch.flags`."""

    EXTENDED = 1
    REMOTE = 2
    ERROR = 4
    FD = 8
    BITRATE_SWITCH = 16
    ERROR_STATE = 32  # ESI of an FD frame: its sender is error-passive
    TRANSMITTED = 64
    """Sent by this host: an echo.  Echo frames are measurements like any other frame."""


_T = TypeVar("_T", bound=np.generic)


def read_only(values: NDArray[_T]) -> NDArray[_T]:
    """Return a view of `values` that cannot be written."""
    view = values.view()
    view.setflags(write=False)
    return view


def freeze_arrays(record: object, *names: str) -> None:
    """Make arrays of a frozen dataclass read-only, in its `__post_init__`."""
    for name in names:
        object.__setattr__(record, name, read_only(getattr(record, name)))


FD_LENGTHS = read_only(np.array([*range(9), 12, 16, 20, 24, 32, 48, 64], np.uint8))
"""Number of payload bytes of each data length code, 0 to 15 (ISO 11898-1); classic: at most 8."""
LENGTH_ALLOWED = np.zeros((2, 256), bool)
"""True where the column number is a valid payload length, bytes: row 0 for classic frames, row 1
for FD frames."""
LENGTH_ALLOWED[0, :9] = LENGTH_ALLOWED[1, FD_LENGTHS] = True


@dataclass(frozen=True, slots=True)
class FrameBatch:
    """A block of frames in order of arrival; raises ValueError if a column has a wrong shape."""

    t_ns: NDArray[np.int64]
    """Time stamp of each frame, ns since 1970-01-01 UTC, as given by the bus, shape (n,)."""
    can_id: NDArray[np.uint32]
    """Identifier, 11 or 29 bits, without flag bits, shape (n,)."""
    flags: NDArray[np.uint16]
    """Bits of `FrameFlag`, shape (n,)."""
    bus: NDArray[np.uint8]
    """Index of the bus in the configuration, shape (n,)."""
    length: NDArray[np.uint8]
    """Number of payload bytes, shape (n,)."""
    data: NDArray[np.uint8]
    """Payloads, padded with zeros, shape (n, 8) or (n, 64)."""

    def __post_init__(self) -> None:
        n = len(self.t_ns)
        if self.data.ndim != 2 or self.data.shape[0] != n or self.data.shape[1] not in (8, 64):
            raise ValueError(f"data has shape {self.data.shape}, not ({n}, 8) or ({n}, 64)")
        for name, dtype in _COLUMNS:
            column = getattr(self, name)
            if name != "data" and column.shape != (n,):
                raise ValueError(f"{name} has shape {column.shape}, not ({n},)")
            object.__setattr__(self, name, read_only(np.ascontiguousarray(column, dtype)))

    def __len__(self) -> int:
        return len(self.t_ns)

    def select(self, index: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Self:
        """Return the frames that `index` (mask, positions or slice) picks."""
        return type(self)(*(getattr(self, name)[index] for name, _ in _COLUMNS))

    def by_time(self) -> Self:
        """Return the frames in order of time; those of one time stay in order of arrival."""
        return self.select(np.argsort(self.t_ns, kind="stable"))

    def within(self, spans: Iterable[tuple[int, int]]) -> Self:
        """Return the frames in any of these spans of time, start <= t < stop, ns."""
        if not len(self):
            return self
        first_ns, last_ns = int(self.t_ns.min()), int(self.t_ns.max())
        wanted = np.zeros(len(self), bool)
        for start_ns, stop_ns in spans:
            if start_ns <= last_ns and first_ns < stop_ns:
                wanted |= (self.t_ns >= start_ns) & (self.t_ns < stop_ns)
        return self.select(wanted)

    def on_buses(self, buses: Collection[int]) -> Self:
        """Return the frames of some buses; of all if none is named."""
        return self.select(np.isin(self.bus, sorted(buses))) if buses else self

    @classmethod
    def empty(cls) -> Self:
        """Return a batch of no frames."""
        columns: list[Any] = [np.zeros(0, kind) for _, kind in _COLUMNS[:-1]]
        return cls(*[*columns, np.zeros((0, 8), np.uint8)])

    @classmethod
    def from_rows(cls, rows: Sequence[tuple[int, int, int, int, int, bytes]]) -> Self:
        """Return frames from tuples, each the fields of one in order, its payload unpadded."""
        if not rows:
            return cls.empty()
        *columns, payloads = zip(*rows, strict=True)
        width = 8 if max(map(len, payloads)) <= 8 else 64
        data = b"".join(payload.ljust(width, b"\0") for payload in payloads)
        return cls(*[*map(np.array, columns), np.frombuffer(data, np.uint8).reshape(-1, width)])

    @classmethod
    def concatenate(cls, batches: Sequence[Self]) -> Self:
        """Join batches in the order given; payloads are widened to 64 bytes if any is."""
        if len(batches) < 2:
            return batches[0] if batches else cls.empty()
        names = [name for name, _ in _COLUMNS[:-1]]
        columns = [np.concatenate([getattr(b, name) for b in batches]) for name in names]
        width = max(batch.data.shape[1] for batch in batches)
        data = [np.pad(b.data, ((0, 0), (0, width - b.data.shape[1]))) for b in batches]
        return cls(*[*columns, np.concatenate(data)])


_COLUMNS = (
    ("t_ns", np.int64),
    ("can_id", np.uint32),
    ("flags", np.uint16),
    ("bus", np.uint8),
    ("length", np.uint8),
    ("data", np.uint8),
)
