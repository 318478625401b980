"""What a source counts up to its very end is in the last status and in the journal."""

from __future__ import annotations

from pathlib import Path

from daq.bench.config import Bench
from daq.bus.source import SourceLosses
from daq.journal.folder import segments_in
from daq.journal.reader import read_journal

from ..quick_bench import quick
from ..recorder_run import Running, Script, sources

__all__ = ["quick"]  # a fixture


class Counting(Script):
    """A source that has lost one more frame each time it is asked."""

    asked = 0

    def losses(self) -> SourceLosses:
        self.asked += 1
        return SourceLosses(dropped=self.asked)


def test_losses_that_are_counted_as_a_bus_is_closed_are_stored(
    quick: Bench, tmp_path: Path
) -> None:
    source = Counting([])
    with Running(quick, tmp_path, sources(source)) as running:
        running.until(lambda _: source.exhausted.is_set())
    assert source.closed.is_set()
    assert running.published[-1].losses.bus_dropped == source.asked
    stored = read_journal(segments_in(tmp_path / "journal")).hops
    assert stored.counts[-1, 0] == source.asked
