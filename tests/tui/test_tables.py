"""Identifications, comparisons and session files as tables on stdout, row by row."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq import Quantity, RunStatus, Session, VehicleGeometry, session_from_arrays
from daq.channels import Channel
from daq.runs import Losses
from daq.vehicle import (
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    HubWeight,
    MassState,
    Structure,
    Vehicle,
)
from identify import Estimate
from identify.compare import Compared, Comparison, Difference, Trend
from identify.document import Document, EstimateEntry, ModeEntry
from tui.contents import print_contents
from tui.jobs.comparing import print_comparison
from tui.jobs.comparison_rows import comparison_lines
from tui.recorders.recording import print_summary
from tui.result import print_identification

from ..identify.test_documents_by_hand import result

Printed = Callable[..., list[list[str]]]


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str]) -> Printed:
    """Call something that prints, and return the cells of each line."""

    def cells(print_it: Callable[..., None], *arguments: Any) -> list[list[str]]:
        print_it(*arguments)
        return [re.split(r"\s{2,}", line.strip()) for line in capsys.readouterr().out.splitlines()]

    return cells


def entry(value: float, half: float, unit: str, reason: str = "") -> EstimateEntry:
    return {
        "value": value, "std": half / 2, "low": value - half, "high": value + half,
        "unit": unit, "reason": reason,
    }  # fmt: skip


def mode(name: str, hz: float, ratio: float) -> ModeEntry:
    return {
        "name": name, "reason": "", "frequency_hz": hz, "frequency_std_hz": 0.01,
        "frequency_low_hz": hz - 0.02, "frequency_high_hz": hz + 0.02, "damping_ratio": ratio,
        "damping_ratio_std": 0.005, "damping_ratio_low": ratio - 0.011,
        "damping_ratio_high": ratio + 0.011,
    }  # fmt: skip


def document() -> Document:
    made: Document = result().document()
    made["derived"] = {"damping_ratio_heave": entry(0.25, 0.011, "1")}
    made["motion_ratios"] = {"travel_fl": entry(0.7, 0.013, "1")}
    made["drivers"] = {"m_s": {"baseline_bounce_1": 0.25, "baseline_bounce_2": 0.5, "wb": 0.25}}
    first = made["modes"]["baseline"]
    made["modes"] = {"baseline": [*first, mode("rear wheels", 11.0, 0.3)]}
    made["modes"]["added"] = [mode("front wheels", 9.5, 0.2), mode("body bounce", 1.1, 0.24)]
    made["paired"] = {
        "added": [{"first": 1, "this": 2, "mac": 0.9}, {"first": 2, "this": 1, "mac": 0.9}]
    }
    made["swapped"] = {"added": [[1, 2]]}
    forces = made["forces"]
    assert forces is not None
    forces["axles"]["front"]["notes"] = ["knees: none seen"]
    made["findings"][3]["severity"] = "refused"
    made["findings"][2]["severity"] = "ok"
    return made


def test_an_identification_is_printed_with_intervals_and_what_they_rest_on(
    printed: Printed,
) -> None:
    lines = printed(print_identification, document(), {})
    for row in (
        ["parameter", "estimate", "95 % interval", "±", "unit", "mostly from"],
        ["m_s", "1,380.0", "1,372.4 .. 1,387.6", "0.55 %", "kg", "baseline_bounce 75 %"],
        ["a", "1.2500", "given", "m"],
        ["t_f", "not determined", "m"],
        ["quantity", "estimate", "95 % interval", "±", "unit"],
        ["damping_ratio_heave", "0.250", "0.239 .. 0.261", "4.4 %"],
        ["channel", "estimate", "95 % interval", "±", "unit"],
        ["travel_fl", "0.700", "0.687 .. 0.713", "1.9 %"],
        ["baseline", "added"],
        ["1 body bounce", "1.200 Hz 25.0 %", "1.100 Hz 24.0 %"],
        ["2 front wheels", "not determined", "9.500 Hz 20.0 %"],
        ["3 rear wheels", "11.000 Hz 30.0 %"],
        ["Modes 1 and 2 change their order in state added."],
        ["element", "estimate", "95 % interval", "unit"],
        ["front bump stop", "50.0", "46.1 .. 53.9", "N"],
        ["m/s", "front", "front + friction", "rear", "rear + friction"],
        ["-0.10", "-100.0 ± 9.8", "-120 ± 20", "-100.0 ± 9.8", "-120 ± 20"],
        ["front knees: none seen"],
        ["elements there: friction"],
        ["elements not needed: bump stops"],
        ["verdict: doubtful", "chi2/n 1.062"],
        ["- doubt: reason 0"],
        ["- note: reason 2"],
        ["- refused: reason 3"],
        ["- usable: none"],
    ):
        assert row in lines, row
    titles = [row[0] for row in lines]
    assert titles.index("Parameters") < titles.index("Derived") < titles.index("Motion ratios")
    assert titles.index("Motion ratios") < titles.index("Modes (frequency, damping ratio)")


def test_a_known_truth_stands_beside_the_estimates(printed: Printed) -> None:
    truth = {"m_s": 1200.0, "a": 0.0, "y_s": 0.01, "t_f": 0.7}
    lines = printed(print_identification, document(), truth)
    for row in (
        ["parameter", "truth", "estimate", "95 % interval", "error", "unit"],
        ["m_s", "1,200.0", "1,380.0", "1,372.4 .. 1,387.6", "+15.00 %", "kg"],
        ["a", "0.0000", "1.2500", "given", "1.2500", "m"],
        ["t_f", "0.70000", "not determined", "m"],
        ["y_s", "0.010000", "-", "m"],
    ):
        assert row in lines, row
    titles = {row[0] for row in lines}
    assert "Derived" not in titles
    assert "Motion ratios" in titles


def compared(name: str, values: tuple[float, ...], significant: bool, slope: bool) -> Compared:
    """Return one quantity of standard deviation 0.5; a difference has 0.625."""
    first, *others = values
    return Compared(
        name,
        tuple(Estimate(value, 0.5, value - 1.0, value + 1.0, "kg") for value in values),
        tuple(Difference(v - first, 0.625, 2.5, 0.01, significant) for v in others),
        Trend(2.0, 0.25, 0.001, 12.5, 2, 0.002, slope, significant) if len(values) > 2 else None,
    )


def comparison(sessions: int, **changed: Any) -> Comparison:
    values = (50.0, 52.0, 54.0)[:sessions]
    made = Comparison(
        ("one", "two", "three")[:sessions],
        ("ok", "doubtful", "ok")[:sessions],
        (compared("m_s", values, True, True),),
        (compared("mode 1 Hz", values, False, False),),
        (),
        ("wheelbase_m",),
        ("t_f",),
        (),
        None,
    )
    return replace(made, **changed)


def test_a_comparison_of_three_is_printed_with_its_trends(printed: Printed) -> None:
    lines = printed(print_comparison, comparison(3))
    for row in (
        ["Parameters: two minus one"],
        ["Modes: three minus one"],
        ["first", "this", "unit", "difference", "z", "at 95 %"],
        ["m_s", "50.0", "52.0", "kg", "+4.0 ± 2.4 %", "+2.50", "differs"],
        ["m_s", "50.0", "54.0", "kg", "+8.0 ± 2.4 %", "+2.50", "differs"],
        ["mode 1 Hz", "50.0", "52.0", "kg", "+4.0 ± 2.4 %", "+2.50"],
        ["per session", "unit", "chi2 / n", "at 95 %"],
        ["m_s", "+2.00 ± 0.49", "kg", "12.5 / 2", "drifts varies"],
        ["mode 1 Hz", "+2.00 ± 0.49", "kg", "12.5 / 2"],
        ["not compared, not determined in a session: t_f"],
        ["verdict of one: ok"],
        ["verdict of two: doubtful"],
        ["Where a verdict is not ok, neither intervals nor significances hold."],
    ):
        assert row in lines, row
    assert lines[-1][0].endswith("in common are wheelbase_m.")
    assert not any(row[0].startswith("Forces") for row in lines)


def test_a_comparison_says_in_one_line_what_is_stated_differently(printed: Printed) -> None:
    unlike = ("vehicle Golf in one; Polo in two", "place of acc (1, 0) m in one; (2, 0) m in two")
    line = f"stated differently (is it one car?): {unlike[0]}; {unlike[1]}"
    texts = [" ".join(row) for row in printed(print_comparison, comparison(2, unlike=unlike))]
    assert texts[0] == line
    lines = comparison_lines(comparison(2, unlike=unlike))
    assert line[1:] in " ".join(lines)


def session() -> Session:
    times = np.arange(500) / 100.0
    channels = (
        Channel("rear", Quantity.BODY_ACCELERATION, x_m=-2.5, y_m=0.25, position_sigma_m=0.005),
        Channel("middle", Quantity.BODY_ACCELERATION, signal="IMU.z", at_cg=True, sign=-1.0),
        Channel("tower", Quantity.BODY_ACCELERATION, x_m=0.5, gain=2.0, sign=-1.0, tare=0.25),
        Channel("hub", Quantity.HUB_ACCELERATION, corner=Corner("FR"), delay_s=0.004),
        Channel("roll", Quantity.ROLL_RATE, low_pass_hz=80.0, gain=-1.0, sign=-1.0),
        Channel("spare", Quantity.UNUSED, "V"),
    )
    data = {c.name: (times, np.sin(times)) for c in channels}
    made = session_from_arrays([("baseline", "roll", data)] * 2, channels)
    weights = (
        BodyWeight(60.0, -1.5, 0.5, position_sigma_m=0.01, sigma_kg=0.2),
        HubWeight(10.0, Corner("RL")),
        BodyWeight(20.0, 0.0, 0.0),
    )
    facts = (Fact("wheelbase_m", 2.76, 0.002),)
    return replace(
        made,
        runs=(made.runs[0], replace(made.runs[1], status=RunStatus.REJECTED, reasons=("late",))),
        vehicle=Vehicle(
            "Granada", VehicleGeometry(1.25, 1.51, 0.74, 0.75), Structure(cg_offset=True), facts
        ),
        mass_states=(
            MassState("baseline"),
            MassState("added", AddedMass(weights)),
            MassState("odd", AddedMass((), np.eye(7))),
        ),
        provenance={
            "uuid": "1", "dbc": "é\n", "verdicts": "[1]",
            "notes": '[{"by": "MK", "label": "r_1", "text": "wet"}]',
            "overrides": '[{"by": "MK", "subject": "noise", "reason": "lift"}]',
        },
    )  # fmt: skip


def test_the_contents_of_a_session_are_printed_cell_by_cell(printed: Printed) -> None:
    lines = printed(print_contents, Path("car.h5"), session())
    for row in (
        ["Granada: 2 runs"],
        ["session: car.h5"],
        ["channel", "quantity", "unit", "place", "signal", "sensor"],
        ["rear", "body_acceleration", "m/s2", "x -2.5 y 0.25 ± 0.005 m"],
        ["middle", "body_acceleration", "m/s2", "CG", "IMU.z", "times -1"],
        ["tower", "body_acceleration", "m/s2", "x 0.5 y 0 m", "times -2, tare 0.25"],
        ["hub", "hub_acceleration", "m/s2", "FR", "4 ms late"],
        ["roll", "roll_rate", "rad/s", "body", "low-pass 80 Hz"],
        ["spare", "unused", "V"],
        ["what", "value"],
        ["a", "1.25 m"],
        ["t_r", "0.75 m"],
        ["wheelbase_m", "2.76", "± 0.002"],
        ["model has", "symmetric"],
        ["model has", "cg_offset"],
        ["in added", "60 kg at x -1.5 y 0.5 m ± 0.01", "± 0.2"],
        ["in added", "10 kg at hub RL"],
        ["in added", "20 kg at x 0 y 0 m"],
        ["in odd", "a mass matrix"],
        ["uuid", "1"],
        ["dbc", "3 bytes"],
        ["verdicts", "findings of each run: --json shows them"],
        ["note", "r_1: wet (MK)"],
        ["warning overridden", "noise: lift (MK)"],
    ):
        assert row in lines, row
    assert ["model has", "anti_roll_bars"] not in lines
    assert ["in added", "a mass matrix"] not in lines
    assert not any(row[0] in ("notes", "overrides") for row in lines)


def test_runs_are_printed_with_length_frames_losses_and_reasons(printed: Printed) -> None:
    known = session()
    first, second = known.runs
    lossy = replace(first, losses=Losses(bus_dropped=2, crc_bad=3))
    lines = printed(print_summary, Path("car.h5"), replace(known, runs=(lossy, second)))
    assert lines[0] == [f"{known.vehicle.name}: 2 runs"]
    assert lines[1] == ["run", "status", "length s", "frames", "losses"]
    assert lines[2] == ["baseline_roll_1", "accepted", "5.0", "0", "2 bus_dropped, 3 crc_bad"]
    assert lines[3] == ["baseline_roll_2", "rejected", "5.0", "0", "none"]
    assert lines[4] == ["baseline_roll_2: late"]
    assert lines[-1] == ["session: car.h5"]
