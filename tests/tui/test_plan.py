"""`bumpbench plan`: its document, its tables, and what it refuses."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import daq
from daq.bench.config import default_bench_text, load_bench
from daq.runs import Excitation
from daq.vehicle import DOF, FORD_GRANADA, PARAMETER_NAMES
from dbc import shipped_dbc
from identify import Estimate, Identification, Judgement
from identify.model.matrices import physical_model
from identify.model.response import Bump, exact_response
from identify.nonlinear.forces import AxleForces, DamperCurve, ElementChoice, Forces
from identify.plan.design import Plan
from identify.plan.outlook import Advice, NextStep, Outlook
from tui.cli import run
from tui.commands.plan import expected_vehicle, planned

from .conftest import answered

PAPER_MASS = np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0])


def _plan(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    document, err = answered(capsys, "plan", *arguments)
    assert err == ""
    return document


def _bench(tmp_path: Path, old: str, new: str) -> str:
    text = default_bench_text()
    assert old in text
    path = tmp_path / "bench.toml"
    path.write_text(text.replace(old, new))
    return str(path)


@pytest.fixture(scope="module")
def few_campaigns() -> Iterator[None]:
    """Leave out the comparison with other campaigns, which takes most of the time of a plan."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("identify.plan.outlook.compare_campaigns", lambda *_, **__: ())
        yield


