"""What the planner's answer looks like: on stdout, as a document, and as the terminal's outlook."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

import pytest

from daq.bench.config import load_bench
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA
from identify import Estimate
from identify.plan import Advice, NextStep, Plan
from identify.plan.outlook import DamperPoint, Outlook
from tui.cli import run
from tui.jobs.gain import expected_gain
from tui.jobs.planning import planned, sensors

BENCH = load_bench(None)
KNOWN = Outlook(
    parameters={
        "m_s": Estimate(1380.0, 3.8, 1372.4, 1387.6, "kg"),
        "a": Estimate(1.25, 0.0, 1.25, 1.25, "m"),
        "y_s": Estimate(0.01, 0.001, 0.008, 0.012, "m"),
    },
    relative={"m_s": 0.0055},
    undetermined=(),
    reasons=(),
    worst=0.0055,
    mean=0.0025,
    open_directions=0,
    elements={"F_cf": Estimate(50.0, 2.0, 46.1, 53.9, "N")},
    dampers=(DamperPoint("front", -0.2, -400.0, 10.0), DamperPoint("rear", 0.4, 500.0, 25.0)),
)
LOST = replace(
    KNOWN,
    parameters={**KNOWN.parameters, "I_xx": Estimate(380.0, inf, -inf, inf, "kg m2")},
    undetermined=("I_xx", "t_f"),
    reasons=("no roll",),
    worst=inf,
    mean=inf,
    dampers=(),
)
BETTER = NextStep("weigh each axle to 1 kg", replace(KNOWN, worst=0.004, mean=0.002))


@pytest.fixture
def answer(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return what the planner was asked; its answer is the element that a test puts first."""
    asked: list[Any] = [Advice(KNOWN, (BETTER,), ())]

    def advise(plan: Plan, *_: object, **__: object) -> Any:
        asked.append(plan)
        return asked[0]

    monkeypatch.setattr("identify.plan.advise", advise)
    monkeypatch.setattr("identify.plan.compare_campaigns", lambda *_, **__: (BETTER,))
    return asked


def printed(capsys: pytest.CaptureFixture[str], *words: str, code: int) -> list[list[str]]:
    assert run(["plan", *words]) == code
    lines = capsys.readouterr().out.splitlines()
    return [re.split(r"\s{2,}", line.strip()) for line in lines]


