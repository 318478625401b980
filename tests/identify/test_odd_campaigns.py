"""Whatever is wrong with a campaign, an identification ends soon, with a verdict or one line."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from daq.session import write_session
from identify import identify_parameters
from identify.trust.finding import Verdict
from tui import cli

from ..simulated.fleet_study import FleetCase, identified_car
from ..simulated.other_laws import SEED, identified_other
from .odd_campaigns import FAULTS
from .stress import stress_session

_LIKE_ANOTHER = (
    "a weight at half its mass", "a weight on the other side", "a weight before the car",
    "a hub's weight ten times heavier", "a hub's weight on another hub", "hubs 5 ms late",
    "hubs of two corners swapped", "values of 1e300", "times begin at -10 s", "hubs only",
    "no noise", "a travel upside down", "pitch runs only", "a second bump in one run",
    "travels drift by 1 mm/s", "one infinite value", "scales in lb", "a weight on the other axle",
)  # fmt: skip
"""Found by the same rule as another one, here or in the list of stresses."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.long] if name in _LIKE_ANOTHER else [])
        for name in FAULTS
    ],
)
def test_a_fault_of_the_bench_is_named(name: str) -> None:
    fault = FAULTS[name]
    quality = identify_parameters(fault.session()).quality
    assert quality.verdict == fault.verdict
    said = quality.reasons[0] if fault.first else "\n".join(quality.reasons)
    for words in fault.words:
        assert words in said


def test_a_refusal_ends_the_command_with_its_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "odd.h5"
    write_session(path, FAULTS["a hub silent for 0.2 s"].session())
    assert cli.run(["identify", str(path)]) == 0
    printed = capsys.readouterr()
    assert "az in baseline_bounce_1" not in printed.out  # the hub alone is silent
    assert "stated with ± 0 kg or ± 0 m" in printed.out
    write_session(path, FAULTS["times in ms"].session())
    assert cli.run(["identify", str(path)]) == 1
    printed = capsys.readouterr()
    assert "are the times in ms?" in printed.out
    assert printed.err == ""


def test_a_mistyped_weight_of_a_car_with_friction_is_named_without_a_long_search() -> None:
    session = stress_session("friction", 1, repeats=1)
    baseline, added = session.mass_states
    weights = list(added.added.weights)
    weights[0] = replace(weights[0], mass_kg=10.0 * weights[0].mass_kg)
    wrong = replace(added, added=replace(added.added, weights=tuple(weights)))
    result = identify_parameters(replace(session, mass_states=(baseline, wrong)))
    assert result.quality.verdict is Verdict.REFUSED
    assert "likely cause: an added weight is wrong" in result.quality.reasons[0]
    assert "weight 1 " in result.quality.reasons[0]


@pytest.mark.long
@pytest.mark.parametrize(
    ("identified", "number", "seed"),
    [(identified_car, 1, 1), (identified_car, 3, 1), (identified_other, 39, SEED)],
)
def test_right_weights_of_a_car_with_stops_and_friction_are_not_called_mistyped(
    identified: Callable[[int, int], FleetCase], number: int, seed: int
) -> None:
    """Another mass explains half of the first one's surplus; that of the third is 7 %."""
    car = identified(number, seed)
    assert car.verdict != "refused"
    assert car.worst_percent < 3.0


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


def test_sigterm_ends_a_command_as_a_shell_reports_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli, "run", lambda _: signal.raise_signal(signal.SIGTERM))
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 143
