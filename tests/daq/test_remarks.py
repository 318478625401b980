"""Remarks on a session, from a provenance that may come from any program."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from daq.runlog.run_log import Override, Remark
from daq.sessions import notes_of, overrides_of


def test_notes_and_overrides_are_given_with_their_names() -> None:
    notes = [Remark(1, "step check done"), Remark(2, "tyre changed", "", "MK"),
             Remark(3, "door slammed", "baseline_roll_1", "AB")]  # fmt: skip
    overrides = [Override(4, "channel x", "noisy, but unused", "MK")]
    provenance = {
        "notes": json.dumps([asdict(note) for note in notes]),
        "overrides": json.dumps([asdict(override) for override in overrides]),
    }
    assert notes_of(provenance) == ("tyre changed (MK)", "baseline_roll_1: door slammed (AB)")
    assert overrides_of(provenance) == ("channel x: noisy, but unused (MK)",)


@pytest.mark.parametrize("text", ["plain words", "[1]", '[{"by": 1}]', "{", "[" * 100_000, "7"])
def test_what_is_not_as_we_write_it_is_returned_as_it_is(text: str) -> None:
    assert notes_of({"notes": text}) == overrides_of({"overrides": text}) == (text,)


def test_nothing_was_said() -> None:
    assert notes_of({}) == overrides_of({"overrides": ""}) == ()
