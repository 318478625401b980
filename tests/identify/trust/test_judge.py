"""How the gates make one judgement: what a named cause explains, and which causes compete."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dbc.finding import Finding, Severity
from identify.trust import judge as gates
from identify.trust.cause_texts import Causes
from identify.trust.finding import Judgement, Verdict
from identify.trust.refit import Explanation
from identify.trust.survival import Survival

NONE = (
    *("misfit_findings", "scale_findings", "gain_findings", "sampling_findings"),
    "saturation_findings",
    *("excitation_findings", "whiteness_findings", "lift_off_findings"),
)


def warned(code: str) -> Finding:
    return Finding(code, Severity.WARNING, code)


def estimation(holds: bool) -> Any:
    box = SimpleNamespace(parameters=("m_s", "k_sf"))
    return SimpleNamespace(box=box, nonlinear=None, holds=holds, chi2_per_n=3.0, records=())


def judged(
    monkeypatch: pytest.MonkeyPatch,
    holds: bool,
    causes: tuple[str, ...],
    undetermined: tuple[str, ...] = (),
) -> tuple[list[str], list[str]]:
    """Return the codes of all findings, and the names of the hypotheses that compete.

    Some interval is wide and stated values contradict the runs.
    """
    competing: list[str] = []

    def survival(_: Any, hypotheses: Any) -> Survival:
        competing.extend(one.cause for one in hypotheses)
        return Survival()

    for name in NONE:
        monkeypatch.setattr(gates, name, lambda *_: ())
    monkeypatch.setattr(gates, "undetermined", lambda _: undetermined)
    monkeypatch.setattr(gates, "mode_snr_db", lambda _: {})
    monkeypatch.setattr(gates, "chi2_by_run", lambda _: {})
    monkeypatch.setattr(gates, "survival", survival)
    found = tuple(map(warned, causes))
    monkeypatch.setattr(gates, "_causes", lambda _: Causes(found))
    both = (warned("contradiction"), warned("wide"))
    monkeypatch.setattr(gates, "parameter_findings", lambda _: both)
    monkeypatch.setattr(gates, "contradictions", lambda _: [SimpleNamespace(name="k_sf")])
    monkeypatch.setattr(gates, "contradicted_shift", lambda *_: np.zeros(2))
    session: Any = None
    quality = gates.judge(session, estimation(holds))
    return sorted(finding.code for finding in quality.findings), competing


def test_where_a_parameter_is_undetermined_nothing_competes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    codes, competing = judged(monkeypatch, True, (), ("I_xx",))
    assert (codes, competing) == (["contradiction", "wide"], [])


def test_an_odd_run_explains_what_goes_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """chi2/n is 3 with the run and 1.5 without it: three quarters of the excess."""
    odd = Finding("odd_run", Severity.ERROR, "odd", "added_roll_2", value=1.5)
    ranked = [SimpleNamespace(strength=strength) for strength in (3.0, 1.0, 0.5)]
    rivals = []

    def repeats(_: Any, rival: float) -> tuple[Finding, ...]:
        rivals.append(rival)
        return (odd,)

    monkeypatch.setattr(gates, "rank_causes", lambda _: ranked)
    monkeypatch.setattr(gates, "repeat_findings", repeats)
    monkeypatch.setattr(gates, "moves_without", lambda *_: {"m_s": 0.1, "k_sf": -0.2})
    causes = gates._causes(estimation(False))
    assert causes.findings == (odd,)
    assert rivals == [3.0]  # the likeliest cause that all runs share
    moved = {"m_s": 0.1, "k_sf": -0.2}
    assert causes.tried == (Explanation("run added_roll_2", "", "", 0.75, 0.2, "k_sf", moved),)


def test_nothing_was_found_where_nothing_was_asked() -> None:
    quality = Judgement((), 1.0)
    assert quality.verdict is Verdict.OK
    assert (quality.survival.surviving, dict(quality.survival.lost)) == ((), {})


@pytest.mark.parametrize(
    ("causes", "reported"),
    [
        (("tyre_damping",), ["tyre_damping"]),  # what explains the misfit explains the motion
        ((), ["amplitude"]),
        (("friction_in_the_suspension",), ["friction_in_the_suspension", "amplitude"]),
    ],
)
def test_small_motion_is_reported_where_nothing_linear_explains_it(
    monkeypatch: pytest.MonkeyPatch, causes: tuple[str, ...], reported: list[str]
) -> None:
    monkeypatch.setattr(gates, "rank_causes", lambda _: [SimpleNamespace(strength=1.0)])
    monkeypatch.setattr(gates, "repeat_findings", lambda *_: (warned("amplitude"),))
    tried = (Explanation("bars", "", "", 0.5, 0.1, "k_sf", {}),)
    monkeypatch.setattr(gates, "causes_of", lambda *_: Causes(tuple(map(warned, causes)), tried))
    found = gates._causes(estimation(False))
    assert [finding.code for finding in found.findings] == reported
    assert found.tried == tried


def test_all_sized_causes_compete_where_the_model_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a misfit none explains more of it than another."""
    tried = (Explanation("bars", "", "", 0.6, 0.1, "k_sf", {"k_sf": 0.1}),)
    for holds, explained in ((False, 0.6), (True, np.inf)):
        (one,) = gates._hypotheses(estimation(holds), Causes((), tried), False)
        assert (one.cause, one.explained, one.moved) == ("bars", explained, {"k_sf": 0.1})
