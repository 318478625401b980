"""Maximum likelihood of the modes: accuracy against the Cramer-Rao bound, honest deviations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA
from identify.model.matrices import physical_model
from identify.modes import modal_likelihood as likelihood
from identify.modes.modal_likelihood import (
    Block,
    LikelyModes,
    Point,
    Samples,
    System,
    gathered,
    most_likely_modes,
)
from identify.modes.modal_model import ModalModel, mac, modes_of
from identify.modes.mode_selection import identify_modes, likely_modes, sensed_modes

from ..bumps import CASES, MASS_STATES, paper_records
from ..modal_bound import unstructured_bound
from ..structures import CLOSE_PAIR_HZ, free_decay, oscillators, struck_frame

Array = NDArray[np.float64]
WARP = (*CASES, Excitation.WARP)
TRUTH = modes_of(physical_model(FORD_GRANADA).A)
SEEDS = 20

# docs/method.md, "Modes from free decays": per cent, computed with another program.
PUBLISHED_BOUND = [
    *(0.14, 0.11, 0.15, 0.99, 0.06, 1.85, 0.06),
    *(0.53, 0.44, 0.55, 3.3, 0.27, 7.3, 0.24),
]


def block(rate_hz: float, runs: list[Array]) -> Block:
    """Return runs of one length, each (n, n_channels)."""
    n, n_channels = runs[0].shape
    values = np.stack(runs, axis=1)
    return Block(np.arange(n) / rate_hz, values, np.arange(len(runs)), np.arange(n_channels))


def of_arrays(seed: int, cases: tuple[Excitation, ...]) -> ModalModel:
    records = paper_records(200.0, 30.0, seed, cases, MASS_STATES[:1])
    return identify_modes([r.decay(0.3 + 1e-9).recordings[0].values for r in records], 200.0)


def of_sensors(seed: int, cases: tuple[Excitation, ...]) -> ModalModel:
    records = paper_records(200.0, 30.0, seed, cases, MASS_STATES[:1])
    sensed = sensed_modes(records, [record.decay(0.3 + 1e-9) for record in records])
    return sensed.model


def errors(found: ModalModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return relative errors of frequencies and damping ratios, and errors over deviations."""
    assert len(found) == 7
    distance = np.abs(found.poles - TRUTH.poles[:, None]) / 10.0
    unlike = 1.0 - mac(TRUTH.shapes, found.shapes / found.poles**2)
    mine = linear_sum_assignment(distance + unlike)[1]
    truth = np.concatenate([TRUTH.frequencies_hz, TRUTH.damping_ratios])
    error = np.concatenate([found.frequencies_hz[mine], found.damping_ratios[mine]]) - truth
    std = np.concatenate([found.frequency_std_hz[mine], found.damping_ratio_std[mine]])
    return error / truth, error / std


def rms(values: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))


def test_the_bound_by_brute_force_is_the_published_one() -> None:
    np.testing.assert_allclose(100.0 * unstructured_bound(200.0, 30.0), PUBLISHED_BOUND, rtol=0.2)


@pytest.mark.parametrize("identify", [of_arrays, of_sensors], ids=["arrays", "sensors"])
def test_all_seven_modes_at_30_db_near_the_bound(
    identify: Callable[[int, tuple[Excitation, ...]], ModalModel],
) -> None:
    both = [errors(identify(seed, CASES)) for seed in range(3)]
    ratio = rms([error for error, _ in both]) / unstructured_bound(200.0, 30.0)
    assert np.sqrt(np.mean(ratio**2)) < 1.3
    assert 0.7 < np.sqrt(np.mean(np.square([pull for _, pull in both]))) < 1.3


@pytest.mark.long
@pytest.mark.parametrize(
    ("identify", "cases"),
    [(of_arrays, CASES), (of_arrays, WARP), (of_sensors, CASES)],
    ids=["arrays", "arrays with warp", "sensors"],
)
def test_all_seven_modes_at_30_db_to_the_bound(
    identify: Callable[[int, tuple[Excitation, ...]], ModalModel], cases: tuple[Excitation, ...]
) -> None:
    both = [errors(identify(seed, cases)) for seed in range(SEEDS)]
    ratio = rms([error for error, _ in both]) / unstructured_bound(200.0, 30.0, cases)
    assert ratio.max() < 1.5
    if identify is of_sensors:
        assert rms([error for error, _ in both]).max() < 0.09
    pull = rms([pull for _, pull in both])
    # 20 seeds leave 0.16 to chance; unsplit, the pairs of wheel modes know less than they say.
    lowest = 0.45 if identify is of_arrays and cases == CASES else 0.6
    assert lowest < pull.min()
    assert pull.max() < 1.4
    assert 0.8 < np.sqrt(np.mean(pull**2)) < 1.15


