"""Each run predicted from all the others: three runs of two parameters, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.fit.cross_validation import Prediction, leave_one_out
from identify.fit.likelihood import Residuals
from identify.fit.varpro import NormalBlock

RUNS = {
    "one": NormalBlock(0.0, np.diag([100.0, 400.0]), np.array([3.0, 8.0])),
    "two": NormalBlock(0.0, np.diag([100.0, 400.0]), np.array([-3.0, 0.0])),
    "three": NormalBlock(0.0, np.diag([300.0, 200.0]), np.array([0.0, -8.0])),
}
NOISE = {"a": 0.5}


def predicted(
    left: float = 240.0,
    freedom: float = 200.0,
    runs: dict[str, NormalBlock] = RUNS,
    lost: str = "",
) -> tuple[dict[str, Prediction], dict[str, NDArray[np.float64]]]:
    """Return the predictions, where `left` is chi2 of each, and the unknowns of each."""
    points = {}

    class Engine:
        def normal_blocks(self, *_: object) -> dict[str, NormalBlock]:
            return {"facts": NormalBlock(0.0, np.zeros((2, 2)), np.zeros(2)), **runs}

        def residuals(self, decays: Any, sigma: Any, eta: Any) -> tuple[Residuals, ...]:
            (decay,) = decays
            points[decay.label] = eta
            if decay.label == lost:
                raise FloatingPointError("no path")
            values = {"a": np.array([0.5 * left**0.5])}
            return (Residuals(decay.label, values, {"a": freedom}),)

    whole = np.sum([run.information for run in runs.values()], axis=0)
    own = {"a": np.array([0.5 * (0.9 * freedom) ** 0.5])}
    one: Any = SimpleNamespace(
        box=SimpleNamespace(parameters=("m_s", "k_sf")),
        fit=SimpleNamespace(eta=np.array([1.0, 2.0]), covariance=np.linalg.pinv(whole)),
        sigma=NOISE, noise=NOISE, rest={}, records=(), engine=Engine(),
        decays=tuple(SimpleNamespace(label=label) for label in runs),
        residuals=tuple(Residuals(label, own, {"a": freedom}) for label in runs),
    )  # fmt: skip
    return {found.label: found for found in leave_one_out(one)}, points


def test_a_run_is_predicted_one_step_from_the_optimum_of_all() -> None:
    """Without the first, the others know 400 and 600: they are off by -3 / 400 and -8 / 600."""
    found, points = predicted()
    assert list(found) == ["one", "two", "three"]
    assert points["one"] == pytest.approx([1.0 - 3.0 / 400.0, 2.0 - 8.0 / 600.0])
    assert points["two"] == pytest.approx([1.0 + 3.0 / 400.0, 2.0])
    one = found["one"]
    assert (one.fitted, one.predicted) == pytest.approx((0.9, 1.2))


def test_what_moves_most_is_named_in_deviations_of_the_difference() -> None:
    """Variances of 1 / 400 and 1 / 600 less those with all, 1 / 500 and 1 / 1000."""
    one, two, three = predicted()[0].values()
    assert one.parameter == "k_sf"
    assert one.moved == pytest.approx(-(8.0 / 600.0) / (1.0 / 600.0 - 1.0 / 1000.0) ** 0.5)
    assert two.parameter == "m_s"
    assert two.moved == pytest.approx((3.0 / 400.0) / (1.0 / 400.0 - 1.0 / 500.0) ** 0.5)
    assert three.parameter == "k_sf"
    assert three.moved == pytest.approx((8.0 / 800.0) / (1.0 / 800.0 - 1.0 / 1000.0) ** 0.5)


@pytest.mark.parametrize(
    ("freedom", "limit"),
    [
        # What the others leave open of the parameters counts, too: 100 / 400 and 400 / 600.
        (200.0, 1.0 + (0.25 + 2.0 / 3.0) / 200.0 + 5.0 * 0.02**0.5),
        (2e6, 1.05 + (0.25 + 2.0 / 3.0) / 2e6),
    ],
)
def test_a_prediction_may_leave_five_deviations_more_than_noise(
    freedom: float, limit: float
) -> None:
    found = predicted(freedom=freedom)[0]["one"]
    assert found.limit == pytest.approx(limit)
    for chi2, at_noise in ((limit - 0.001, True), (limit + 0.001, False)):
        assert predicted(chi2 * freedom, freedom)[0]["one"].at_noise is at_noise


def test_a_run_without_which_nothing_is_known_is_not_predicted() -> None:
    lone = RUNS | {
        "two": NormalBlock(0.0, np.diag([100.0, 0.0]), np.zeros(2)),
        "three": NormalBlock(0.0, np.diag([300.0, 0.0]), np.zeros(2)),
    }
    found, points = predicted(runs=lone)
    one = found["one"]
    assert np.isnan([one.predicted, one.limit, one.moved]).all()
    assert (one.parameter, one.at_noise) == ("", False)
    assert one.fitted == pytest.approx(0.9)
    assert list(points) == ["two", "three"]
    # The first run says all of k_sf, the others nothing: without them it does not move.
    assert found["two"].parameter == "m_s"


def test_a_run_whose_path_is_lost_is_not_predicted() -> None:
    found, _ = predicted(lost="two")
    assert np.isnan(found["two"].predicted)
    assert found["three"].predicted == pytest.approx(1.2)


def test_one_run_has_no_others() -> None:
    assert predicted(runs={"one": RUNS["one"]})[0] == {}
