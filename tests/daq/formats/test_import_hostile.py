"""Hostile logs of loggers: truncated, foreign, reserved on the disk, mutated."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.errors import InputError
from daq.formats.log import read_log

from .loggers import WRITERS
from .mixed import mixed
from .mutations import Outcome, attempt, campaign
from .test_import_loggers import CASES


def test_mutants_of_every_format_are_read_or_refused_in_one_line() -> None:
    outcome = campaign(8)
    assert not outcome.faults
    assert outcome.ends["read with losses"] > 8
    assert outcome.ends["refused"] > 0


@pytest.mark.parametrize("name", CASES)
def test_a_log_cut_off_gives_what_is_whole(tmp_path: Path, name: str) -> None:
    frames = [f for f in mixed(300) if CASES[name](f) is not None]
    path = tmp_path / "a"
    WRITERS[name][1](path, frames)
    raw = path.read_bytes()
    counts, lost = [], False
    for share in (0.2, 0.5, 0.8):
        path.write_bytes(raw[: int(len(raw) * share)])
        try:
            log = read_log(path)
            counts.append(sum(len(batch) for batch in log))
            lost |= log.loss.any
        except InputError:  # what comes first describes the rest
            counts.append(0)
    assert counts == sorted(counts)
    assert counts[-1] > 0.5 * len(frames)
    assert lost


@pytest.mark.parametrize("name", [*CASES, "nothing"])
def test_a_file_of_10_gb_with_nothing_in_it_costs_nothing(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a"
    if name in WRITERS:
        WRITERS[name][1](path, [f for f in mixed(100) if CASES[name](f) is not None])
    else:
        path.touch()
    with path.open("r+b") as file:
        file.truncate(10 << 30)
    outcome = Outcome()
    attempt(path, name, outcome)
    assert not outcome.faults
    assert outcome.slowest_s < 2.0
