"""A log that never blocks its caller: neither on a full pipe nor on a repeating fault."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler
from pathlib import Path
from queue import Full, Queue
from typing import Any

from daq import InputError
from dbc.words import printable

BURST = 5
"""Largest number of lines with one key in a minute; further lines are left out."""


class Log:
    """Writes lines to stderr or to a file, from its own thread.

    Warnings of libraries are written too.  In a file each line begins with the UTC at which it was
    logged; lines on stderr are stamped by the program that stores them.  `path`: a file instead of
    stderr; at 1 MB it is renamed to `*.1`, which replaces an earlier one, and a new file is begun.
    Raises InputError if the file cannot be written.
    """

    def __init__(self, path: Path | None) -> None:
        self._writer = _StderrHandler() if path is None else _file_handler(path)
        # Lines that wait for a slow reader; further ones are left out.
        waiting: Queue[Any] = Queue(1000)
        self._listener = QueueListener(waiting, self._writer)
        self._handler = QueueHandler(waiting)
        self._handler.addFilter(_FloodFilter())
        self._logger = logging.getLogger("bumpbench")

    def __enter__(self) -> Log:
        # A handler that cannot write must not report that to the same stderr.
        logging.raiseExceptions = False
        logging.captureWarnings(True)
        self._logger.setLevel(logging.INFO)
        logging.getLogger().addHandler(self._handler)
        self._listener.start()
        return self

    def __exit__(self, *_: object) -> None:
        logging.getLogger().removeHandler(self._handler)
        logging.captureWarnings(False)
        logging.raiseExceptions = True

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
        self._logger.info("%s", text, extra={"key": key})


class _FloodFilter(logging.Filter):
    """Leaves out lines beyond `BURST` with one key in a minute; a library's name is its key."""

    def __init__(self) -> None:
        super().__init__()
        self._minute = 0
        self._counts: Counter[str] = Counter()

    def filter(self, record: logging.LogRecord) -> bool:
        minute = int(time.monotonic() // 60.0)
        if minute != self._minute:
            self._minute = minute
            self._counts.clear()
        key = getattr(record, "key", record.name)
        self._counts[key] += 1
        return not key or self._counts[key] <= BURST


class _OneLine(logging.Formatter):
    """One line without characters that act on a terminal, after the program or the library."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record), 600)


class _StderrHandler(logging.Handler):
    """Writes to the descriptor of stderr: a full pipe must not hold the stream of that name."""

    def __init__(self) -> None:
        super().__init__()
        self.lock = None  # at the end, `logging` would wait for it, and so for a full pipe
        self.setFormatter(_OneLine("%(name)s: %(message)s"))
        self._stream = sys.stderr.fileno()
        # Clears a progress bar in this line; the bar is drawn again below.
        self._line_start = "\r\x1b[K" if os.isatty(self._stream) else ""

    def emit(self, record: logging.LogRecord) -> None:
        with suppress(OSError):  # no reader is left
            os.write(self._stream, f"{self._line_start}{self.format(record)}\n".encode())


def _file_handler(path: Path) -> logging.Handler:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
        handler = RotatingFileHandler(path, "a", 1_000_000, 1, encoding="utf-8", delay=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(path), reason, "name another file for the log") from error
    stamped = _OneLine("%(asctime)s %(name)s: %(message)s")
    stamped.converter = time.gmtime
    stamped.default_time_format, stamped.default_msec_format = "%Y-%m-%dT%H:%M:%S", "%s.%03dZ"
    handler.setFormatter(stamped)
    return handler
