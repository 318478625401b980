"""Intervals of parameters, modes and derived quantities, and what they rest on."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import FORD_GRANADA, Structure, VehicleParameters
from identify.fit.estimation import generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import FACTS, PRIORS, Fit, Residuals, fit
from identify.fit.uncertainty import (
    Prediction,
    correlation,
    derived_estimates,
    drivers,
    estimates,
    leave_one_out,
    mode_estimates,
)
from identify.fit.varpro import NormalBlock
from identify.model.matrices import FULL_NAMES, SYMMETRIC, derived_quantities, physical_model

from ..bumps import GROUP, MASS_STATES, PAPER_DELTA_MASS, TRUTH, noise_of, paper_records

BOX = GreyBox((GROUP,), MASS_STATES, None)


@pytest.fixture(scope="module")
def best() -> Fit:
    records = paper_records(200.0, 30.0, 3)
    decays = tuple(r.decay(0.3 + 1e-9) for r in records)
    return fit(BOX, decays, noise_of(records, 200.0), BOX.unknowns(generic_vehicles()[0]))


def _draws(best: Fit, n: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(5)
    return rng.multivariate_normal(best.eta, best.covariance, n, method="cholesky")


def _modes(theta: NDArray[np.float64], load: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return frequencies, Hz, and damping ratios by NumPy's eigenvalues, (14,)."""
    model = physical_model(VehicleParameters(*theta))
    poles = np.linalg.eigvals(model.with_mass(load).A)
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(np.abs(poles))]
    return np.concatenate([np.abs(poles) / (2.0 * np.pi), -poles.real / np.abs(poles)])


def test_intervals_are_those_of_the_normal_distribution(best: Fit) -> None:
    spread = np.exp(_draws(best, 20_000))
    for i, (name, e) in enumerate(estimates(BOX, best).items()):
        assert e.std == pytest.approx(spread[:, i].std(), rel=0.03), name
        is_inside = (spread[:, i] > e.low) & (spread[:, i] < e.high)
        assert np.mean(is_inside) == pytest.approx(0.95, abs=0.01), name
        assert e.low < e.value < e.high


def test_slopes_of_all_modes_against_differences() -> None:
    """One unknown alone uncertain: the std of a mode is its slope by that unknown."""
    eta = BOX.unknowns(TRUTH)
    step = 1e-6
    for p in range(15):
        covariance = np.zeros((15, 15))
        covariance[p, p] = 1.0
        alone = Fit(eta, covariance, 0.0, {}, 1, True)
        found = mode_estimates(BOX, alone, "added")
        stds = [m.frequency.std for m in found] + [m.damping_ratio.std for m in found]
        up, down = (
            _modes(np.exp(eta + s * step * np.eye(15)[p]), PAPER_DELTA_MASS) for s in (1.0, -1.0)
        )
        np.testing.assert_allclose(stds, np.abs(up - down) / (2.0 * step), rtol=1e-4, atol=1e-6)


def test_correlation_is_that_of_draws(best: Fit) -> None:
    found = correlation(BOX, best)
    assert found.names == BOX.parameters
    np.testing.assert_allclose(found.matrix, found.matrix.T, atol=1e-12)
    np.testing.assert_allclose(np.diag(found.matrix), 1.0, atol=1e-12)
    assert np.max(np.abs(found.matrix)) <= 1.0 + 1e-12
    np.testing.assert_allclose(found.matrix, np.corrcoef(_draws(best, 20_000).T), atol=0.03)
    # Free decays leave the scale to the added mass, so all that carries it errs together.
    assert found.matrix[found.names.index("m_s"), found.names.index("k_sf")] > 0.5


def test_shares_of_what_drives_a_parameter_add_up(best: Fit) -> None:
    found = drivers(BOX, best)
    assert set(found) == set(BOX.parameters)
    for shares in found.values():
        assert sum(shares.values()) == pytest.approx(1.0, abs=1e-6)
        assert min(shares.values()) >= -1e-12
        assert list(shares.values()) == sorted(shares.values(), reverse=True)
        assert shares[FACTS] == shares[PRIORS] == 0.0
    # Only the roll runs show roll; what moves with it in common, all runs.
    roll = sum(share for source, share in found["I_xx"].items() if "roll" in source)
    assert roll > 0.5


def test_a_driver_is_what_more_of_it_would_gain(best: Fit) -> None:
    C, share = best.covariance, 1e-4
    found = drivers(BOX, best)
    for source, H in best.information.items():
        more = np.linalg.inv(np.linalg.inv(C) + share * H)
        gained = (1.0 - np.diag(more) / np.diag(C)) / share
        expected = [found[name][source] for name in BOX.parameters]
        np.testing.assert_allclose(gained, expected, atol=1e-3)


def test_undetermined_parameters_have_no_interval_and_spoil_no_other(best: Fit) -> None:
    covariance = best.covariance.copy()
    lost = BOX.parameters.index("I_xx")
    covariance[lost, lost] = np.inf
    vague = replace(best, covariance=covariance)
    found = estimates(BOX, vague)
    assert found["I_xx"].std == np.inf
    assert (found["I_xx"].low, found["I_xx"].high) == (-np.inf, np.inf)
    assert found["m_s"] == estimates(BOX, best)["m_s"]
    derived, before = derived_estimates(BOX, vague), derived_estimates(BOX, best)
    assert derived["roll_radius_of_gyration"].std == np.inf
    assert derived["total_mass"] == before["total_mass"]
    matrix = correlation(BOX, vague).matrix
    assert np.all(np.isnan(matrix[lost]))
    assert np.isfinite(np.delete(np.delete(matrix, lost, 0), lost, 1)).all()
    assert drivers(BOX, vague)["I_xx"] == {}
    assert sum(drivers(BOX, vague)["m_s"].values()) == pytest.approx(1.0, abs=1e-6)
    # Bounce and pitch do not move with I_xx on a symmetric car, roll does.
    modes = mode_estimates(BOX, vague, "baseline")
    assert sum(np.isinf(m.frequency.std) for m in modes) >= 3


def test_spread_of_derived_quantities_against_differences() -> None:
    box = GreyBox((GROUP,), MASS_STATES, None, Structure(symmetric=False, cg_offset=True))
    full = SYMMETRIC @ FORD_GRANADA.to_array()
    full[FULL_NAMES.index("y_s")] = 0.03
    eta = box.unknowns_of(full)
    rng = np.random.default_rng(2)
    root = 0.01 * rng.standard_normal((len(eta), len(eta)))
    found = derived_estimates(box, Fit(eta, root @ root.T, 0.0, {}, 1, True))

    def values(at: NDArray[np.float64]) -> NDArray[np.float64]:
        quantities = derived_quantities(box.full(at.astype(complex)))
        return np.array([float(value.real) for value, _ in quantities.values()])

    step = 1e-5
    slopes = np.array(
        [(values(eta + step * e) - values(eta - step * e)) / (2 * step) for e in np.eye(len(eta))]
    )
    expected = np.linalg.norm(root.T @ slopes, axis=0)
    np.testing.assert_allclose([e.std for e in found.values()], expected, rtol=1e-5)


# Each run predicted from all the others: three runs of two parameters, by hand -------------------

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
    assert np.isnan([one.predicted, one.limit]).all()
    assert not one.at_noise
    assert one.fitted == pytest.approx(0.9)
    assert list(points) == ["two", "three"]
    found, _ = predicted(lost="two")
    assert [name for name, p in found.items() if np.isnan([p.predicted, p.limit]).all()] == ["two"]