def test_deviations_are_those_of_the_information_matrix() -> None:
    """Two modes, two channels with offsets of their own; Jacobian by differences."""
    rng = np.random.default_rng(0)
    poles = oscillators([1.0, 1.3], [0.05, 0.1])
    shapes = np.array([[1.0, 0.6j], [0.5, -1.0]])
    amplitudes = np.array([[1.0, 0.7], [0.3j, 1.0]])
    time = np.sort(rng.uniform(0.0, 4.0, 800))

    def model(x: NDArray[np.float64]) -> NDArray[np.float64]:
        p = x[:2] + 1j * x[2:4]
        s = np.array([[1.0, x[4] + 1j * x[5]], [x[6] + 1j * x[7], -1.0]])
        q = (x[8:12] + 1j * x[12:16]).reshape(2, 2)
        wave = np.exp(np.outer(time, p))
        level = x[16:].reshape(2, 2)
        runs = [((wave * q[r]) @ s.T).real + level[r] for r in range(2)]
        return np.hstack(runs).ravel()

    amplitude_parts = amplitudes.real.ravel(), amplitudes.imag.ravel()
    free_entries, levels = [0.0, 0.6, 0.5, 0.0], [0.4, -0.2, 1.0, 0.1]
    x = np.concatenate([poles.real, poles.imag, free_entries, *amplitude_parts, levels])
    step = 1e-6
    jacobian = np.array(
        [(model(x + step * e) - model(x - step * e)) / (2.0 * step) for e in np.eye(len(x))]
    ).T
    noise = np.array([0.02, 0.05])
    jacobian = (jacobian.reshape(len(time), 2, 2, -1) / noise[:, None]).reshape(-1, len(x))
    expected = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian))[:4])

    values = model(x).reshape(len(time), 4) + np.tile(noise, 2) * rng.standard_normal((800, 4))
    series, runs = values.reshape(-1, 2, 2), np.arange(2)
    blocks = [
        Block(time, series[..., :1], runs, np.array([0])),
        Block(time, series[..., 1:], runs, np.array([1])),
    ]
    found = most_likely_modes(gathered(blocks), poles * (1.0 + 0.02j), shapes)
    std = np.sqrt(np.diag(found.pole_covariance))
    np.testing.assert_allclose(std, expected, rtol=0.1)
    assert np.all(np.abs(found.poles - poles) < 4.0 * np.hypot(std[:2], std[2:]))
    np.testing.assert_allclose(found.noise, noise, rtol=0.1)


def test_the_noise_of_few_samples_counts_what_the_fit_took_out_of_them() -> None:
    """Of two channels of 20 samples a mode takes two figures for its pole and six for motion."""
    rng = np.random.default_rng(4)
    poles, shapes = oscillators([2.0], [0.1]), np.array([[1.0], [0.5 + 0j]])
    record = free_decay(poles, shapes, np.array([3.0]), 20.0, 1.0)
    squares = []
    for _ in range(100):
        values = record + 0.1 * rng.standard_normal(record.shape)
        squares.append(
            most_likely_modes(gathered([block(20.0, [values])]), poles, shapes).noise ** 2
        )
    # 100 variances of some 18 degrees of freedom each: their mean is right to 3 %.
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.1, rel=0.06)


def test_noise_free_modes_have_no_deviation_and_those_of_a_matrix_have_none_stated() -> None:
    record = free_decay(oscillators([2.0], [0.1]), np.ones((1, 1)), np.ones(1), 100.0, 2.0)
    found = identify_modes([record], 100.0)
    assert list(found.frequency_std_hz) == [0.0]
    assert list(found.damping_ratio_std) == [0.0]
    assert np.all(np.isnan(TRUTH.frequency_std_hz))


def test_a_mode_that_has_died_before_the_first_sample_is_held_and_leaves_the_others_alone() -> None:
    rng = np.random.default_rng(2)
    poles, time = oscillators([1.0], [0.05]), np.arange(1, 301) / 50.0
    both = [
        0.01 * rng.standard_normal((300, 2))
        + 2.0 * np.real(np.exp(np.outer(time, poles)) @ (np.array([[1.0, 0.5]]) * size))
        for size in (1.0, 0.7j)
    ]
    samples = gathered([Block(time, np.stack(both, axis=1), np.arange(2), np.arange(2))])
    alone = most_likely_modes(samples, poles, np.array([[1.0], [0.5]], dtype=complex))
    shapes = np.array([[1.0, 1.0], [0.5, 1.0]], dtype=complex)
    beside = most_likely_modes(samples, np.append(poles, -1e6), shapes)
    assert abs(alone.poles[0] / poles[0] - 1.0) < 0.002
    assert abs(beside.poles[0] / alone.poles[0] - 1.0) < 1e-6
    assert np.isfinite(beside.pole_covariance).all()
    ratio = beside.pole_covariance[0, 0] / alone.pole_covariance[0, 0]
    assert abs(ratio - 1.0) < 0.02


