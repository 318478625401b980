"""Identifications, comparisons and session files as tables on stdout, row by row."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from dbc.words import Severity
from identify import Estimate, Identification
from identify.change import Change
from identify.compare import Compared, Comparison, Difference, Trend
from tui.cli import run
from tui.jobs import reporting
from tui.result import print_comparison, print_identification

from ..identify.results import result

Printed = Callable[..., list[list[str]]]


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str]) -> Printed:
    """Call something that prints, and return the cells of each line."""

    def cells(print_it: Callable[..., None], *arguments: Any) -> list[list[str]]:
        print_it(*arguments)
        return [re.split(r"\s{2,}", line.strip()) for line in capsys.readouterr().out.splitlines()]

    return cells


def judged() -> Identification:
    """Return a result with findings of every severity and a remark on its forces."""
    made = result()
    findings = tuple(
        replace(finding, severity=severity)
        for finding, severity in zip(
            made.quality.findings,
            (Severity.WARNING, Severity.WARNING, Severity.NOTE, Severity.ERROR),
            strict=True,
        )
    )
    assert made.forces is not None
    front, rear = made.forces.axles
    forces = replace(made.forces, axles=(replace(front, notes=("knees: none seen",)), rear))
    return replace(made, quality=replace(made.quality, findings=findings), forces=forces)


def test_an_identification_is_printed_with_intervals_and_what_they_rest_on(
    printed: Printed,
) -> None:
    lines = printed(print_identification, judged(), {})
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
        ["verdict: refused", "chi2/n 1.062"],
        ["- doubt: reason 0"],
        ["- note: reason 2"],
        ["- refused: reason 3"],
        ["- usable all the same, moved by no cause that was sized: m_s, a"],
    ):
        assert row in lines, row
    titles = [row[0] for row in lines]
    assert titles.index("Parameters") < titles.index("Derived") < titles.index("Motion ratios")
    assert titles.index("Motion ratios") < titles.index("Modes (frequency, damping ratio)")


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


def test_a_comparison_of_three_is_stated_with_its_trends(printed: Printed) -> None:
    lines = printed(print_comparison, comparison(3))
    for row in (
        ["1", "one: ok"],
        ["2", "two: doubtful"],
        ["Where a verdict is not ok, neither intervals nor significances hold."],
        ["Each by itself, at 95 % among all 2 quantities, these differ: m_s."],
        ["Parameters"],
        ["quantity", "1", "2", "2 minus 1", "z"],
        ["m_s, kg", "50.0", "52.0", "+4.0 ± 2.4 %", "+2.50"],
        ["quantity", "1", "3", "3 minus 1", "z"],
        ["m_s, kg", "50.0", "54.0", "+8.0 ± 2.4 %", "+2.50"],
        ["quantity", "per session", "chi2 / n", "at 95 %"],
        ["m_s, kg", "+2.00 ± 0.49", "12.5 / 2", "drifts varies"],
        ["Not compared, not determined in a session: t_f."],
        ["Errors of the sessions are taken as independent; 1 facts or weights are the same."],
    ):
        assert row in lines, row
    assert not any(row[0].startswith(("Forces", "Modes", "mode")) for row in lines)


def test_a_comparison_says_once_whether_anything_differs(printed: Printed) -> None:
    """Headline and table agree, also where a quantity differs that the joint fit does not name."""
    nothing = Change("nothing")
    text = " ".join(row[0] for row in printed(print_comparison, comparison(2, change=nothing)))
    assert "Nothing differs" not in text
    assert "names no change. Each by itself" in text
    assert "these differ: m_s." in text
    alike = (compared("m_s", (50.0, 52.0), False, False),)
    lines = printed(print_comparison, comparison(2, change=nothing, parameters=alike))
    assert lines[4][0].startswith("Nothing differs beyond chance")
    assert len(lines) <= 10
    assert not any("differ:" in row[0] for row in lines)


@pytest.mark.parametrize(
    ("paths", "labels"),
    [
        (["one.h5", "day/two.h5"], ["one", "two"]),
        (["mon/car.h5", "tue/car.h5"], ["mon/car", "tue/car"]),
        (["a/mon/car.h5", "b/mon/car.h5"], ["a/mon/car.h5", "b/mon/car.h5"]),
        (["mon/car.h5", "mon/car.h5"], ["mon/car.h5", "mon/car.h5"]),
    ],
)
def test_sessions_are_named_as_shortly_as_tells_them_apart(
    paths: list[str],
    labels: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given: list[Any] = []

    def compare(names: list[str], results: list[Any]) -> Any:
        given.extend((names, results))
        return comparison(2)

    monkeypatch.setattr("identify.compare.compare", compare)
    monkeypatch.setattr(reporting, "identified", lambda files, _: files)
    assert run(["compare", *paths, "--json"]) == 0
    assert given == [labels, paths]
    assert json.loads(capsys.readouterr().out)["verdicts"] == ["ok", "doubtful"]


def test_a_comparison_with_a_session_that_is_refused_is_exit_1(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = comparison(2, verdicts=("ok", "refused"))
    monkeypatch.setattr("identify.compare.compare", lambda *_: made)
    monkeypatch.setattr(reporting, "identified", lambda *_: [])
    assert run(["compare", "a.h5", "b.h5"]) == 1
