"""A short campaign for the recorder's tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from daq.bench.config import Bench
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from dbc import Codec

from .small_campaign import START_NS, small_bench, small_codec


@pytest.fixture(scope="module")
def bench() -> Bench:
    return small_bench()


@pytest.fixture(scope="module")
def codec() -> Codec:
    return small_codec()


@pytest.fixture
def journal(bench: Bench, tmp_path: Path) -> Iterator[JournalWriter]:
    head = JournalHead(bench.text, bench.dbc_text, "test", START_NS, 0)
    with JournalWriter(tmp_path, head) as journal:
        yield journal