# Where a fit of modes ends, what it keeps, and how it weights: each limit from both sides ---------


def of_one_pole(start: complex, time_s: Array, values: Array) -> complex:
    samples = gathered([Block(time_s, values[:, None, None], np.array([0]), np.array([0]))])
    poles = np.array([start], dtype=complex)
    return complex(most_likely_modes(samples, poles, np.ones((1, 1), complex)).poles[0])


@pytest.mark.parametrize("nepers", [29.9, 30.1])
def test_no_pole_grows_by_more_than_30_nepers_within_the_longest_series(nepers: float) -> None:
    """Of two seconds; the samples themselves grow so, so that nothing else forbids the step."""
    time = np.arange(41) / 20.0
    growth = 2.0 * of_one_pole(14.5, time, np.exp(nepers / 2.0 * time)).real
    assert growth == pytest.approx(29.9, abs=1e-3) if nepers < 30.0 else growth <= 30.0


@pytest.mark.parametrize(("start", "pair"), [(-1.0 + 1.0j, True), (-2.0 + 0.0j, False)])
def test_a_pair_stays_a_pair_and_a_real_pole_real(start: complex, pair: bool) -> None:
    time = np.arange(60) / 20.0
    noise = 1e-3 * np.random.default_rng(0).standard_normal(60)
    found = of_one_pole(start, time, np.exp(-time) + noise)
    assert (found.imag > 0.0) is pair
    assert found.real == pytest.approx(-1.0, rel=0.05)


POLES = oscillators([2.0, 5.0], [0.05, 0.04])
SHAPES = np.array([[1.0, 1.0], [0.5, -1.0]], dtype=complex)


def beside(weak: float) -> Samples:
    """Return two runs of 200 samples of two channels: a strong mode, noise of 1, a weak mode."""
    rng = np.random.default_rng(11)
    runs = [free_decay(POLES, SHAPES, np.array([a, weak * a]), 50.0, 4.0) for a in (30.0, 20.0j)]
    values = np.hstack(runs) + rng.standard_normal((200, 4))
    return gathered([block(50.0, [values[:, :2], values[:, 2:]])])


@pytest.mark.parametrize(("weak", "gain", "modes"), [(0.03635, 40.0, 1), (0.03712, 41.4, 2)])
def test_a_mode_stays_that_gains_more_than_noise_does(weak: float, gain: float, modes: int) -> None:
    """Two channels and two runs give a mode 8 numbers, to 400 samples of each channel."""
    assert chdtri(8, 1e-3 / 400) == pytest.approx(40.58, abs=0.01)
    samples = beside(weak)
    both = most_likely_modes(samples, POLES, SHAPES).point.log_likelihood
    alone = most_likely_modes(samples, POLES[:1], SHAPES[:, :1]).point.log_likelihood
    assert both - alone == pytest.approx(gain, abs=0.3)
    assert len(likely_modes(samples, POLES, SHAPES).poles) == modes


def test_real_poles_count_fewer_numbers() -> None:
    """A pair and a real pole, one run, three channels.

    Pole 2 and 1, amplitudes 2 and 1 that set the scales, further shapes 4 and 2, levels 3.
    """
    rng = np.random.default_rng(7)
    poles = np.append(oscillators([2.0], [0.1]), -3.0)
    shapes = np.array([[1.0, 1.0], [1.0, 1.0], [0.5, -1.0]], dtype=complex)
    record = free_decay(poles, shapes, np.array([1.0, 0.5]), 50.0, 3.0)
    record = record + 0.01 * rng.standard_normal(record.shape)
    found = most_likely_modes(gathered([block(50.0, [record])]), poles, shapes)
    assert found.n_unknowns == 3 + 3 + 6 + 3
    assert found.poles[1].imag == 0.0
    assert found.poles == pytest.approx(poles, rel=0.05)


# A mode that hides beside another is found, in every unit -----------------------------------------

THREE = oscillators([2.0, 5.0, 5.15], [0.03, 0.02, 0.025])
THREE_SHAPES = np.array([[1.0, 1.0, 0.6], [0.5, -0.7, 1.0], [-0.4, 0.3, 0.5]], dtype=complex)
AMPLITUDES = (np.array([1.0, 1.0, 0.3]), np.array([0.5j, 0.4, 1.0j]))


def of_three(
    poles: NDArray[np.complex128], shapes: NDArray[Any], noise: Array, unit: Array
) -> Samples:
    """Return two runs of 200 samples of three channels."""
    rng = np.random.default_rng(12)
    runs = [free_decay(poles, shapes, q, 40.0, 5.0) for q in AMPLITUDES]
    noisy = [(run + noise * rng.standard_normal(run.shape)) * unit for run in runs]
    return gathered([block(40.0, noisy)])


