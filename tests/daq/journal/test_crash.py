"""The campaigns of `make crash`, short."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from ..crash_derive import journal_of_runs, kill_derive
from ..crash_faults import KINDS, faults
from ..crash_full import mounted_disk, run_full, small_disk
from ..crash_images import images
from ..crash_taken import TAKINGS, read_only, take_away


def test_a_crash_image_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    assert images(tmp_path, 300, seed=12) > 0


def test_an_operation_that_fails_loses_nothing_and_is_reported(tmp_path: Path) -> None:
    operations = [*range(1, 24, 2), *range(30, 201, 34)]
    assert faults(tmp_path, operations) == len(KINDS) * len(operations)


@pytest.mark.parametrize("reserve", [0.0, 100_000.0])
def test_a_full_disk_costs_only_what_it_says(tmp_path: Path, reserve: float) -> None:
    full = run_full(small_disk(tmp_path / "full", 1_234_567), reserve, full_s=90.0)
    assert full.dropped > 0
    assert full.alarm_s <= 1.0
    assert full.resumed_s <= 5.0
    assert full.grown_bytes < 50_000_000


def test_a_mounted_disk_that_is_full_costs_nothing_while_memory_holds(tmp_path: Path) -> None:
    with mounted_disk(tmp_path / "mounted", 800_000) as mounted:
        disk = mounted or small_disk(tmp_path / "full", 800_000)
        assert run_full(disk, 0.0, full_s=5.0).dropped == 0


@pytest.mark.parametrize("how", TAKINGS.values(), ids=TAKINGS)
def test_what_is_taken_away_is_reported(tmp_path: Path, how: Callable[[Path], object]) -> None:
    assert take_away(tmp_path / "journal", how) <= 2.0


def test_a_disk_that_turns_read_only_is_waited_for(tmp_path: Path) -> None:
    read_only(tmp_path / "journal")


def test_a_derivation_that_is_killed_leaves_a_whole_file_or_none(tmp_path: Path) -> None:
    segments = journal_of_runs(tmp_path / "journal", 100_000)
    assert len(segments) > 1
    done = kill_derive(tmp_path, segments, 2)
    assert done.writing >= 1
    assert done.absent >= 1, "what is being written has not its final name"
