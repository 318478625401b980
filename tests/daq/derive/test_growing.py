"""A session that grows run by run: the same file, byte for byte, as one that is built at once."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

from daq import read_session
from daq.bus.source import HopLosses
from daq.derive import build_session
from daq.derive.build_session import Derived, derive
from daq.derive.grown import forget_others, growing_path
from daq.derive.only_builder import only_builder
from daq.errors import InputError
from daq.journal.folder import is_unbroken, scanned
from daq.journal.format import JournalHead, head_record
from daq.journal.gaps import DISK_GAP, Gap, gap_event
from daq.journal.reader import read_windows
from daq.journal.retention import parting_events
from daq.journal.writer import JournalWriter
from daq.runlog.entries import entry, verdict_entry
from daq.runlog.runlog import Code
from daq.runs import Event
from daq.session import add_run
from dbc import FrameBatch

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

    def run(self, cut: bool = False) -> None:
        """Add a run in which a frame is lost with its first block, and the frames until the next.

        `cut`: begin a segment with that block.
        """
        self.runs += 1
        n = round(PERIOD_S * 1000)
        period = self._frames.select(slice((self.runs - 1) * n, self.runs * n))
        label = f"baseline_bounce_{self.runs}"
        bump_ns = int(period.t_ns[0]) + 500_000_000
        for k, block in enumerate(blocks(period)):
            if k == 4 and cut:
                self.writer.cut()
            self.writer.append(block, HopLosses(bus_dropped=self.runs - (k < 4)))
        self.writer.append_events([Event(bump_ns, Code.BUMP, 20.0, label)])
        self.writer.append_events([verdict_entry(bump_ns + 500_000_000, label, [])])
        self.writer.cut()

    def append(self, *events: Event) -> None:
        self.writer.append_events(events)
        self.writer.cut()

    def grow(self) -> Derived:
        left = [path for path in self.writer.paths if path.exists()]
        return derive(left, self.target, growing=True)

    def at_once(self) -> bytes:
        other = self.target.with_name("at_once.h5")
        derive(self.writer.paths, other)
        return other.read_bytes()


@pytest.fixture
def campaign(tmp_path: Path) -> Iterator[Campaign]:
    made = Campaign(tmp_path)
    with made.writer:
        yield made


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the numbers of the runs that are added to a growing file or to a session."""
    numbers: list[int] = []

    def noted(path: Path, number: int, *rest: Any) -> None:
        numbers.append(number)
        add_run(path, number, *rest)

    monkeypatch.setattr(build_session, "add_run", noted)
    return numbers


def test_each_run_is_measured_once_and_the_file_is_that_built_at_once(
    campaign: Campaign, measured: list[int]
) -> None:
    for number in (1, 2, 3):
        campaign.run()
        derived = campaign.grow()
        assert (derived.loss, len(derived.runs)) == ("", number)
        session = read_session(campaign.target)
        assert derived.runs == tuple(run.outline for run in session.runs)
        assert campaign.target.read_bytes() == campaign.at_once()
    assert measured == [1, *[1], 2, *[1, 2], 3, *[1, 2, 3]]  # grown, and at once
    dropped = [run.losses.bus_dropped for run in read_session(campaign.target).runs]
    assert dropped == [1, 1, 1]


def test_a_verdict_changes_the_session_and_measures_nothing(
    campaign: Campaign, measured: list[int]
) -> None:
    campaign.run()
    campaign.run()
    campaign.grow()
    now_ns = START_NS + 2_400_000_000
    reject = entry(Code.REJECT, now_ns, label="baseline_bounce_1", by="Ann", reason="slipped")
    note = entry(Code.NOTE, now_ns, text="wet floor", label="", by="Ann")
    campaign.append(reject, note)
    measured.clear()
    campaign.grow()
    assert measured == []
    first, second = read_session(campaign.target).runs
    assert first.reasons[0] == "rejected by Ann: slipped"
    assert (str(first.status), str(second.status)) == ("rejected", str(second.status))
    assert campaign.target.read_bytes() == campaign.at_once()


