"""A simulated or replayed recording is distinguished from a measurement, from journal to report."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.campaign import Origin
from daq.bench.config import Bench
from daq.derive.build_session import derive
from daq.journal.folder import last_recording, segments_in
from daq.journal.format import JournalHead
from daq.journal.reader import read_journal
from daq.journal.writer import JournalWriter
from daq.recorder.open_recording import resumable
from daq.recorder.orders import configured
from daq.session import read_session
from identify.report.content import _title

from ..crash_disk import QuickFile
from ..small_campaign import START_NS, small_bench


def _recorded(folder: Path, bench: Bench) -> tuple[Path, ...]:
    head = JournalHead(
        bench.text, bench.dbc_text, "test", START_NS, 0, "ab" * 16, origin=bench.origin
    )
    with JournalWriter(folder, head, create=QuickFile) as writer:
        writer.append_events([])
    return segments_in(folder)


@pytest.mark.parametrize(
    ("origin", "title"),
    [
        (Origin.REAL, "small"),
        (Origin.SIMULATED, "small (simulated, not measured)"),
        (Origin.REPLAYED, "small (replayed, not measured)"),
    ],
)
def test_it_is_in_journal_session_and_report(tmp_path: Path, origin: Origin, title: str) -> None:
    bench = replace(small_bench(), origin=origin)
    segments = _recorded(tmp_path / "journal", bench)
    assert read_journal(segments).head.origin == origin
    derive(segments, tmp_path / "s.h5")
    session = read_session(tmp_path / "s.h5")
    assert session.provenance["origin"] == origin
    named = replace(session, vehicle=replace(session.vehicle, name="small"))
    assert _title(named) == title


def test_a_simulated_recording_is_not_gone_on_with_from_a_bus(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bench = small_bench()
    simulated = replace(bench, origin=Origin.SIMULATED)
    _recorded(tmp_path, simulated)
    assert last_recording(tmp_path) is not None
    with caplog.at_level(logging.WARNING):
        assert resumable(tmp_path, bench) == (
            "the last recording was not ended and cannot be resumed (its frames are simulated, not"
            " real): a new one is begun"
        )
    assert "its frames are simulated, not real" in caplog.text
    found = resumable(tmp_path, simulated)
    assert not isinstance(found, str)
    assert found[1].origin is Origin.SIMULATED


def test_a_new_bench_in_mid_recording_keeps_its_origin() -> None:
    simulated = replace(small_bench(), origin=Origin.SIMULATED)
    assert configured(simulated, simulated.text + "\n").origin is Origin.SIMULATED
