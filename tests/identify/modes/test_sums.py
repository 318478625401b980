"""Sums of exponentials over blocks, and the equations made of them, against plain matrices."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import chdtri

from identify.modes.modal_likelihood import (
    Ties,
    gathered,
    most_likely_modes,
)
from identify.modes.mode_selection import likely_modes
from identify.modes.waves import Block

from ..structures import free_decay, oscillators


def measured(sigma: float, offset: float, seed: int = 1) -> Block:
    """Return two runs of two channels of one mode, 200 samples each, on an offset."""
    rng = np.random.default_rng(seed)
    poles, shapes = oscillators([2.0], [0.05]), np.array([[1.0], [0.5 + 0.2j]])
    runs = [free_decay(poles, shapes, np.array([a]), 50.0, 4.0) for a in (30.0, 20.0j)]
    values = np.hstack(runs) * sigma + offset * sigma
    values = values + sigma * rng.standard_normal(values.shape)
    return Block(np.arange(200) / 50.0, values, np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]))


@pytest.mark.parametrize("sigma", [1e-3, 1e3])
@pytest.mark.parametrize(("offset", "fitted"), [(0.02, False), (0.4, True)])
def test_levels_are_fitted_where_that_pays_whatever_the_unit(
    sigma: float, offset: float, fitted: bool
) -> None:
    """Of 200 samples an offset of 0.4 of the noise gains 4 x 32, and chance 18.5 once in 1000.

    The channels' unit must not matter: only the ratio of two likelihoods counts.
    """
    assert chdtri(4, 1e-3) == pytest.approx(18.5, abs=0.05)
    block = measured(sigma, offset)
    pole, shape = oscillators([2.0], [0.05]), np.array([[1.0], [0.5 + 0.2j]])
    found = likely_modes(gathered([block]), pole, shape)
    level = Block(block.time_s, block.values, block.run, block.channel, free_level=fitted)
    expected = most_likely_modes(gathered([level]), pole, shape)
    assert found.log_likelihood == pytest.approx(expected.log_likelihood, abs=1e-3)
    assert found.noise == pytest.approx(expected.noise, rel=1e-4)


def test_the_likelihood_is_that_of_white_noise_of_its_own_size_in_each_channel() -> None:
    """Two channels of 400 samples; 2 numbers for the pole, 4 amplitudes, 4 of shape, 2 of scale."""
    block = measured(2.0, 0.0)
    pole, shape = oscillators([2.0], [0.05]), np.array([[1.0], [0.5 + 0.2j]])
    found = most_likely_modes(gathered([block]), pole, shape)
    wave = np.exp(np.outer(block.time_s, found.poles))
    left = [
        block.values[:, k] - (wave @ (found.shapes[c] * found.amplitudes[r])).real
        for k, (r, c) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)])
    ]
    squares = np.array(
        [left[0] @ left[0] + left[2] @ left[2], left[1] @ left[1] + left[3] @ left[3]]
    )
    assert found.log_likelihood == pytest.approx(-400 * np.sum(np.log(squares / 400)), rel=1e-9)
    assert found.n_unknowns == 2 + 4 + 4 - 2
    assert found.noise == pytest.approx(np.sqrt(squares / 400 / (1 - 8 / 800)), rel=1e-9)


def test_the_deviation_of_a_pole_is_that_of_the_whole_design() -> None:
    """By its derivatives: pole, amplitudes of two runs, shape; one amplitude sets the scale."""
    block = measured(2.0, 0.0)
    pole, shape = oscillators([2.0], [0.05]), np.array([[1.0], [0.5 + 0.2j]])
    found = most_likely_modes(gathered([block]), pole, shape)
    q, s = found.amplitudes[:, 0], found.shapes[:, 0]
    wave = np.exp(found.poles[0] * block.time_s)
    rows = []
    for k, (run, channel) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)]):
        by = np.zeros((len(wave), 5), dtype=complex)
        by[:, 0] = block.time_s * wave * q[run] * s[channel]
        by[:, 1 + run] = wave * s[channel]
        by[:, 3 + channel] = wave * q[run]
        left = block.values[:, k] - (wave * q[run] * s[channel]).real
        rows.append((channel, np.hstack([by.real, -by.imag]), left))
    variance = [sum(left @ left for c, _, left in rows if c == channel) / 400 for channel in (0, 1)]
    H = sum(J.T @ J / variance[c] for c, J, _ in rows)
    held = np.delete(np.arange(10), [1, 6])
    covariance = np.linalg.inv(np.asarray(H)[np.ix_(held, held)]) / (1 - 8 / 800)
    expected = covariance[np.ix_([0, 4], [0, 4])]
    assert found.pole_covariance == pytest.approx(expected, rel=1e-6)


def test_real_poles_and_ties_count_fewer_numbers() -> None:
    """A pair and a real pole, one run, three channels of which two move alike.

    Pole 2 and 1, amplitudes 2 and 1 that set the scales, shapes of two owners 4 and 2.
    """
    rng = np.random.default_rng(7)
    poles = np.append(oscillators([2.0], [0.1]), -3.0)
    shapes = np.array([[1.0, 1.0], [1.0, 1.0], [0.5, -1.0]], dtype=complex)
    record = free_decay(poles, shapes, np.array([1.0, 0.5]), 50.0, 3.0)
    record = record + 0.01 * rng.standard_normal(record.shape)
    block = Block(np.arange(150) / 50.0, record, np.zeros(3, int), np.arange(3))
    ties = Ties(np.array([0, 0, 1]), np.ones((3, 2)))
    found = most_likely_modes(gathered([block]), poles, shapes, ties)
    assert found.n_unknowns == 3 + 6
    assert found.poles[1].imag == 0.0
    assert found.poles == pytest.approx(poles, rel=0.05)


# A mode that hides beside another is found, in every unit and under ties --------------------------

POLES_OF_HIDDEN_MODES = oscillators([2.0, 5.0, 5.15], [0.03, 0.02, 0.025])
SHAPES = np.array([[1.0, 1.0, 0.6], [0.5, -0.7, 1.0], [-0.4, 0.3, 0.5]], dtype=complex)
AMPLITUDES = (np.array([1.0, 1.0, 0.3]), np.array([0.5j, 0.4, 1.0j]))


def block(units: NDArray[np.float64], shapes: NDArray[np.complex128] = SHAPES) -> Block:
    """Return two runs of 200 samples of three channels, noise of a hundredth of each unit."""
    rng = np.random.default_rng(12)
    runs = [free_decay(POLES_OF_HIDDEN_MODES, shapes, q, 40.0, 5.0) for q in AMPLITUDES]
    values = np.hstack([(r + 0.01 * rng.standard_normal(r.shape)) * units for r in runs])
    return Block(
        np.arange(200) / 40.0, values, np.repeat([0, 1], 3), np.tile(np.arange(3), 2),
        free_level=True,
    )  # fmt: skip


@pytest.mark.parametrize("units", [(1.0, 1.0, 1.0), (1e3, 1.0, 1e-2)])
@pytest.mark.parametrize("seen", [[0, 1], [1, 0], [0, 2]])
def test_modes_that_hide_are_found_beside_those_that_are_seen(
    seen: list[int], units: tuple[float, float, float]
) -> None:
    """In any order, and whichever of a near pair is seen."""
    unit = np.array(units)
    found = likely_modes(
        gathered([block(unit)]), POLES_OF_HIDDEN_MODES[seen], (SHAPES * unit[:, None])[:, seen]
    )
    order = np.argsort(np.abs(found.poles))
    assert found.poles[order] == pytest.approx(POLES_OF_HIDDEN_MODES, rel=5e-3)
    shapes = found.shapes[:, order] / unit[:, None]
    assert shapes / shapes[0] == pytest.approx(SHAPES / SHAPES[0], abs=0.1)


def test_a_hidden_mode_has_the_kind_of_the_mode_that_hid_it() -> None:
    """Two equal channels and one in the middle; the hidden mode is symmetric as its neighbour."""
    alike = np.array([[1.0, 1.0, 0.6], [-1.0, 1.0, 0.6], [0.0, 0.3, -0.5]], dtype=complex)
    ties = Ties(np.array([0, 0, 1]), np.array([[1.0, 1.0], [-1.0, 1.0], [0.0, 1.0]]))
    found = likely_modes(
        gathered([block(np.ones(3), alike)]), POLES_OF_HIDDEN_MODES[:2], alike[:, :2], ties
    )
    assert len(found.poles) == 3
    order = np.argsort(np.abs(found.poles))
    assert found.poles[order] == pytest.approx(POLES_OF_HIDDEN_MODES, rel=5e-3)
    assert found.ties.sign[:, order].tolist() == [[1, 1, 1], [-1, 1, 1], [0, 1, 1]]


@pytest.mark.parametrize("first", [0, 1])
def test_a_mode_is_sought_where_it_hides_and_not_where_most_moves_or_rustles(first: int) -> None:
    """It is short-lived, beside one that is, too; a slow mode lasts, and one channel is noisy."""
    poles = oscillators([1.0, 6.0, 7.2], [0.005, 0.1, 0.1])
    rng = np.random.default_rng(13)
    runs = [free_decay(poles, SHAPES, 5.0 * q, 40.0, 5.0) for q in AMPLITUDES]
    noise = np.array([0.1, 10.0, 0.1])
    values = np.hstack([r + noise * rng.standard_normal(r.shape) for r in runs])
    given = Block(
        np.arange(200) / 40.0, values, np.repeat([0, 1], 3), np.tile(np.arange(3), 2),
        free_level=True,
    )  # fmt: skip
    start = [first, 1 - first]
    found = likely_modes(gathered([given]), poles[start], SHAPES[:, start]).poles
    assert found[np.argsort(np.abs(found))] == pytest.approx(poles, rel=0.03)