def in_order(found: LikelyModes) -> tuple[NDArray[np.complex128], NDArray[np.intp]]:
    order = np.argsort(np.abs(found.poles))
    return found.poles[order], order


@pytest.mark.parametrize("units", [(1.0, 1.0, 1.0), (1e3, 1.0, 1e-2)])
@pytest.mark.parametrize("seen", [[0, 1], [1, 0], [0, 2]])
def test_modes_that_hide_are_found_beside_those_that_are_seen(
    seen: list[int], units: tuple[float, float, float]
) -> None:
    """In any order, and whichever of a near pair is seen."""
    unit = np.array(units)
    samples = of_three(THREE, THREE_SHAPES, np.full(3, 0.01), unit)
    found = likely_modes(samples, THREE[seen], (THREE_SHAPES * unit[:, None])[:, seen])
    poles, order = in_order(found)
    assert poles == pytest.approx(THREE, rel=5e-3)
    shapes = found.shapes[:, order] / unit[:, None]
    assert shapes / shapes[0] == pytest.approx(THREE_SHAPES / THREE_SHAPES[0], abs=0.1)


@pytest.mark.parametrize("first", [0, 1])
def test_a_mode_is_sought_where_it_hides_and_not_where_most_moves_or_rustles(first: int) -> None:
    """It is short-lived, beside one that is, too; a slow mode lasts, and one channel is noisy."""
    poles = oscillators([1.0, 6.0, 7.2], [0.005, 0.1, 0.1])
    samples = of_three(poles, 5.0 * THREE_SHAPES, np.array([0.1, 10.0, 0.1]), np.ones(3))
    start = [first, 1 - first]
    found = likely_modes(samples, poles[start], THREE_SHAPES[:, start])
    assert in_order(found)[0] == pytest.approx(poles, rel=0.03)


# A structure that is struck many times: close modes are held apart, copies of one are merged ------

RATE_HZ = 512.0


def test_modes_that_nearly_coincide_are_told_apart_and_none_else_is_found() -> None:
    records, poles = struck_frame(8, 16, 3)
    found = identify_modes(records, RATE_HZ)
    truth = np.sort(np.abs(poles)) / (2.0 * np.pi)
    assert len(found) == 8
    assert np.max(np.abs(found.frequencies_hz / truth - 1.0)) < 3e-5
    assert np.max(np.abs(found.frequencies_hz - truth) / found.frequency_std_hz) < 4.0
    pair = found.frequencies_hz[(found.frequencies_hz > 125.0) & (found.frequencies_hz < 126.0)]
    assert pair == pytest.approx(CLOSE_PAIR_HZ, abs=0.005)


def test_a_mode_whose_frequency_drifts_is_one_mode() -> None:
    """One in a thousand from record to record, five times what noise leaves open in all."""
    records, poles = struck_frame(6, 16, 4, drift=1e-3)
    found = identify_modes(records, RATE_HZ)
    assert no_copies(found, poles)
    truth = np.sort(np.abs(poles)) / (2.0 * np.pi)
    for frequency_hz in truth:
        assert np.min(np.abs(found.frequencies_hz / frequency_hz - 1.0)) < 1e-3
    assert len(found) <= len(poles) + 2


def test_poles_that_follow_a_drift_do_not_multiply_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A ground-vibration test: some thirty poles stand out from the noise, and eight are modes.

    A step of the fit takes runs times poles squared.  Thirty steps of thirty poles in all 30 runs
    would be 0.8 million; a fit of all poles to the end takes ten times that.
    """
    linearised, work = likelihood.linearised, []

    def counted_step(point: Point) -> System:
        n_runs, n_modes = point.amplitudes.shape
        work.append(n_runs * n_modes**2)
        return linearised(point)

    monkeypatch.setattr(likelihood, "linearised", counted_step)
    struck, poles = struck_frame(8, 30, 4, drift=1e-3)
    found = identify_modes(struck, RATE_HZ)
    assert sum(work) < 800_000
    assert no_copies(found, poles)
    for frequency_hz in np.abs(poles) / (2.0 * np.pi):
        assert np.min(np.abs(found.frequencies_hz / frequency_hz - 1.0)) < 2e-3


def no_copies(found: ModalModel, poles: NDArray[np.complex128]) -> bool:
    """Return whether no true mode but the close pair is near to two that were found."""
    truth = np.abs(poles) / (2.0 * np.pi)
    near = np.abs(found.frequencies_hz[:, None] / truth - 1.0) < 0.005
    alone = np.abs(truth - np.mean(CLOSE_PAIR_HZ)) > 1.0
    return bool(np.all(near.sum(axis=0)[alone] <= 1) and np.all(near.sum(axis=0)[~alone] <= 2))