def test_a_plan_is_printed_with_its_elements_steps_and_other_campaigns(
    answer: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    lines = printed(capsys, code=0)
    assert lines[0][0].startswith("Runs: 2 x baseline bounce, 2 x baseline pitch")
    assert lines[0][0].endswith("2 x added roll; bump of 50 mm")
    assert lines[1] == ["Sensors: 11 at 500 .. 1000 Hz, with the usual noise of their kind"]
    for row in (
        ["parameter", "expected", "95 % interval", "±", "unit"],
        ["m_s", "1,380.0", "± 7.6", "0.55 %", "kg"],
        ["a", "1.2500", "given", "m"],
        ["y_s", "0.0100", "± 0.0020", "m"],
        ["element", "expected", "95 % interval", "unit"],
        ["front friction", "50.0", "± 3.9", "N"],
        ["axle", "speed m/s", "force N", "95 % interval", "±"],
        ["front", "-0.2", "-400", "± 20", "5.00 %"],
        ["rear", "+0.4", "500", "± 50", "10.00 %"],
        ["next step, each by itself", "worst", "mean"],
        ["(as planned)", "± 0.55 %", "± 0.25 %"],
        ["weigh each axle to 1 kg", "± 0.40 %", "± 0.20 %"],
        ["campaign instead of it", "worst", "mean"],
    ):
        assert row in lines, row
    assert not any(line[0].startswith("not determined") for line in lines)
    (plan,) = answer[1:]
    assert plan.bump.height_m == 0.05  # that of the shipped bench


def test_a_plan_that_leaves_something_open_says_what_and_why(
    answer: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    answer[0] = Advice(LOST, (), ("one roll run",))
    words = ["--rate", "200", "--bump-mm", "25"]
    lines = printed(capsys, *words, code=1)
    assert lines[1][0].startswith("Sensors: 11 at 200 Hz")
    for row in (
        ["I_xx", "380.00", "not determined", "kg m2"],
        ["not determined: I_xx, t_f"],
        ["- no roll"],
        ["- add: one roll run"],
        ["next step, each by itself", "worst", "mean", "not determined"],
        ["(as planned)", "2"],
    ):
        assert row in lines, row
    assert ["element", "expected", "95 % interval", "unit"] not in lines
    answer[0] = Advice(LOST, (), ())
    assert ["- no known step changes that"] in printed(capsys, *words, code=1)


def test_a_plan_as_a_document_has_every_number(
    answer: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["plan", "--json", "--bump-mm", "25"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["bump_mm"] == 25.0
    assert len(document["sensors"]) == 11
    assert document["runs"][0] == {
        "mass_state": "baseline", "excitation": "bounce", "repeats": 2,
    }  # fmt: skip
    assert document["parameters"]["m_s"]["relative_interval"] == 0.0055
    assert document["parameters"]["a"]["relative_interval"] is None
    (step,) = document["next_steps"]
    assert step == {
        "action": "weigh each axle to 1 kg", "worst_before": 0.0055, "worst": 0.004,
        "mean_before": 0.0025, "mean": 0.002, "undetermined": [],
    }  # fmt: skip
    (other,) = document["campaigns"]
    assert (other["worst"], other["mean"]) == (0.004, 0.002)
    assert document["dampers"][1]["force_n"] == 500.0
    assert document["elements"]["F_cf"]["std"] == 2.0


def test_the_terminals_outlook_is_that_of_the_weights_that_are_on_the_bench(
    answer: list[Any],
) -> None:
    gain = expected_gain(BENCH)
    assert (gain.worst, gain.mean, gain.widest) == (0.0055, 0.0025, "m_s")
    assert gain.remedies == ("weigh each axle to 1 kg",)
    assert [shift.mode for shift in gain.shifts] == ["bounce", "pitch", "roll"]
    assert all(shift.after_hz < shift.before_hz for shift in gain.shifts)
    assert gain.shifts[0].share == pytest.approx(
        gain.shifts[0].after_hz / gain.shifts[0].before_hz - 1.0
    )
    answer[0] = Advice(replace(LOST, relative={}), (BETTER,) * 3, ())
    gain = expected_gain(BENCH)
    assert (gain.worst, gain.mean, gain.widest) == (None, None, "")
    assert gain.undetermined == ("I_xx", "t_f")
    assert gain.reasons == ("no roll",)
    assert gain.remedies == ("weigh each axle to 1 kg",) * 2, "two steps at most"
    answer[0] = Advice(LOST, (BETTER,) * 3, ("one roll run",))
    assert expected_gain(BENCH).remedies == ("one roll run",)
    (first, *_) = answer[1:]
    assert first.bump.height_m == BENCH.campaign.bump_height_m


def test_a_bench_is_planned_as_it_will_be_recorded() -> None:
    vehicle = FORD_GRANADA.to_array()
    plan = planned(BENCH, vehicle, None, 0.03)
    assert plan.bump.height_m == 0.03
    assert plan.bump.duration_s == BENCH.campaign.bump_s
    assert plan.decay_s == pytest.approx(BENCH.trigger.post_s - BENCH.campaign.bump_s)
    assert [run.mass_state for run in plan.runs] == ["baseline"] * 3 + ["added"] * 3
    assert {run.repeats for run in plan.runs} == {2}
    short = replace(
        BENCH, trigger=BENCH.trigger.model_copy(update={"post_s": BENCH.campaign.bump_s + 0.1})
    )
    assert planned(short, vehicle, None, 0.03).decay_s == 0.2
    campaign = replace(
        BENCH.campaign, excitations=(Excitation.ROLL, Excitation.ROLL), mass_states=("baseline",)
    )
    twice = planned(replace(BENCH, campaign=campaign), vehicle, None, 0.03)
    assert [run.excitation for run in twice.runs] == [Excitation.ROLL]


def test_sensors_have_the_rate_that_is_named_or_that_of_the_dbc() -> None:
    rates = {sensor.channel.name: sensor.rate_hz for sensor in sensors(BENCH, None)}
    assert rates["body_acc_z"] == 500.0
    assert rates["hub_acc_fl"] == 1000.0
    assert {sensor.rate_hz for sensor in sensors(BENCH, 250.0)} == {250.0}
    text = BENCH.dbc_text.replace('BA_ "GenMsgCycleTime"', 'BA_ "GenMsgOther"')
    silent = replace(BENCH, dbc_text=text)
    unstated = {sensor.rate_hz for sensor in sensors(silent, None)}
    assert unstated in ({200.0}, set(rates.values()))
    assert Path(BENCH.dbc_name).name
