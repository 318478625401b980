"""What contradicted statements move, and the test of an effect, on least squares done by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dbc.finding import Severity
from identify.fit.grey_box import Correction
from identify.trust import contradiction
from identify.trust.contradiction import (
    Contradiction,
    contradicted_shift,
    contradiction_findings,
    contradictions,
)
from identify.trust.score_test import Scores

Array = NDArray[np.float64]


def fitted(rows: Array, values: Array, stated: float, sigma: float) -> Any:
    """Return the fit of one spring and one stated delay, to runs (rows, values) of sigma 1.

    No fact is stated; the delay is, with its sigma.
    """
    H = rows.T @ rows + np.diag([0.0, sigma**-2])
    eta = np.linalg.solve(H, rows.T @ values + np.array([0.0, stated / sigma**2]))
    box = SimpleNamespace(
        parameters=("k_sf",), corrections=("delay",), facts=(), mass_states=(),
        stated=(Correction("delay", "imu", sigma),),
        prior_sigma=np.array([np.inf, sigma]), pulls=lambda eta: (eta[1:] - stated) / sigma,
    )  # fmt: skip
    fit = SimpleNamespace(eta=eta, covariance=np.linalg.inv(H))
    engine = SimpleNamespace(fact_misfits=lambda _: (np.zeros(0), np.zeros((0, 2))))
    return SimpleNamespace(box=box, fit=fit, engine=engine, holds=True, chi2_per_n=1.0)


RUNS = np.array([[1.0, 0.5], [1.0, -0.3], [0.1, 2.0]])


@pytest.mark.parametrize("size", [-0.9, 0.7])
def test_without_a_contradicted_statement_the_fit_is_that_of_the_runs_alone(size: float) -> None:
    values = np.array([0.3, -0.1, 12.0 * size])
    one = fitted(RUNS, values, 0.1 * size, 0.2)
    runs_alone = np.linalg.lstsq(RUNS, values)[0]
    wrong = Contradiction("delay", 5.0, np.ones(1))
    expected = runs_alone[0] - one.fit.eta[0]
    assert abs(expected) > 0.01
    assert contradicted_shift(one, (wrong,)) == pytest.approx([expected], rel=1e-9)


def test_a_misfit_counts_in_the_deviation_that_the_fit_leaves_it() -> None:
    """The runs say 6 with a sigma of 0.5, the statement 0 with 1.2: apart by 6 of 1.3."""
    one = fitted(np.array([[1.0, 0.0], [0.0, 2.0]]), np.array([0.0, 12.0]), 0.0, 1.2)
    ((name, sigmas),) = [(found.name, found.sigmas) for found in contradictions(one)]
    assert name == "delay"
    assert sigmas == pytest.approx(6.0 / 1.3)


@pytest.mark.parametrize(("apart", "named"), [(5.15, False), (5.25, True)])
def test_four_sigmas_are_a_contradiction(apart: float, named: bool) -> None:
    """Of 1.3: 5.2."""
    one = fitted(np.array([[1.0, 0.0], [0.0, 2.0]]), np.array([0.0, 2.0 * apart]), 0.0, 1.2)
    assert bool(contradictions(one)) is named
    assert bool(contradiction_findings(one)) is named


@pytest.mark.parametrize(("sigma", "testable"), [(1.57e-3, False), (1.59e-3, True)])
def test_a_statement_is_tested_of_whose_variance_the_misfit_has_1e_5(
    sigma: float, testable: bool
) -> None:
    """Beside runs of a sigma of 0.5 the share is sigma^2 / (sigma^2 + 0.25)."""
    one = fitted(np.array([[1.0, 0.0], [0.0, 2.0]]), np.array([0.0, 12.0]), 0.0, sigma)
    assert bool(contradictions(one)) is testable


@pytest.mark.parametrize(
    ("slope", "severity"),
    [
        (0.0172, Severity.WARNING),
        (0.0175, Severity.ERROR),
        (-0.0172, Severity.WARNING),
        (-0.0175, Severity.ERROR),
    ],
)
def test_statements_that_move_a_parameter_by_a_tenth_refuse_the_result(
    slope: float, severity: Severity
) -> None:
    """The runs say 6 with a sigma of 0.5, the statement 0 with 0.1: 24 / 104 = 0.23 together.

    Without the statement the delay moves by 5.77, and the spring by `slope` times as much.
    """
    rows = np.array([[1.0, slope], [0.0, 2.0]])
    (found,) = contradiction_findings(fitted(rows, np.array([0.0, 12.0]), 0.0, 0.1))
    assert (found.code, found.severity) == ("contradiction", severity)
    assert "delay" in found.text
    assert f"{abs(slope) * 577:.1f} %" in found.text


def scores(information: Array, mixed: Array, covariance: Array, gradient: Array) -> Scores:
    return Scores(gradient, information, mixed, covariance)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_effects_are_sized_as_by_least_squares_with_them(unit: float) -> None:
    """Of the whole design: one unknown, two effects, in any unit of the second effect."""
    rng = np.random.default_rng(0)
    unknown, effects = rng.standard_normal((20, 1)), rng.standard_normal((20, 2)) * [1.0, unit]
    samples = rng.standard_normal(20)
    left = samples - unknown @ np.linalg.lstsq(unknown, samples)[0]
    whole = np.hstack([unknown, effects])
    both, squares, *_ = np.linalg.lstsq(whole / np.linalg.norm(whole, axis=0), samples)
    both = both / np.linalg.norm(whole, axis=0)
    alone = np.linalg.lstsq(unknown, samples)[0]
    scaled = whole / np.linalg.norm(whole, axis=0)
    covariance = np.linalg.inv(scaled.T @ scaled)[1:, 1:]
    covariance /= np.outer(*[np.linalg.norm(effects, axis=0)] * 2)
    found = scores(
        effects.T @ effects, effects.T @ unknown, 1.0 / (unknown.T @ unknown),
        effects.T @ left,
    ).test([0, 1])  # fmt: skip
    assert found.sizes == pytest.approx(both[1:], rel=1e-9)
    assert found.stds == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-9)
    assert found.covariance == pytest.approx(covariance, rel=1e-9)
    assert found.gain == pytest.approx(float(left @ left) - float(squares[0]), rel=1e-9)
    assert found.shift == pytest.approx(both[:1] - alone, rel=1e-9)


@pytest.mark.parametrize("information", [1e-8, 1.0, 1e8])
@pytest.mark.parametrize(("share", "tested"), [(1.1e-9, True), (0.9e-9, False)])
def test_an_effect_is_tested_of_which_the_unknowns_leave_1e_9(
    information: float, share: float, tested: bool
) -> None:
    mixed = np.array([[np.sqrt(information * (1.0 - share))]])
    whole = scores(np.array([[information]]), mixed, np.eye(1), np.array([1e-3]))
    found = whole.test([0])
    expected = 1e-3 / (information * share) if tested else 0.0
    assert found.sizes == pytest.approx([expected], rel=1e-4)
    assert found.gain == pytest.approx(1e-3 * expected, rel=1e-4)


def test_an_effect_without_any_trace_has_no_size_and_spoils_no_other() -> None:
    whole = scores(np.diag([0.0, 4.0]), np.zeros((2, 1)), np.eye(1), np.array([0.0, 2.0]))
    found = whole.test([0, 1])
    assert found.sizes == pytest.approx([0.0, 0.5])
    assert found.stds == pytest.approx([0.0, 0.5])
    assert found.gain == pytest.approx(1.0)
    assert whole.test([1]).sizes == pytest.approx([0.5])


@pytest.mark.parametrize(("left", "named"), [(0.9e-3, 1), (1.1e-3, 2)])
def test_a_statement_is_named_beside_another_of_which_that_leaves_a_thousandth_to_be_tested(
    monkeypatch: pytest.MonkeyPatch, left: float, named: int
) -> None:
    """Misfits that correlate by r: without the first the second has a variance of 1 - r^2."""
    r = np.sqrt(1.0 - left)
    misfits = np.array([10.0, 10.0 * r - 8.0 * np.sqrt(left)])
    monkeypatch.setattr(contradiction, "suspects", lambda _: (("a", "b"), np.eye(2)))
    monkeypatch.setattr(contradiction, "_stated", lambda _: (np.eye(2), misfits))
    monkeypatch.setattr(contradiction, "_redundancy", lambda *_: np.array([[1.0, r], [r, 1.0]]))
    one: Any = SimpleNamespace(box=None, holds=True, chi2_per_n=1.0)
    assert [c.sigmas for c in contradictions(one)] == pytest.approx([10.0, 8.0][:named])


@pytest.mark.parametrize(("sigmas", "named"), [(4.0, 0), (-4.0, 0), (4.0625, 1), (-4.0625, 1)])
def test_four_sigmas_exactly_are_no_contradiction(
    monkeypatch: pytest.MonkeyPatch, sigmas: float, named: int
) -> None:
    monkeypatch.setattr(contradiction, "suspects", lambda _: (("a",), np.eye(1)))
    monkeypatch.setattr(contradiction, "_stated", lambda _: (np.eye(1), np.array([sigmas])))
    monkeypatch.setattr(contradiction, "_redundancy", lambda *_: np.eye(1))
    one: Any = SimpleNamespace(box=None, holds=True, chi2_per_n=1.0)
    assert len(contradictions(one)) == named


@pytest.mark.parametrize(("redundancy", "testable"), [(0.9e-5, False), (1.1e-5, True)])
def test_several_statements_together_are_tested_of_whose_variance_the_misfit_has_1e_5(
    monkeypatch: pytest.MonkeyPatch, redundancy: float, testable: bool
) -> None:
    """Two weights, off by 3 and 4 sigmas together: their variance is 25 times that of one."""
    monkeypatch.setattr(contradiction, "suspects", lambda _: (("both",), np.array([[3.0], [4.0]])))
    monkeypatch.setattr(contradiction, "_stated", lambda _: (np.eye(2), np.array([0.3, 0.4])))
    monkeypatch.setattr(contradiction, "_redundancy", lambda *_: redundancy * np.eye(2))
    one: Any = SimpleNamespace(box=None, holds=True, chi2_per_n=1.0)
    assert [c.sigmas for c in contradictions(one)] == pytest.approx(
        [0.5 / np.sqrt(redundancy)] * testable
    )


def test_a_parameter_that_may_be_zero_moves_by_no_share_of_itself() -> None:
    one = fitted(RUNS, np.array([0.3, -0.1, 8.0]), 0.1, 0.2)
    one.box.parameters = ("y_s",)
    wrong = Contradiction("delay", 5.0, np.ones(1))
    assert contradicted_shift(one, (wrong,)).tolist() == [0.0]


def test_an_unknown_that_was_not_released_has_no_variance() -> None:
    """The delay stays at 7.2, and 0 is stated with 1.2: it is 6 sigmas off."""
    one = fitted(np.array([[1.0, 0.0], [0.0, 2.0]]), np.zeros(2), 0.0, 1.2)
    one.fit.eta = np.array([0.0, 7.2])
    one.fit.covariance = np.diag([1.0, np.inf])
    assert [c.sigmas for c in contradictions(one)] == pytest.approx([6.0])
