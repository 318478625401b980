"""A log that never blocks its caller: neither on a full pipe nor on a repeating fault."""

from __future__ import annotations

import logging
import os
import re
import stat
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path

from dbc import counted

BURST, PER_S = 5, 60.0
"""Largest number of lines with one key in a period, and the period, s; further lines are only
counted."""
HELD_LINES = 1000
MAX_FILE_BYTES = 1_000_000
_FLUSH_S = 0.5
_BEGINNINGS = (
    b"0000-00-00T00:00:00.000Z bumpbench: ",
    b"bumpbench: ",
    b"Traceback (most recent call last):",
)
"""First bytes of a log, each digit as 0; the last two in stderr of a recorder of a terminal."""


def require_log(path: Path) -> None:
    """Raise InputError if a file to log to, or the `*.1` that it will replace, is not a log.

    A log, and what a recorder wrote to stderr, is recognized by its first bytes; an empty file is
    taken for one.
    """
    from daq import InputError

    for file in (path, _kept(path)):
        try:
            if file.exists():
                _require_log(file)
        except OSError as error:
            what = error.strerror or str(error)
            raise InputError(str(file), what, "name another file for the log") from error


class Log:
    """Writes lines to stderr or to a file, from its own thread.

    Log records, warnings and uncaught thread errors of libraries are written too.  In a file each
    line begins with the UTC at which it was logged; lines on stderr are stamped by the program that
    stores them.  `path`: a file instead of stderr; beyond 1 MB it is renamed to `*.1`, which
    replaces an earlier one, and a new file is begun.  Raises InputError if the file cannot be
    written, or as `require_log` does.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._file = sys.stderr.fileno() if path is None else _opened(path)
        # Clears a progress bar in this line; the bar is drawn again below.
        self._before = "\r\x1b[K" if os.isatty(self._file) else ""
        self._lines: deque[tuple[float, str]] = deque(maxlen=HELD_LINES)
        self._dropped = 0
        self._seen: dict[str, tuple[float, int]] = {}
        self._lock = threading.Lock()
        self._fresh, self._closing = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)

    def __enter__(self) -> Log:
        self._handler = _Handler(self)
        self._hook, threading.excepthook = threading.excepthook, self._thread_died
        # A handler that cannot write must not report that to the same stderr.
        logging.raiseExceptions = False
        logging.captureWarnings(True)
        logging.getLogger().addHandler(self._handler)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        logging.getLogger().removeHandler(self._handler)
        logging.captureWarnings(False)
        logging.raiseExceptions = True
        threading.excepthook = self._hook
        self._closing.set()
        self._fresh.set()
        self._thread.join(_FLUSH_S)  # with a full pipe it may not end
        if self._path is not None and not self._thread.is_alive():
            os.close(self._file)

    def line(self, text: str, key: str = "") -> None:
        """Write a line; the number of lines with the same key is limited."""
        from daq.errors import printable

        now_s = time.monotonic()
        with self._lock:
            began_s, count = self._seen.get(key, (now_s, 0)) if key else (now_s, 0)
            if now_s - began_s > PER_S:
                if count > BURST:
                    text = f"{text} (and {count - BURST} more of these)"
                began_s, count = now_s, 0
            if key:
                if len(self._seen) > HELD_LINES:
                    self._seen.clear()
                self._seen[key] = began_s, count + 1
            if count >= BURST:
                return
            self._dropped += len(self._lines) == HELD_LINES
            self._lines.append((time.time(), printable(text, 600)))
        self._fresh.set()

    def _write(self) -> None:
        while not self._closing.is_set() or self._lines:
            self._fresh.wait()
            self._fresh.clear()
            while self._lines:
                with self._lock:
                    (wall_s, text), dropped = self._lines.popleft(), self._dropped
                    self._dropped = 0
                if dropped:
                    text = f"{counted(dropped, 'line')} of log dropped; {text}"
                stamp = "" if self._path is None else f"{_utc(wall_s)} "
                with suppress(OSError):  # no reader is left
                    self._rotate()
                    os.write(self._file, f"{self._before}{stamp}bumpbench: {text}\n".encode())

    def _rotate(self) -> None:
        """Begin a new file if this one is full, and keep this one until the new one is full."""
        if self._path is None or os.fstat(self._file).st_size <= MAX_FILE_BYTES:
            return
        self._path.replace(_kept(self._path))
        full, self._file = self._file, open_log(self._path)
        os.close(full)

    def _thread_died(self, died: threading.ExceptHookArgs) -> None:
        name = died.thread.name if died.thread else "a thread"
        self.line(f"{name} ended: {died.exc_value!r}", "thread")


class _Handler(logging.Handler):
    def __init__(self, log: Log) -> None:
        super().__init__(logging.WARNING)
        self._log = log

    def emit(self, record: logging.LogRecord) -> None:
        with suppress(Exception):
            self._log.line(f"{record.name}: {record.getMessage()}", record.name)


def _utc(wall_s: float) -> str:
    """Return a time as `2026-11-22T08:30:00.250Z`."""
    whole, part = divmod(round(wall_s * 1e3), 1000)
    return f"{time.strftime('%Y-%m-%dT%H:%M:%S', time.gmtime(whole))}.{part:03d}Z"


def _require_log(file: Path) -> None:
    if not stat.S_ISREG(file.lstat().st_mode):  # a link in a shared folder may lead anywhere
        raise OSError("is not an ordinary file")
    with file.open("rb") as stream:
        first = re.sub(rb"[1-9]", b"0", stream.read(len(_BEGINNINGS[0])))
    if not any(known.startswith(first[: len(known)]) for known in _BEGINNINGS):
        raise OSError("is there already and is not a log of bumpbench")


def _kept(path: Path) -> Path:
    """Return the name that a full log is given."""
    return path.with_name(f"{path.name}.1")


def open_log(path: Path) -> int:
    """Return the descriptor of a log, created or to be continued; a link is not followed."""
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o640)


def _opened(path: Path) -> int:
    from daq import InputError

    require_log(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return open_log(path)
    except OSError as error:
        what = error.strerror or str(error)
        raise InputError(str(path), what, "name another file for the log") from error
