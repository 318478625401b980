"""Messages that cantools logs while it reads a database, collected in place of printed."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

_HARMLESS = "Signal scaling is currently only supported for positive scaling factors"
"""Of a negative factor cantools exchanges the limits alone, which `foreign` puts right."""
_UNKNOWN_METHOD = "Compu method category"
"""Begins what is logged for debugging only, although the values are then raw ones."""


class _Collector(logging.Handler):
    """Keeps each message once, in order."""

    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        loud = record.levelno >= logging.WARNING and not text.startswith(_HARMLESS)
        if loud or text.startswith(_UNKNOWN_METHOD):
            self.found[text] = None


@contextmanager
def complaints() -> Iterator[dict[str, None]]:
    """Collect what cantools logs that concerns values, as the keys; nothing is printed."""
    logger, collector = logging.getLogger("cantools"), _Collector()
    before = logger.level, logger.propagate
    logger.addHandler(collector)
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    try:
        yield collector.found
    finally:
        logger.removeHandler(collector)
        logger.setLevel(before[0])
        logger.propagate = before[1]
