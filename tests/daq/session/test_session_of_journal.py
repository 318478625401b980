"""Sessions built from a journal, run by run: what reaches them, and that they are never less."""

from __future__ import annotations

import fcntl
import os
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from daq import read_session
from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from daq.runlog import Code, entry, verdict_entry
from daq.runs import Event
from daq.session.build import Derived, derive

from ..small_campaign import PERIOD_S, START_NS, blocks, bumps, small_bench, small_codec

NO_LOSSES = HopLosses()


class Campaign:
    """A journal to which runs are added; a bump every 1.2 s, with 0.6 s of frames around it."""

    def __init__(self, folder: Path) -> None:
        self.text = small_bench().text
        for key, value in (("pre_s", 0.1), ("post_s", 0.5), ("rest_s", 0.1)):
            self.text = re.sub(rf"^{key} = [^#\n]*", f"{key} = {value} ", self.text, flags=re.M)
        dbc = small_bench().dbc_text
        head = JournalHead(self.text, dbc, "test", START_NS, 0, "a" * 32, 1)
        self.writer = JournalWriter(folder / "journal", head)
        self.target = folder / "session_0001.h5"
        self._frames = bumps(small_codec(), 12)
        self.runs = 0

    def run(self) -> None:
        """Add a run, whose first block loses a frame, and the frames until the next."""
        self.runs += 1
        n = round(PERIOD_S * 1000)
        period = self._frames.select(slice((self.runs - 1) * n, self.runs * n))
        label = f"baseline_bounce_{self.runs}"
        bump_ns = int(period.t_ns[0]) + 500_000_000
        for k, block in enumerate(blocks(period)):
            self.writer.append(block, HopLosses(bus_dropped=self.runs - (k < 4)))
        self.writer.append_events([Event(bump_ns, Code.BUMP, 20.0, label)])
        self.writer.append_events([verdict_entry(bump_ns + 500_000_000, label, [])])
        self.writer.cut()

    def append(self, *events: Event) -> None:
        self.writer.append_events(events)
        self.writer.cut()

    def build(self) -> Derived:
        left = [path for path in self.writer.paths if path.exists()]
        return derive(left, self.target)


@pytest.fixture
def campaign(tmp_path: Path) -> Iterator[Campaign]:
    made = Campaign(tmp_path)
    with made.writer:
        yield made


def test_runs_verdicts_benches_and_late_frames_reach_the_session(campaign: Campaign) -> None:
    for number in (1, 2, 3):
        campaign.run()
        derived = campaign.build()
        assert (derived.loss, len(derived.session.runs)) == ("", number)
        stored = read_session(campaign.target)
        assert [run.label for run in stored.runs] == [run.label for run in derived.session.runs]
    assert [run.losses.bus_dropped for run in stored.runs] == [1, 1, 1]
    now_ns = START_NS + 2_400_000_000
    campaign.append(
        entry(Code.REJECT, now_ns, label="baseline_bounce_1", by="Ann", reason="slipped"),
        Event(START_NS, Code.BENCH, 0.0, campaign.text.replace('"Ford Granada"', '"Mine"')),
    )
    campaign.writer.append(bumps(small_codec(), 1, "HUB_Rear"), NO_LOSSES)  # a bus held up
    campaign.writer.cut()
    campaign.build()
    stored = read_session(campaign.target)
    assert stored.vehicle.name == "Mine"
    assert stored.runs[0].reasons[0] == "rejected by Ann: slipped"
    assert any(group.name == "HUB_Rear" for group in stored.runs[0].groups)
    built = campaign.target.read_bytes()
    campaign.build()
    assert campaign.target.read_bytes() == built
    assert list(campaign.target.parent.glob(".*")) == []


def test_no_other_process_builds_in_the_same_folder_meanwhile(campaign: Campaign) -> None:
    campaign.run()
    fd = os.open(campaign.target.parent, os.O_RDONLY)
    fcntl.flock(fd, fcntl.LOCK_EX)
    builder = threading.Thread(target=campaign.build)
    builder.start()
    builder.join(0.3)
    assert builder.is_alive()
    assert not campaign.target.exists()
    os.close(fd)
    builder.join(30.0)
    assert campaign.target.exists()


def test_missing_blocks_are_named_and_a_session_with_more_is_kept(campaign: Campaign) -> None:
    for _ in range(3):
        campaign.run()
    campaign.build()
    whole = campaign.target.read_bytes()
    campaign.writer.paths[1].unlink()
    left = [path for path in campaign.writer.paths if path.exists()]
    with pytest.raises(InputError, match="has more of baseline_bounce_2 than the journal now"):
        derive(left, campaign.target, replacing=False)
    assert campaign.target.read_bytes() == whole
    assert "blocks missing" in campaign.build().loss
    campaign.target.write_bytes(b"mine")
    with pytest.raises(InputError, match="is no session or a changed one"):
        derive(left, campaign.target, replacing=False)


def test_a_segment_that_is_still_written_is_no_loss(campaign: Campaign) -> None:
    campaign.run()
    campaign.writer.append(bumps(small_codec(), 1).select(slice(0, 5)), NO_LOSSES)
    assert campaign.writer.paths[-1].name.startswith("open_")
    derived = derive(campaign.writer.paths, campaign.target)
    assert (derived.loss, len(derived.session.runs)) == ("", 1)
    assert read_session(campaign.target).provenance["journal_losses"] == "none"
