"""Collects the messages that cantools logs while it reads a database, instead of printing them."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

_HARMLESS = "Signal scaling is currently only supported for positive scaling factors"
"""Message on a negative factor: cantools then only exchanges the limits, which `foreign`
corrects."""
_UNKNOWN_METHOD = "Compu method category"
"""Beginning of a message that cantools logs at debug level, although the values are then raw
values."""


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
    """Collect the logged messages of cantools that concern values, as keys; nothing is printed."""
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