def test_another_bench_or_late_frames_measure_all_runs_again(
    campaign: Campaign, measured: list[int]
) -> None:
    campaign.run()
    campaign.run()
    campaign.grow()
    text = campaign.text.replace('name = "Ford Granada"', 'name = "Mine"')
    campaign.append(Event(START_NS, Code.BENCH, 0.0, text))
    measured.clear()
    campaign.grow()
    assert measured == [1, 2]
    assert read_session(campaign.target).vehicle.name == "Mine"
    # A bus that was held up delivers frames of the first run.
    late = bumps(small_codec(), 1, "HUB_Rear")
    campaign.writer.append(late, NO_LOSSES)
    campaign.writer.cut()
    measured.clear()
    campaign.grow()
    assert measured == [1, 2]
    assert any(group.name == "HUB_Rear" for group in read_session(campaign.target).runs[0].groups)
    assert campaign.target.read_bytes() == campaign.at_once()
    # So does an event in the window of a run, but not one behind it.
    behind_ns = START_NS + 2_200_000_001
    campaign.append(Event(behind_ns, "alarm", 1.0, "stale IMU: silent"))
    measured.clear()
    campaign.grow()
    assert measured == []
    campaign.append(Event(behind_ns - 1, "alarm", 1.0, "stale IMU: silent"))
    campaign.grow()
    assert measured == [1, 2]
    assert campaign.target.read_bytes() == campaign.at_once()


def test_a_run_that_is_not_over_is_measured_again(campaign: Campaign, measured: list[int]) -> None:
    campaign.run()
    frames = bumps(small_codec(), 2).select(slice(1200, 1900))  # the bump is at 1700
    campaign.writer.append(frames, NO_LOSSES)
    label = "baseline_bounce_2"
    campaign.append(Event(START_NS + 1_700_000_000, Code.BUMP, 20.0, label))
    campaign.grow()
    assert campaign.target.read_bytes() == campaign.at_once()
    assert "the recording ended" in read_session(campaign.target).runs[1].reasons[0]
    campaign.writer.append(bumps(small_codec(), 3).select(slice(1900, 3600)), NO_LOSSES)
    campaign.append(verdict_entry(START_NS + 2_300_000_000, label, []))
    measured.clear()
    campaign.grow()
    assert measured == [2]
    assert "ended" not in str(read_session(campaign.target).runs[1].reasons)
    assert campaign.target.read_bytes() == campaign.at_once()


@pytest.mark.parametrize("harm", ["cut", "no note", "changed note", "gone"])
def test_a_growing_file_that_is_not_as_it_was_left_is_begun_anew(
    campaign: Campaign, measured: list[int], harm: str
) -> None:
    campaign.run()
    campaign.grow()
    file = growing_path(campaign.target)
    note = file.with_name(f"{file.name}.json")
    match harm:
        case "cut":
            file.write_bytes(file.read_bytes()[:-10])
        case "no note":
            note.unlink()
        case "changed note":
            note.write_text(note.read_text().replace("baseline_bounce_1", "baseline_bounce_7"))
        case "gone":
            file.unlink()
    campaign.run()
    measured.clear()
    campaign.grow()
    assert measured == [1, 2]
    assert campaign.target.read_bytes() == campaign.at_once()


def test_a_session_of_a_recording_that_has_ended_leaves_nothing_beside_it(
    campaign: Campaign,
) -> None:
    campaign.run()
    campaign.grow()
    hidden = {path.name for path in campaign.target.parent.glob(".*")}
    assert hidden == {".session_0001.h5.growing", ".session_0001.h5.growing.json"}
    campaign.writer.close(ended=True)
    campaign.grow()
    assert list(campaign.target.parent.glob(".*")) == []
    assert campaign.target.read_bytes() == campaign.at_once()


def test_recover_deletes_the_growing_file_of_a_killed_recorder(campaign: Campaign) -> None:
    campaign.run()
    campaign.grow()
    with FileLock(campaign.target.with_name("recorder.lock")):
        derive(campaign.writer.paths, campaign.target)
    assert growing_path(campaign.target).exists(), "a recorder that runs needs it"
    built = campaign.target.read_bytes()
    derive(campaign.writer.paths, campaign.target)
    assert list(campaign.target.parent.glob(".*")) == []
    assert campaign.target.read_bytes() == built


