"""A structure that is struck many times: close modes are held apart, copies of one are merged."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.modes.modal_likelihood import Ties, gathered, likelihood_near
from identify.modes.modal_model import ModalModel, originals
from identify.modes.mode_selection import identify_modes
from identify.modes.waves import even_blocks, likelihood_at_most

from ..structures import CLOSE_PAIR_HZ, struck_frame

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


def no_copies(found: ModalModel, poles: NDArray[np.complex128]) -> bool:
    """Return whether no true mode but the close pair is near to two that were found."""
    truth = np.abs(poles) / (2.0 * np.pi)
    near = np.abs(found.frequencies_hz[:, None] / truth - 1.0) < 0.005
    alone = np.abs(truth - np.mean(CLOSE_PAIR_HZ)) > 1.0
    return bool(np.all(near.sum(axis=0)[alone] <= 1) and np.all(near.sum(axis=0)[~alone] <= 2))


SHAPE = np.array([1.0, 1.0, 1.0], dtype=complex)


def turned(mac_value: float) -> NDArray[np.complex128]:
    """Return a shape of given MAC with SHAPE."""
    across = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    shape = np.sqrt(mac_value) * SHAPE / np.sqrt(3.0) + np.sqrt(1.0 - mac_value) * across
    return np.asarray(shape, dtype=np.complex128)


@pytest.mark.parametrize(
    ("apart", "alike", "left"),
    [(0.019, 0.981, 1), (0.021, 0.981, 2), (0.019, 0.979, 2)],
)
def test_a_copy_is_near_and_of_the_same_shape(apart: float, alike: float, left: int) -> None:
    poles = np.array([100j - 1.0, (100j - 1.0) * (1.0 + apart)])
    shapes = np.column_stack([SHAPE, turned(alike)])
    assert len(originals(poles, shapes)) == left
    assert len(originals(poles, shapes[:1])) == 2  # one channel shows no shape


def test_of_copies_the_strongest_stays() -> None:
    poles, shapes = np.array([100j - 1.0, 100.1j - 1.0]), np.column_stack([SHAPE, SHAPE])
    for strong in (0, 1):
        amplitudes = np.where(np.arange(2) == strong, 2.0, 1.0)[None].astype(complex)
        assert originals(poles, shapes, amplitudes).tolist() == [strong]


def test_real_poles_are_no_copies() -> None:
    poles = np.array([-1.0, -1.001], dtype=complex)
    assert len(originals(poles, np.column_stack([SHAPE, SHAPE]))) == 2


def test_the_bound_is_that_of_amplitudes_free_in_every_series() -> None:
    """By plain least squares of each series; a fit with shapes stays below it."""
    records, poles = struck_frame(4, 5, 1, n_samples=256)
    blocks, shapes = even_blocks(records, RATE_HZ), np.ones((3, 4), dtype=complex)
    bound = likelihood_at_most(blocks, poles, 3)
    for leave in range(4):
        left = np.delete(np.arange(4), leave)
        wave = np.exp(np.outer(np.arange(256) / RATE_HZ, poles[left]))
        table = np.hstack([wave.real, wave.imag])
        squares = np.sum([np.linalg.lstsq(table, r, rcond=None)[1] for r in records], axis=0)
        free = -5 * 256 * np.sum(np.log(squares / (5 * 256)))
        assert bound[leave] == pytest.approx(free, abs=0.02)
        assert (
            likelihood_near(gathered(blocks), poles[left], shapes[:, left], Ties.none(3, 3)) < free
        )


def test_without_amplitudes_the_copy_of_the_lowest_damping_stays() -> None:
    shapes = np.column_stack([SHAPE, SHAPE])
    assert originals(np.array([100j - 1.0, 100.1j - 2.0]), shapes).tolist() == [0]
    assert originals(np.array([100j - 2.0, 100.1j - 1.0]), shapes).tolist() == [1]
    assert originals(np.array([100j - 1.0, 100.1j]), shapes).tolist() == [1]


@pytest.mark.parametrize(
    ("size", "runs", "damping", "strongest"),
    [
        ((1.0, 1.0), ((3.0, 2.0), (0.0, 2.0)), (1.0, 1.0), 0),  # 9 over 8
        ((1.0, 1.0), ((2.5, 2.0), (0.0, 2.0)), (1.0, 1.0), 1),  # 6.25 under 8
        ((2.0, 1.0), ((1.0, 1.9),), (1.0, 1.0), 0),  # 4 over 3.6
        ((2.0, 1.0), ((1.0, 2.1),), (1.0, 1.0), 1),
        ((1.0, 1.0), ((2.0, 1.0),), (0.39, 0.1), 0),  # energy is amplitude squared over damping
        ((1.0, 1.0), ((2.0, 1.0),), (0.41, 0.1), 1),
    ],
)
def test_the_strongest_copy_has_the_most_energy_in_all_runs_together(
    size: tuple[float, float],
    runs: tuple[tuple[float, float], ...],
    damping: tuple[float, float],
    strongest: int,
) -> None:
    poles = np.array([100j - damping[0], 100.1j - damping[1]])
    shapes = np.column_stack([SHAPE, SHAPE]) * np.array(size, dtype=complex)
    assert originals(poles, shapes, np.array(runs, dtype=complex)).tolist() == [strongest]


def test_what_is_near_a_copy_only_is_none() -> None:
    """Of three poles 1.5 % apart the outer two are not near each other: the middle one goes."""
    poles = np.array([101.5j - 2.0, 103j - 1.0, 100j - 1.0])
    assert originals(poles, np.column_stack([SHAPE] * 3)).tolist() == [1, 2]


def test_nearness_counts_from_the_larger_of_two_poles() -> None:
    """2.02 % of the smaller one are 1.98 % of the larger one."""
    poles = np.array([100j - 1.0, 102.02j - 1.0])
    for order in ([0, 1], [1, 0]):
        assert len(originals(poles[order], np.column_stack([SHAPE, SHAPE]))) == 1


def test_two_channels_show_a_shape() -> None:
    poles = np.array([100j - 1.0, 100.1j - 2.0])
    assert originals(poles, np.ones((2, 2), dtype=complex)).tolist() == [0]


def test_poles_that_are_two_per_cent_apart_are_two() -> None:
    assert len(originals(np.array([98j, 100j]), np.column_stack([SHAPE, SHAPE]))) == 2
    assert len(originals(np.array([98.01j, 100j]), np.column_stack([SHAPE, SHAPE]))) == 1
