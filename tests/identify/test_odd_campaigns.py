"""Whatever is wrong with a campaign, `bumpbench identify` ends soon, with a verdict or one line."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.session import write_session
from daq.sessions import session_from_arrays
from daq.vehicle import BodyWeight, Corner, Fact, HubWeight, Vehicle
from identify import identify_parameters
from identify.trust.finding import Verdict
from tui import cli

from .odd_campaigns import BUMP_S, WEIGHTS, Array, Records, campaign, channels
from .stress import stress_session

CPU_S = 10.0
"""Longest time for any of these, s."""
CENTRED: tuple[BodyWeight | HubWeight, ...] = tuple(
    replace(w, y_m=0.0) if isinstance(w, BodyWeight) else w for w in WEIGHTS
)
Change = Callable[[str, Array, Array], tuple[Array, Array]]


def _each(change: Change, names: str = "") -> Callable[[], Records]:
    """Return a campaign in which the samples of the channels that begin so are changed."""
    return lambda: [
        (state, kind, {n: change(n, *tv) if n.startswith(names) else tv for n, tv in run.items()})
        for state, kind, run in campaign()
    ]


def _times(factor: float) -> Callable[[], Records]:
    return _each(lambda _, t_s, values: (t_s * factor, values))


def _scaled(factor: float, names: str = "") -> Callable[[], Records]:
    return _each(lambda _, t_s, values: (t_s, values * factor), names)


def _coarse(step: float, names: str = "") -> Callable[[], Records]:
    return _each(lambda _, t_s, values: (t_s, np.round(values / step) * step), names)


def _with_one(value: float, names: str) -> Callable[[], Records]:
    def change(_: str, t_s: Array, values: Array) -> tuple[Array, Array]:
        return t_s, np.where(np.arange(len(t_s)) == 250, value, values)

    return _each(change, names)


def _silent_roll(*kinds: str) -> Callable[[], Records]:
    """Return the runs of a symmetric car without roll runs, a roll rate of rounding errors."""

    def rounding(name: str, t_s: Array, values: Array) -> tuple[Array, Array]:
        return t_s, 1e-17 * values / np.std(values)

    return lambda: [
        (state, kind, {**run, "wx": rounding("wx", *run["wx"])})
        for state, kind, run in campaign(kinds, weights=CENTRED)
    ]


def _without(*names: str) -> Callable[[], Records]:
    return lambda: [
        (state, kind, {n: tv for n, tv in run.items() if not n.startswith(names)})
        for state, kind, run in campaign()
    ]


def _drifting(per_s: float, names: str) -> Callable[[], Records]:
    return _each(lambda _, t_s, values: (t_s, values + per_s * t_s), names)


def _struck_twice(share: float) -> Callable[[], Records]:
    """Return runs with a second bump a second after the first, so much as high."""

    def again(_: str, t_s: Array, values: Array) -> tuple[Array, Array]:
        later = np.interp(t_s - 1.0, t_s, values - values[0], left=0.0)
        return t_s, values + share * later

    return _each(again)


ROWS: dict[str, tuple[Callable[[], Records], int, tuple[str, ...]]] = {
    "nothing": (campaign, 0, ("verdict: ok",)),
    "no roll run": (_silent_roll("bounce", "pitch"), 1, ("I_xx, t_f, t_r: record roll runs",)),
    "one channel": (_without("w", "hub", "tr"), 1, ("one channel only (az)",)),
    "hubs only": (_without("az", "w", "tr"), 1, ("do not determine",)),
    "ms": (_times(1e3), 1, ("0.2 Hz", "are the times in ms?")),
    "minutes": (_times(1 / 60), 1, ("0.04 s after the bump",)),
    "negative times": (_each(lambda _, t, v: (t - 10.0, v)), 0, ("verdict: ok",)),
    "all NaN": (_scaled(np.nan), 1, ("no accepted run has a sample",)),
    "all constant": (_scaled(0.0), 1, ("never moves in any run: az",)),
    "one infinite": (_with_one(np.inf, "wy"), 0, ("values that no sensor shows: wy",)),
    "all of 1e300": (_scaled(1e300), 1, ("values that no sensor shows: az",)),
    "travels drift": (_drifting(1e-3, "tr"), 1, ("likely cause: drift (trFL +0.0",)),
    "a gyro drifts": (_drifting(0.01, "wy"), 1, ("likely cause: drift (wy +0.0",)),
    "a slow drift": (_drifting(1e-5, "tr"), 0, ("verdict: ok",)),
    "second bumps": (_struck_twice(0.7), 1, ("likely cause: a second bump (in 6 of 6 runs",)),
    "no roll sensor": (_without("wx", "tr"), 1, ("do not determine I_xx, t_f, t_r",)),
    "no noise": (lambda: campaign(noise=0.0), 0, ("verdict: ok",)),
    "much noise": (lambda: campaign(noise=1000.0), 1, ("nothing moves in it",)),
    "steps of 1": (_coarse(1.0), 1, ("coarse sensors", "hubFL (1 m/s2)")),
    "coarse accelerometers": (_coarse(0.5, "hub"), 0, ("hubFL (0.5 m/s2)", "step/sqrt(12)")),
}
"""What is wrong; the campaign, the exit code, and words of the answer."""


@pytest.mark.parametrize("name", ROWS)
def test_an_odd_campaign_ends_with_an_answer_that_names_it(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, code, words = ROWS[name]
    weights = CENTRED if "roll run" in name else WEIGHTS
    path = tmp_path / "odd.h5"
    write_session(path, session_from_arrays(made(), channels(), weights, bump_s=BUMP_S))
    before_s = time.process_time()
    assert cli.run(["identify", str(path)]) == code
    assert time.process_time() - before_s < CPU_S
    printed = capsys.readouterr()
    assert "Traceback" not in printed.err
    for word in words:
        assert word in printed.out


WRONG: dict[str, tuple[int, BodyWeight | HubWeight, bool]] = {
    "ten times": (0, BodyWeight(250.0, 0.1, 0.45), True),
    "half": (2, BodyWeight(15.0, -2.2, 0.4), False),
    "ahead": (2, BodyWeight(30.0, 2.2, 0.4), True),
    "other side": (0, BodyWeight(25.0, 0.1, -0.45), False),
    "other axle": (0, BodyWeight(25.0, -2.2, 0.45), True),
    "hub": (6, HubWeight(25.0, Corner.REAR_LEFT), False),
    "other hub": (6, HubWeight(2.5, Corner.FRONT_LEFT), False),
}
"""What is wrong; the number of the weight, what is stated, and whether travels were recorded."""


@pytest.mark.parametrize("name", WRONG)
def test_a_grossly_wrong_weight_is_the_first_cause(name: str) -> None:
    number, stated, travels = WRONG[name]
    weights = list(WEIGHTS)
    weights[number] = stated
    runs = campaign() if travels else _without("tr")()
    before_s = time.process_time()
    result = identify_parameters(session_from_arrays(runs, channels(), weights, bump_s=BUMP_S))
    assert time.process_time() - before_s < CPU_S
    assert result.quality.verdict is Verdict.REFUSED
    assert f"weight {number + 1} " in result.quality.reasons[0]


def test_a_mistyped_weight_of_a_car_with_friction_is_named_without_a_long_search() -> None:
    session = stress_session("friction", 1, repeats=1)
    baseline, added = session.mass_states
    weights = list(added.added.weights)
    weights[0] = replace(weights[0], mass_kg=10.0 * weights[0].mass_kg)
    wrong = replace(added, added=replace(added.added, weights=tuple(weights)))
    before_s = time.process_time()
    result = identify_parameters(replace(session, mass_states=(baseline, wrong)))
    assert time.process_time() - before_s < CPU_S
    assert result.quality.verdict is Verdict.REFUSED
    assert "likely cause: an added weight is wrong" in result.quality.reasons[0]
    assert "weight 1 " in result.quality.reasons[0]


def test_runs_with_other_weights_than_stated_are_named() -> None:
    heavy = tuple(replace(w, mass_kg=2.0 * w.mass_kg) for w in WEIGHTS)
    runs = [*campaign(), *campaign(states=["added"], weights=heavy, seed=2)]
    before_s = time.process_time()
    result = identify_parameters(session_from_arrays(runs, channels(), WEIGHTS, bump_s=BUMP_S))
    assert time.process_time() - before_s < CPU_S
    assert result.quality.verdict is Verdict.REFUSED
    assert "runs added_bounce_2, added_pitch_2, added_roll_2 disagree" in result.quality.reasons[0]


def test_scales_in_pounds_are_named() -> None:
    facts = (
        Fact("total_mass_kg", 826.0 / 0.45359, 2.0),
        Fact("front_axle_kg", 467.0 / 0.45359, 2.0),
    )
    session = session_from_arrays(
        campaign(), channels(), WEIGHTS, Vehicle("x", facts=facts), bump_s=BUMP_S
    )
    before_s = time.process_time()
    quality = identify_parameters(session).quality
    assert time.process_time() - before_s < CPU_S
    assert quality.verdict is Verdict.REFUSED
    assert "likely cause: scales in lb" in quality.reasons[0]


def test_travels_in_mm_are_named_before_any_fit() -> None:
    runs = _scaled(1e3, "tr")()
    result = identify_parameters(session_from_arrays(runs, channels(), WEIGHTS, bump_s=BUMP_S))
    assert result.quality.verdict is Verdict.REFUSED
    assert "trFL, trFR, trRL and 1 more change by up to" in result.quality.reasons[0]
    assert "are they in mm?" in result.quality.reasons[0]


def test_a_channel_without_numbers_for_a_while_is_named_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def silent(_: str, t_s: Array, values: Array) -> tuple[Array, Array]:
        return t_s, np.where((t_s >= 0.7) & (t_s < 0.9), np.nan, values)

    path = tmp_path / "gap.h5"
    runs = _each(silent, "hubFL")()
    write_session(path, session_from_arrays(runs, channels(), WEIGHTS, bump_s=BUMP_S))
    cli.run(["identify", str(path)])
    printed = capsys.readouterr().out
    assert "hubFL in baseline_bounce_1" in printed
    assert "az in baseline_bounce_1" not in printed
    assert "stated with ± 0 kg or ± 0 m" in printed


def test_a_fault_of_the_program_is_no_refusal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: list[str]) -> int:
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr(cli, "run", fail)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 70
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("bumpbench: error: ZeroDivisionError: a fault of bumpbench")
