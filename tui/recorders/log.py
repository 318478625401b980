"""A log that never blocks its caller: neither on a full pipe nor on a repeating fault."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from contextlib import suppress
from logging.handlers import QueueListener, RotatingFileHandler
from pathlib import Path
from queue import Full, Queue

BURST = 5
"""Largest number of lines with one key in a minute; further lines are only counted."""


def require_log(path: Path) -> None:
    """Raise InputError if a file to log to is there and is not a log of bumpbench.

    A log, and what a recorder wrote to stderr, is recognized by its first line.
    """
    from daq import InputError

    advice = "name another file for the log"
    try:
        if not path.exists():
            return
        if not path.is_file():
            raise InputError(str(path), "is not an ordinary file", advice)
        with path.open("rb") as stream:
            first = stream.readline(200)
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), advice) from error
    if first and b"bumpbench: " not in first and not first.startswith(b"Traceback "):
        raise InputError(str(path), "is there already and is not a log of bumpbench", advice)


class Log:
    """Writes lines to stderr or to a file, from its own thread.

    Log records, warnings and uncaught thread errors of libraries are written too.  In a file each
    line begins with the UTC at which it was logged; lines on stderr are stamped by the program that
    stores them.  `path`: a file instead of stderr; at 1 MB it is renamed to `*.1`, which replaces
    an earlier one, and a new file is begun.  Raises InputError if the file cannot be written, or as
    `require_log` does.
    """

    def __init__(self, path: Path | None) -> None:
        self._writer = _Stderr() if path is None else _file_handler(path)
        # Lines that wait for a slow reader; further ones are left out.
        self._waiting: Queue[logging.LogRecord] = Queue(1000)
        self._listener = QueueListener(self._waiting, self._writer)
        self._periods: dict[str, tuple[float, int]] = {}
        """Beginning of the present minute of each key, s, and number of its lines since."""
        self._lock = threading.Lock()

    def __enter__(self) -> Log:
        self._handler = _Libraries(self)
        self._hook = threading.excepthook
        threading.excepthook = lambda died: self.line(
            f"{died.thread.name if died.thread else 'a thread'} ended: {died.exc_value!r}", "thread"
        )
        # A handler that cannot write must not report that to the same stderr.
        logging.raiseExceptions = False
        logging.captureWarnings(True)
        logging.getLogger().addHandler(self._handler)
        self._listener.start()
        return self

    def __exit__(self, *_: object) -> None:
        logging.getLogger().removeHandler(self._handler)
        logging.captureWarnings(False)
        logging.raiseExceptions = True
        threading.excepthook = self._hook

        def stop() -> None:
            with suppress(Full):
                self._listener.stop()

        stopping = threading.Thread(target=stop, daemon=True)
        stopping.start()
        stopping.join(0.5)  # s; with a full pipe it may not end
        if not stopping.is_alive():
            self._writer.close()

    def line(self, text: str, key: str = "") -> None:
        """Write a line; the number of lines with the same key is limited, except the empty one."""
        from dbc.words import printable

        now_s = time.monotonic()
        with self._lock:
            began_s, count = self._periods.get(key, (now_s, 0))
            if now_s - began_s > 60.0:
                if count > BURST:
                    text = f"{text} (and {count - BURST} more of these)"
                began_s, count = now_s, 0
            if key:
                self._periods[key] = began_s, count + 1
            if count >= BURST:
                return
        record = logging.makeLogRecord({"msg": printable(text, 600)})
        with suppress(Full):
            self._waiting.put_nowait(record)


class _Libraries(logging.Handler):
    """Takes the warnings of libraries."""

    def __init__(self, log: Log) -> None:
        super().__init__(logging.WARNING)
        self._log = log

    def emit(self, record: logging.LogRecord) -> None:
        with suppress(Exception):
            self._log.line(f"{record.name}: {record.getMessage()}", record.name)


class _Stderr(logging.Handler):
    """Writes to the descriptor of stderr: a full pipe must not hold the stream of that name."""

    def __init__(self) -> None:
        super().__init__()
        self.lock = None  # at the end, `logging` would wait for it, and so for a full pipe
        self._stream = sys.stderr.fileno()
        # Clears a progress bar in this line; the bar is drawn again below.
        self._before = "\r\x1b[K" if os.isatty(self._stream) else ""

    def emit(self, record: logging.LogRecord) -> None:
        with suppress(OSError):  # no reader is left
            os.write(self._stream, f"{self._before}bumpbench: {record.msg}\n".encode())


def _file_handler(path: Path) -> logging.Handler:
    from daq import InputError

    require_log(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
        handler = RotatingFileHandler(path, "a", 1_000_000, 1, encoding="utf-8", delay=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(path), reason, "name another file for the log") from error
    stamped = logging.Formatter("%(asctime)s bumpbench: %(message)s")
    stamped.converter = time.gmtime
    stamped.default_time_format, stamped.default_msec_format = "%Y-%m-%dT%H:%M:%S", "%s.%03dZ"
    handler.setFormatter(stamped)
    return handler