def test_no_other_process_builds_in_the_same_folder_meanwhile(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone: list[bool] = []

    def noted(infos: Any) -> Any:
        with only_builder(campaign.target.parent, wait=False) as free:
            alone.append(free)
        return scanned(infos)

    monkeypatch.setattr(build_session, "scanned", noted)
    campaign.run()
    campaign.grow()
    with only_builder(campaign.target.parent, wait=False) as free:
        alone.append(free)
    assert alone == [False, True]


def test_only_the_segments_of_new_runs_are_read_if_the_journal_is_whole(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[list[str]] = []

    def noted(paths: list[Path], windows: list[tuple[int, int]]) -> object:
        read.append([path.name for path in paths])
        return read_windows(paths, windows)

    monkeypatch.setattr(build_session, "read_windows", noted)
    for _ in range(5):
        campaign.run()
        campaign.grow()
    assert read == [[f"journal_000{n}.mcap"] for n in (1, 2, 3, 4, 5)]
    # What was lost in the first block of a segment is known from the segment before.
    campaign.run(cut=True)
    campaign.grow()
    assert read[-1] == ["journal_0006.mcap", "journal_0007.mcap"]
    assert campaign.target.read_bytes() == campaign.at_once()
    assert [run.losses.bus_dropped for run in read_session(campaign.target).runs] == [1] * 6
    campaign.writer.paths[1].unlink()
    campaign.run()
    assert "blocks missing" in campaign.grow().loss
    assert len(read[-1]) == 7  # all that are left


def test_segments_given_up_between_runs_do_not_make_a_journal_broken(
    campaign: Campaign, measured: list[int]
) -> None:
    campaign.run()
    idle = replace_times(bumps(small_codec(), 1, "HUB_Rear"), 20)
    campaign.writer.append(idle, NO_LOSSES)
    campaign.writer.cut()
    (gone,) = [info for info in scanned(campaign.writer.paths) if info.number == 2]
    assert is_unbroken(scanned(campaign.writer.paths))
    gone.path.unlink()
    left = [path for path in campaign.writer.paths if path.exists()]
    assert not is_unbroken([*scanned(left), replace(gone, first=gone.stop, stop=gone.stop + 1)])
    campaign.append(*parting_events(gone, "a" * 32, START_NS))
    left = [path for path in campaign.writer.paths if path.exists()]
    assert is_unbroken(scanned(left))
    assert campaign.grow().loss == ""
    campaign.append(gap_event(DISK_GAP, START_NS, Gap("a" * 32, 90, 91, 5)))
    left = [path for path in campaign.writer.paths if path.exists()]
    assert not is_unbroken(scanned(left))
    assert measured == [1]


def replace_times(frames: FrameBatch, seconds: int) -> FrameBatch:
    return replace(frames, t_ns=frames.t_ns + seconds * 10**9)


def test_a_recorder_deletes_growing_files_that_no_campaign_needs(tmp_path: Path) -> None:
    names = [f".session_000{n}.h5.growing{end}" for n in (1, 2) for end in ("", ".json")]
    partial = [f"..session_000{n}.h5.growing.json.tmp" for n in (1, 2)]
    for name in (*names, *partial, "session_0001.h5", ".session_0001.h5.tmp"):
        (tmp_path / name).touch()
    with only_builder(tmp_path):
        forget_others(tmp_path, [])
    assert len(list(tmp_path.iterdir())) == 8, "the builder of a killed recorder writes to one"
    forget_others(tmp_path, [tmp_path / "session_0002.h5"])
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {*names[2:], "session_0001.h5", ".session_0001.h5.tmp"}


def test_a_journal_of_an_older_version_is_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def older(head: JournalHead, segment: int) -> dict[str, str]:
        record = head_record(head, segment)
        return {name: text for name, text in record.items() if name not in ("span", "origin")}

    monkeypatch.setattr("daq.journal.writer.head_record", older)
    campaign = Campaign(tmp_path)
    with campaign.writer:
        campaign.run()
        assert len(campaign.grow().runs) == 1
    session = read_session(campaign.target)
    assert session.provenance["origin"] == "real"
    assert campaign.target.read_bytes() == campaign.at_once()


def test_a_full_disk_is_an_error_and_the_session_stays(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign.run()
    campaign.grow()
    before = campaign.target.read_bytes()
    campaign.run()
    with monkeypatch.context() as patch:
        usage = type("Usage", (), {"free": 1000})
        patch.setattr("daq.session.growing.shutil.disk_usage", lambda _: usage)
        with pytest.raises(InputError, match="No space left on device"):
            campaign.grow()
    assert campaign.target.read_bytes() == before
    campaign.grow()
    assert len(read_session(campaign.target).runs) == 2


def test_a_growing_file_that_is_being_changed_is_not_used_by_the_next_process(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign.run()
    campaign.grow()
    campaign.run()

    def killed(*_: Any) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(build_session, "add_run", killed)
        with pytest.raises(InputError, match="Input/output"):
            campaign.grow()
    file = growing_path(campaign.target)
    assert file.exists()
    assert not file.with_name(f"{file.name}.json").exists()
    assert len(campaign.grow().runs) == 2
    assert campaign.target.read_bytes() == campaign.at_once()


def test_a_segment_that_is_still_written_is_no_loss(campaign: Campaign) -> None:
    campaign.run()
    campaign.writer.append(bumps(small_codec(), 1).select(slice(0, 5)), NO_LOSSES)
    assert campaign.writer.paths[-1].name.startswith("open_")
    derived = derive(campaign.writer.paths, campaign.target)
    assert (derived.loss, len(derived.runs)) == ("", 1)
    assert read_session(campaign.target).provenance["journal_losses"] == "none"
