"""Results on stdout are paragraphs, each with a blank line before it."""

from __future__ import annotations

from pathlib import Path

import pytest

from identify.plan import Advice, NextStep
from tui.cli import run
from tui.contents import print_contents
from tui.jobs.comparing import print_comparison
from tui.recorders.recording import print_summary
from tui.result import print_identification

from .test_plan_tables import BETTER, KNOWN, LOST
from .test_tables import comparison, document, session


def heads(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Return the first line of each paragraph; no two blank lines come together."""
    out = capsys.readouterr().out
    assert "\n\n\n" not in out
    assert not out.startswith("\n")
    return [paragraph.splitlines()[0].strip() for paragraph in out.split("\n\n") if paragraph]


def test_an_identification_has_a_paragraph_for_each_table(
    capsys: pytest.CaptureFixture[str],
) -> None:
    modes = [
        "Modes (frequency, damping ratio)",
        "Force elements, each of one corner",
        "Force of one corner, N, damper alone and with friction; compression positive",
        "verdict: doubtful   chi2/n 1.062",
    ]
    print_identification(document(), {})
    assert heads(capsys) == ["Parameters", "Derived", "Motion ratios", *modes]
    print_identification(document(), {"m_s": 1200.0})
    assert heads(capsys) == ["Parameters", "Motion ratios", *modes]
    bare = document()
    bare["forces"], bare["motion_ratios"] = None, {}
    print_identification(bare, {})
    assert heads(capsys) == ["Parameters", "Derived", modes[0], modes[-1]]


def test_a_comparison_has_one_for_each_pair_and_the_rest_at_the_end(
    capsys: pytest.CaptureFixture[str],
) -> None:
    print_comparison(comparison(3))
    assert heads(capsys) == [
        "Parameters: two minus one",
        "Modes: two minus one",
        "Parameters: three minus one",
        "Modes: three minus one",
        "Trend",
        "not compared, not determined in a session: t_f",
    ]
    print_comparison(comparison(2, open=()))
    assert heads(capsys)[-1] == "verdict of one: ok"


def test_the_contents_of_a_session_have_one_for_each_table(
    capsys: pytest.CaptureFixture[str],
) -> None:
    print_contents(Path("car.h5"), session())
    assert heads(capsys) == ["Granada: 2 runs", "Channels", "Known beforehand", "Provenance"]
    print_summary(Path("car.h5"), session())
    assert heads(capsys) == ["Granada: 2 runs"]


@pytest.mark.parametrize(
    ("advice", "code", "first"),
    [
        (Advice(KNOWN, (), ()), 0, ["Elements", "Damper curves, compression positive"]),
        (Advice(LOST, (), ()), 1, ["not determined: I_xx, t_f"]),
    ],
)
def test_a_plan_has_one_for_each_table(
    advice: Advice,
    code: int,
    first: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("identify.plan.advise", lambda *_: advice)
    others: tuple[NextStep, ...] = (BETTER,)
    monkeypatch.setattr("identify.plan.compare_campaigns", lambda *_: others)
    head = "Runs: 2 x baseline bounce"
    steps = "What would improve it (95 % intervals, share of the value)"
    campaigns = "Other campaigns with the same sensors"
    assert run(["plan"]) == code
    found = heads(capsys)
    assert found[0].startswith(head)
    assert found[1:] == ["Expected result of this campaign", *first, steps, campaigns]
    others = ()
    monkeypatch.setattr("identify.plan.compare_campaigns", lambda *_: others)
    assert run(["plan"]) == code
    assert heads(capsys)[-1] == steps