def test_the_shipped_bench(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "as a typical car" in out
    assert "500 .. 1000 Hz" in out
    assert re.search(r"^m_s +1,380.0 +± \d\.\d+ +0\.\d\d % +kg$", out, re.MULTILINE)
    assert "weigh each axle" in out
    assert "not determined:" not in out


@pytest.mark.usefixtures("few_campaigns")
def test_rate_height_facts_and_structure(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    plain = _plan(capsys, "--rate-hz", "200")
    assert {s["rate_hz"] for s in plain["sensors"]} == {200.0}
    assert len(plain["parameters"]) == 15
    assert 0.0 < plain["mean"] <= plain["worst"] < 0.025
    assert 1 <= len(plain["next_steps"]) <= 12
    assert all(step["worst_before"] == plain["worst"] for step in plain["next_steps"])
    low = _plan(capsys, "--rate-hz", "200", "--bump-mm", "10")
    # Noise counts five times as much; less where gains, places and delays count as well.
    ratio = {n: low["parameters"][n]["std"] / e["std"] for n, e in plain["parameters"].items()}
    assert 4.0 < ratio["k_tf"] <= 5.001
    assert 1.0 < min(ratio.values()) <= max(ratio.values()) <= 5.001
    assert "bump" not in " ".join(step["action"] for step in plain["next_steps"])
    bench = _bench(tmp_path, "bump_height_mm = 50.0", "bump_height_mm = 40.0")
    lower = _plan(capsys, "--rate-hz", "200", bench)
    advised = [step["action"] for step in lower["next_steps"] if "bump" in step["action"]]
    assert advised == ["a bump of 50 mm instead of 40 mm"]
    facts = "".join(
        f'[[fact]]\nquantity = "{axle}_axle_kg"\nvalue = 800.0\nsigma = 1.0\n'
        for axle in ("front", "rear")
    )
    weighed = _bench(tmp_path, "[campaign]", facts + "[campaign]")
    better = _plan(capsys, weighed, "--rate-hz", "200")
    assert better["parameters"]["m_s"]["std"] < 0.3 * plain["parameters"]["m_s"]["std"]
    assert better["mean"] < 0.7 * plain["mean"]
    assert not any("weigh" in step["action"].split() for step in better["next_steps"])
    structure = "[vehicle.structure]\nsymmetric = false\nanti_roll_bars = true\n"
    free = _bench(tmp_path, "[campaign]", structure + "[campaign]")
    document = _plan(capsys, free, "--rate-hz", "200")
    assert {"k_sfl", "k_srr", "k_af"} <= set(document["parameters"])
    assert document["parameters"]["k_af"]["relative_interval"] is None


def _session(tmp_path: Path, cases: tuple[Excitation, ...]) -> str:
    """Write a session of a car that is a tenth heavier than the typical one."""
    heavy = physical_model(replace(FORD_GRANADA, m_s=1.1 * FORD_GRANADA.m_s))
    rng = np.random.default_rng(1)
    runs = []
    for state, model in (("baseline", heavy), ("added", heavy.with_mass(PAPER_MASS))):
        for case in cases:
            motion = exact_response(model, case, Bump(), 200.0, 2.0)
            columns = motion.acceleration + 0.02 * rng.standard_normal(motion.acceleration.shape)
            samples = {n: (motion.time_s, c) for n, c in zip(DOF, columns.T, strict=True)}
            runs.append((state, case.value, samples))
    path = tmp_path / "car.h5"
    session = daq.session_from_arrays(runs, delta_mass=PAPER_MASS, bump_s=0.2)
    bench = default_bench_text().replace("repeats = 2", "repeats = 5")
    own = {"bench_toml": bench, "dbc": shipped_dbc()}
    daq.write_session(path, replace(session, provenance={**session.provenance, **own}))
    return str(path)


@pytest.mark.usefixtures("few_campaigns")
def test_the_vehicle_of_a_session(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    cases = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
    path = _session(tmp_path, cases)
    document = _plan(capsys, path, "--rate", "200")  # a session that is named alone
    assert "car.h5" in document["vehicle"]
    assert document["parameters"]["m_s"]["value"] == pytest.approx(1.1 * 1380.0, rel=0.03)
    assert {r["repeats"] for r in document["runs"]} == {5}  # the session's own bench.toml


def test_a_session_without_a_vehicle_gives_the_typical_car(tmp_path: Path) -> None:
    path = Path(_session(tmp_path, (Excitation.PITCH,)))
    vehicle, whose = expected_vehicle(path, daq.read_session(path))
    assert vehicle[0] == 1380.0
    assert whose.startswith("the Ford Granada")
    assert "car.h5" in whose


def test_a_car_with_friction_is_planned_as_a_linear_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    speed = np.linspace(-0.4, 0.4, 41)
    curve = DamperCurve(speed, 1500.0 * speed, np.ones(41), 1500.0 * speed, np.ones(41))
    friction = {"friction": Estimate(35.0, 1.0, 33.0, 37.0, "N")}
    axles = (AxleForces("front", curve, friction, ()), AxleForces("rear", curve, friction, ()))
    forces = Forces(axles, (ElementChoice("friction", 99.0, 9.0, True, False, {}),))
    known = {
        name: Estimate(value, 0.01 * value, 0.98 * value, 1.02 * value, "")
        for name, value in zip(PARAMETER_NAMES, FORD_GRANADA.to_array(), strict=True)
    }
    answer = Identification(Judgement((), 1.0), {}, parameters=known, forces=forces)
    monkeypatch.setattr("identify.identify", lambda _: answer)
    held = daq.session_from_arrays([])
    vehicle, whose = expected_vehicle(tmp_path / "car.h5", held)
    assert vehicle[0] == 1380.0
    assert whose.startswith("the vehicle identified from")
    assert whose.endswith("without its friction and its damper curves")


# What the planner's answer looks like: on stdout, as a document, and as ---------------------------


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
)
LOST = replace(
    KNOWN,
    parameters={**KNOWN.parameters, "I_xx": Estimate(380.0, inf, -inf, inf, "kg m2")},
    undetermined=("I_xx", "t_f"),
    reasons=("no roll",),
    worst=inf,
    mean=inf,
)
BETTER = NextStep("weigh each axle to 1 kg", replace(KNOWN, worst=0.004, mean=0.002))


@pytest.fixture
def answer(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return what the planner was asked; its answer is the element that a test puts first."""
    asked: list[Any] = [Advice(KNOWN, (BETTER,), ())]

    def advise(plan: Plan, *_: object, **__: object) -> Any:
        asked.append(plan)
        return asked[0]

    monkeypatch.setattr("identify.plan.outlook.advise", advise)
    monkeypatch.setattr("identify.plan.outlook.compare_campaigns", lambda *_, **__: (BETTER,))
    return asked


def printed(capsys: pytest.CaptureFixture[str], *words: str, code: int) -> list[list[str]]:
    assert run(["plan", *words]) == code
    lines = capsys.readouterr().out.splitlines()
    return [re.split(r"\s{2,}", line.strip()) for line in lines]


def test_a_plan_is_printed_with_its_steps_and_other_campaigns(
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
    words = ["--rate-hz", "200", "--bump-mm", "25"]
    lines = printed(capsys, *words, code=1)
    assert lines[1][0].startswith("Sensors: 11 at 200 Hz")
    for row in (
        ["I_xx", "380.00", "not determined", "kg m2"],
        ["not determined: I_xx, t_f"],
        ["- no roll"],
        ["- add: one roll run"],
        ["(as planned)", "2 not determined"],
    ):
        assert row in lines, row
    answer[0] = Advice(LOST, (), ())
    assert ["- no known step changes that"] in printed(capsys, *words, code=1)


def test_a_plan_as_a_document_has_every_number(
    answer: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    document = _plan(capsys, "--bump-mm", "25")
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
    def rates(rate_hz: float | None) -> dict[str, float]:
        plan = planned(BENCH, FORD_GRANADA.to_array(), rate_hz, 0.05)
        return {sensor.channel.name: sensor.rate_hz for sensor in plan.sensors}

    assert rates(None)["body_acc_z"] == 500.0
    assert rates(None)["hub_acc_fl"] == 1000.0
    assert set(rates(250.0).values()) == {250.0}
