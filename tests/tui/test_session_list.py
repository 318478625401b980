"""The list of a folder's recordings and sessions: what is in it, and each line's columns."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from daq import write_session
from tui.jobs.gain import measured_spread
from tui.jobs.session_list import (
    EntryState,
    SessionEntry,
    contains,
    report_of,
    sessions_in,
    size_text,
    with_open,
)

from ..daq.crash_derive import journal_of_runs
from ..daq.small_campaign import small_bench
from .batches import refused_session

ENTRY = SessionEntry(
    "/b/granada/session_0001.h5", "/b/granada", "2026-11-21 10:42", "Granada",
    EntryState.READY, 11, 1, "wet road",
)  # fmt: skip


@pytest.mark.parametrize(
    ("size", "text"),
    [
        (0, "0 B"), (1023, "1023 B"), (1024, "1.0 kB"), (1536, "1.5 kB"), (1_048_575, "1024.0 kB"),
        (1_048_576, "1.0 MB"), (1_073_741_824, "1.0 GB"), (5_368_709_120_000, "5000.0 GB"),
    ],
)  # fmt: skip
def test_sizes_are_for_people(size: int, text: str) -> None:
    assert size_text(size) == text


@pytest.mark.parametrize(
    "words", ["", "2026-11-21", "GRANADA", "ready wet", "session_0001.h5", "road granada"]
)
def test_an_entry_is_found_by_any_of_its_words(words: str) -> None:
    assert contains(ENTRY, words)
    assert not contains(ENTRY, f"{words} escort")
    assert contains(replace(ENTRY, vehicle="Escort"), f"{words} granada"), "the folder's name"
    assert not contains(ENTRY, "b/")


def test_what_the_recorder_is_at_is_open() -> None:
    mine = replace(ENTRY, recording="r1", state=EntryState.CUT_OFF)
    assert with_open(mine, "r1").state is EntryState.OPEN
    assert with_open(mine, "r2") == mine
    assert with_open(ENTRY, "") == ENTRY


def test_files_of_a_folder_and_of_those_below_are_listed_the_newest_first(tmp_path: Path) -> None:
    session = replace(
        refused_session(1),
        provenance={
            "created": "2026-11-21T10:42:31Z",
            "notes": '[{"by": "MK", "label": "", "text": "wet"}]',
        },
    )
    (tmp_path / "granada" / "deep").mkdir(parents=True)
    paths = [tmp_path / "b.h5", tmp_path / "granada" / "a.h5", tmp_path / "granada/deep/c.h5"]
    for age_s, path in enumerate(paths):
        write_session(path, session)
        os.utime(path, (1e9 - age_s, 1e9 - age_s))
    (tmp_path / "gone.h5").symlink_to("nowhere.h5")
    (tmp_path / "bad.h5").write_text("no session")
    os.utime(tmp_path / "bad.h5", (2e9, 2e9))
    report_of(paths[1]).write_text("report")
    bad, first, second = sessions_in(tmp_path)
    assert (bad.name, bad.state, bad.accepted, bad.rejected) == (
        "bad.h5", EntryState.DAMAGED, 0, 0,
    )  # fmt: skip
    assert bad.note
    assert bad.date[:4] == "2033"
    assert (first.name, first.state, first.date) == (
        "b.h5", EntryState.READY, "2026-11-21 10:42",
    )  # fmt: skip
    assert (first.accepted, first.rejected) == (1, 0)
    assert first.folder == str(tmp_path)
    assert (second.folder, second.state) == (str(tmp_path / "granada"), EntryState.REPORTED)


def test_a_session_without_a_date_has_that_of_its_file(tmp_path: Path) -> None:
    write_session(tmp_path / "a.h5", replace(refused_session(1), provenance={}))
    os.utime(tmp_path / "a.h5", (1_795_267_320, 1_795_267_320))  # 2026-11-21 13:22 UTC
    (only,) = sessions_in(tmp_path)
    assert only.date[:9] == "2026-11-2"
    assert only.date[-2:] in ("22", "52", "37", "07"), "of any time zone"
    assert list(sessions_in(tmp_path / "absent")) == []


def test_a_recording_without_a_session_file_is_listed_first(tmp_path: Path) -> None:
    journal_of_runs(tmp_path / "journal", 8_000)
    write_session(tmp_path / "other.h5", refused_session(1))
    cut, other = sessions_in(tmp_path)
    assert (cut.path, cut.folder, cut.state) == ("", str(tmp_path), EntryState.CUT_OFF)
    assert (cut.accepted, cut.rejected, cut.recording) == (0, 4, "ab" * 16)
    assert cut.date[:4] == "2027", "of its head, 1.8e9 s of UNIX time"
    assert (cut.vehicle, cut.note, cut.name) == (small_bench().vehicle.name, "", "journal")
    assert with_open(cut, "ab" * 16).state is EntryState.OPEN
    assert other.name == "other.h5"
    (tmp_path / "session_0001.h5").write_bytes((tmp_path / "other.h5").read_bytes())
    names = {entry.name for entry in sessions_in(tmp_path)}
    assert names == {"other.h5", "session_0001.h5"}, "its file is there"


def test_a_journal_without_a_whole_head_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "journal").mkdir()
    (tmp_path / "journal" / "journal_0001.bbj").write_bytes(b"no journal at all")
    assert list(sessions_in(tmp_path)) == []


@pytest.mark.parametrize(
    ("repeats", "spread"),
    [([], None), ([1.0, 2.0], None), ([1.0, 1.0, 1.0], 0.0), ([1.0, 2.0, 3.0], 0.5),
     ([4.0, 5.0, 6.0], 0.2), ([9.0, 11.0, 9.0, 11.0], 0.11547005383792516)],
)  # fmt: skip
def test_a_spread_is_that_of_three_repeats_or_more(
    repeats: list[float], spread: float | None
) -> None:
    assert measured_spread(repeats) == (None if spread is None else pytest.approx(spread))
