"""The description that goes with an export: what does not fit it is refused, and what is kept."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.errors import InputError
from daq.formats.description import (
    Columns,
    Description,
    FrameSpan,
    GroupDescription,
    RunDescription,
    describe,
    description_of,
    session_of,
    sidecar_of,
    text_of,
)
from daq.formats.export.matlab import fields_of
from daq.sessions import Session

from ..small_session import small_session

SESSION = small_session()
ABOUT = describe(replace(SESSION, runs=SESSION.runs[:1]))


def _columns(group: GroupDescription, **changes: Any) -> Columns:
    values = {name: np.arange(group.samples) + 0.0 for name in group.channels}
    whole: dict[str, Any] = {"time_s": np.arange(group.samples) / 8, "t_ns": None, "values": values}
    whole |= changes
    return whole["time_s"], whole["t_ns"], whole["values"]


def _session(about: Description = ABOUT, **changes: Any) -> Session:
    def samples(run: RunDescription, group: GroupDescription) -> Columns:
        return _columns(group, **changes if group.name == "A_IMU" else {})

    return session_of(about, samples, "a.x")


def test_bus_times_that_a_file_does_not_hold_are_those_of_the_samples() -> None:
    run = _session().runs[0]
    assert (run.groups[1].t_ns - run.t0_ns).tolist() == [0, 125_000_000, 250_000_000]
    kept = _session(t_ns=np.array([7, 8, 9])).runs[0]
    assert kept.groups[1].t_ns.tolist() == [7, 8, 9]
    assert len(kept.frames) == 0


def _marked(*marks: tuple[int, int]) -> Description:
    run = ABOUT.runs[0]
    groups = (run.groups[0], replace(run.groups[1], marks=marks))
    return replace(ABOUT, runs=(replace(run, groups=groups),))


@pytest.mark.parametrize(
    ("mark", "good"),
    [
        ((0, 1), True),
        ((2, 255), True),
        ((1, 0), True),
        ((3, 1), False),
        ((-1, 1), False),
        ((0, 256), False),
        ((0, -1), False),
    ],
)
def test_marks_of_quality(mark: tuple[int, int], good: bool) -> None:
    if good:
        quality = _session(_marked(mark)).runs[0].groups[1].quality.tolist()
        assert quality[mark[0]] == mark[1]
        assert sum(quality) == mark[1]
        return
    with pytest.raises(InputError, match=f"no sample {mark[0]}"):
        _session(_marked(mark))


@pytest.mark.parametrize(
    "time_s",
    [
        [0.0, 1.0],
        [0.0, 1.0, 2.0, 3.0],
        [0.0, 1.0, 1.0],
        [0.0, 2.0, 1.0],
        [0.0, 1.0, np.nan],
        [0.0, 1.0, np.inf],
    ],
)
def test_samples_that_are_not_those_described_are_refused(time_s: list[float]) -> None:
    with pytest.raises(InputError, match="A_IMU") as refused:
        _session(time_s=np.array(time_s))
    assert refused.value.where == "a.x"


def test_a_channel_that_is_not_there_is_refused() -> None:
    with pytest.raises(InputError, match="pitch"):
        _session(values={"az": np.zeros(3)})


def test_weights_keep_their_order() -> None:
    weights = _session().mass_states[1].added.weights
    assert weights == SESSION.mass_states[1].added.weights
    state = ABOUT.mass_states[1]
    assert state.order == (True, False)
    turned = replace(ABOUT, mass_states=(ABOUT.mass_states[0], replace(state, order=(False, True))))
    assert _session(turned).mass_states[1].added.weights == weights[::-1]
    for order in ((True,), (True, True), (False, False), (True, False, False)):
        odd = replace(ABOUT, mass_states=(ABOUT.mass_states[0], replace(state, order=order)))
        with pytest.raises(InputError, match="weights of added"):
            _session(odd)


def test_what_is_described_of_runs_in_files_and_logs() -> None:
    label = SESSION.runs[1].label
    spans = {label: FrameSpan(1, 2, 3)}
    about = describe(SESSION, {(label, "A_IMU"): "x.csv"}, spans)
    assert [run.span for run in about.runs] == [None, FrameSpan(1, 2, 3), None]
    assert [[group.file for group in run.groups] for run in about.runs] == (
        [["", ""], ["", "x.csv"], ["", ""]]
    )
    assert [group.samples for group in about.runs[0].groups] == [500, 3]
    quality = SESSION.runs[0].groups[0].quality
    assert list(about.runs[0].groups[0].marks) == [
        (i, int(bits)) for i, bits in enumerate(quality) if bits
    ]


def _damaged(change: Callable[[dict[str, Any]], None]) -> str:
    document = json.loads(text_of(ABOUT))
    change(document)
    return json.dumps(document)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda d: d.update(version=2), "version 2"),
        (lambda d: d["provenance"].update(uuid=7), "provenance"),
        (lambda d: d["vehicle"].update(name=7), r"vehicle\.name"),
        (lambda d: d.pop("channels"), "channels"),
    ],
)
def test_a_text_that_is_no_description_is_refused(
    change: Callable[[dict[str, Any]], None], why: str
) -> None:
    with pytest.raises(InputError, match=why) as refused:
        description_of(_damaged(change), "a.json")
    assert refused.value.where == "a.json"


def test_an_older_version_and_numbers_that_json_lacks_are_read() -> None:
    assert description_of(_damaged(lambda d: d.update(version=0)), "a").version == 0
    odd = replace(ABOUT, runs=(replace(ABOUT.runs[0], bump_s=float("-inf")),))
    text = text_of(odd)
    assert json.loads(text, parse_constant=lambda word: pytest.fail(word))
    assert description_of(text, "a").runs[0].bump_s == float("-inf")


def test_the_place_of_a_description() -> None:
    assert sidecar_of(Path("x/car.uff")) == Path("x/car.uff.bumpbench.json")


def test_names_become_fields_of_matlab_each_once() -> None:
    long = "n" * 70
    names = ["a", "a b", "a-b", "1st", "", "µ", "_x", long, long + "x", "t"]
    assert list(fields_of(((name, 0) for name in names), taken=("t",))) == [
        "a",
        "a_b",
        "a_b_2",
        "x1st",
        "x",
        "x_",
        "x_x",
        "n" * 63,
        "n" * 59 + "_2",
        "t_2",
    ]
