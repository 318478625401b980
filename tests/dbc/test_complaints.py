"""What cantools logs while it reads: collected once each, and its logger left as it was."""

from __future__ import annotations

import logging

import pytest

from dbc.reader.complaints import complaints


@pytest.mark.parametrize(("level", "propagate"), [(logging.ERROR, True), (logging.INFO, False)])
def test_a_logger_is_left_as_it_was(level: int, propagate: bool) -> None:
    logger = logging.getLogger("cantools")
    usual = logger.level, logger.propagate, list(logger.handlers)
    logger.setLevel(level)
    logger.propagate = propagate
    try:
        with complaints() as found:
            assert (logger.level, logger.propagate) == (logging.DEBUG, False)
        assert (logger.level, logger.propagate) == (level, propagate)
        assert logger.handlers == usual[2]
        assert found == {}
        with pytest.raises(ValueError, match="broken"), complaints():
            raise ValueError("broken")
        assert (logger.level, logger.handlers) == (level, usual[2])
    finally:
        logger.setLevel(usual[0])
        logger.propagate = usual[1]


def test_warnings_are_kept_once_and_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    logger = logging.getLogger("cantools.database.can.formats.arxml")
    with complaints() as found:
        logger.warning("second %s", "sight")
        logger.error("first")
        logger.warning("second sight")
        logger.info("loading")
        logger.debug("Compu method category 'TAB_NOINTP' is not supported")
        logger.debug("tick")
        logger.warning("Signal scaling is currently only supported for positive scaling factors")
    assert list(found) == [
        "second sight", "first", "Compu method category 'TAB_NOINTP' is not supported",
    ]  # fmt: skip
    assert capsys.readouterr() == ("", "")
