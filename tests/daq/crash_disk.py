"""Files that misbehave as disks do: they fail at a chosen operation, run full, or keep a log."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from daq.journal.segment import Room, SyncedFile


class QuickFile(SyncedFile):
    """A file that takes the kernel's word for having written: kills and power are not at stake."""

    def sync(self) -> None:
        """Do nothing."""


@dataclass
class FailingDisk:
    """A disk whose operation number `nth` of one kind fails, once."""

    kind: str
    """`eio` or `enospc` (any operation), `short` (a write takes half, then there is no room),
    `sync` (fdatasync fails; the data may be there or not)."""
    nth: int
    """Counted from 1 among the operations that can fail so."""
    count: int = 0
    failed: bool = False

    def create(self, path: Path) -> SyncedFile:
        """Create a file, or fail."""
        if self.kind in ("eio", "enospc"):
            self._operation()
        return _FailingFile(path, self)

    def _operation(self) -> None:
        self.count += 1
        if self.count == self.nth:
            self.failed = True
            number = errno.ENOSPC if self.kind in ("enospc", "short") else errno.EIO
            raise OSError(number, os.strerror(number))


class _FailingFile(QuickFile):
    def __init__(self, path: Path, disk: FailingDisk) -> None:
        super().__init__(path)
        self._disk = disk
        self._broken = False

    def write(self, data: Any) -> int:
        assert not self._broken, "a file was written to after its first error"
        try:
            if self._disk.kind != "sync":
                self._disk._operation()
        except OSError:
            if self._disk.kind != "short":
                self._broken = True
                raise
            self._broken = True
            super().write(data[: len(data) // 2])
            raise
        return super().write(data)

    def sync(self) -> None:
        assert not self._broken, "a file was synced after its first error"
        if self._disk.kind != "short":
            try:
                self._disk._operation()
            except OSError:
                self._broken = True
                raise


@dataclass
class SmallDisk:
    """A disk with so many bytes of room; files on it are cut short when it is full."""

    free: int
    created: list[Path] = field(default_factory=list)

    def create(self, path: Path) -> SyncedFile:
        """Create a file."""
        if self.free <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.created.append(path)
        return _SmallFile(path, self)

    def room(self, _: Path) -> Room:
        """Return the room that is left."""
        return Room(self.free, 100_000_000)


class _SmallFile(QuickFile):
    def __init__(self, path: Path, disk: SmallDisk) -> None:
        super().__init__(path)
        self._disk = disk

    def write(self, data: Any) -> int:
        if self._disk.free <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = super().write(data[: self._disk.free])
        self._disk.free -= taken
        return taken


@dataclass
class LoggedDisk:
    """A disk that writes down every write and barrier, for images of what a crash may leave."""

    log: list[tuple[str, str, int, bytes]] = field(default_factory=list)
    """`("write", name, offset, bytes)` and `("sync", name)`, in order."""

    def create(self, path: Path) -> SyncedFile:
        """Create a file."""
        self.log.append(("create", path.name, 0, b""))
        return _LoggedFile(path, self)


class _LoggedFile(QuickFile):
    def __init__(self, path: Path, disk: LoggedDisk) -> None:
        super().__init__(path)
        self._short, self._disk = path.name, disk

    def write(self, data: Any) -> int:
        self._disk.log.append(("write", self._short, self.tell(), bytes(data)))
        return super().write(data)

    def sync(self) -> None:
        self._disk.log.append(("sync", self._short, 0, b""))
