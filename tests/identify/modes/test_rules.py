"""The rules by which poles are taken for modes, each on numbers worked out by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.modes import state_variable_method as stabilisation
from identify.modes.modal_likelihood import LikelyModes, Ties
from identify.modes.modal_model import ModalModel, mpc, pair_modes
from identify.modes.mode_selection import clean_modes, vibrates
from identify.modes.state_variable_method import (
    Delays,
    DelaySpace,
    StabilisationDiagram,
    checked_records,
    delay_space,
    diagram_of,
    layouts,
    realised_modes,
    seen_in,
)

from ..structures import free_decay, oscillators

Array = NDArray[np.float64]


def test_a_record_of_a_few_samples_is_realised_by_half_of_them() -> None:
    """Two states need two blocks at least; of 8 samples there are four and five columns."""
    pole = complex(-1.0, 30.0)
    record = np.exp(pole * np.arange(8) / 100.0).real[:, None]
    (found,) = realised_modes([record], 100.0, 2).poles
    assert found == pytest.approx(pole, rel=1e-9)


def diagram(
    monkeypatch: pytest.MonkeyPatch, ranks: Mapping[int, tuple[complex, ...]], strength: Array,
    duration_s: float = 1.0,
) -> StabilisationDiagram:  # fmt: skip
    """Return the diagram of poles that are given for each rank, one channel."""
    monkeypatch.setattr(
        stabilisation,
        "poles_of_rank",
        lambda space, rank: (
            np.array(ranks.get(rank, ()), dtype=complex),
            np.ones((1, len(ranks.get(rank, ()))), dtype=complex),
        ),
    )
    n = len(strength)
    space = DelaySpace(Delays(n, 1), 100.0, np.eye(n), strength, (), 1)
    return diagram_of(space, duration_s)


@pytest.mark.parametrize(
    ("first", "again", "duration_s", "stable"),
    [
        (-1 + 10j, -1 + 10.49j, 1.0, True),
        (-1 + 10j, -1 + 10.52j, 1.0, False),
        (-1e-3 + 0.1j, -1e-3 + 0.149j, 1.0, True),  # 5 % of 1 / duration
        (-1e-3 + 0.1j, -1e-3 + 0.151j, 1.0, False),
        (-1e-3 + 0.1j, -1e-3 + 0.124j, 2.0, True),
        (-1e-3 + 0.1j, -1e-3 + 0.126j, 2.0, False),
        (0.24 + 10j, 0.24 + 10j, 2.0, True),  # grows by half a neper
        (0.25 + 10j, 0.25 + 10j, 2.0, False),
        (0.26 + 10j, 0.26 + 10j, 2.0, False),
        (-3 + 0j, -3 + 0j, 1.0, True),
    ],
)
def test_a_pole_is_stable_that_comes_again_at_two_ranks(
    monkeypatch: pytest.MonkeyPatch,
    first: complex,
    again: complex,
    duration_s: float,
    stable: bool,
) -> None:
    strength = np.array([9.0, 9.0, 9.0, *np.ones(7)])
    for second, third, is_stable in ((again, first, stable), (first, again, stable)):
        ranks = {3: (first, first.conjugate()), 4: (second,), 5: (third,)}
        found = diagram(monkeypatch, ranks, strength, duration_s)
        twice = 2 if first.imag == 0.0 else 1  # a real pole is its own conjugate
        assert found.rank.tolist() == [3] * twice + [4, 5]
        assert found.stable.tolist() == [is_stable] * twice + [False, False]
        assert len(found.stable_sets) == is_stable


def test_a_modal_model_is_sorted_and_scaled() -> None:
    poles = np.array([-1 + 20j, -3 + 4j])
    model = ModalModel(poles, np.array([[2j, 1.0], [1.0, -4.0]]), np.array([0.2, 0.5]))
    assert model.poles.tolist() == [-3 + 4j, -1 + 20j]
    assert model.shapes.tolist() == [[-0.25, 1.0], [1.0, -0.5j]]
    assert model.frequency_std_hz.tolist() == [0.5, 0.2]
    assert np.isnan(model.damping_ratio_std).tolist() == [True, True]
    assert model.damping_ratios[0] == pytest.approx(0.6)
    assert model.frequencies_hz[0] == pytest.approx(5.0 / (2 * np.pi))
    near = ModalModel(poles[:1], np.array([[1.0 + 0j], [-1.0 - 0.9e-6], [1.1e-6]]))
    assert near.shapes[0, 0] == 1.0
    far = ModalModel(poles[:1], np.array([[1.0 + 0j], [-1.0 - 1.1e-6]]))
    assert far.shapes[1, 0] == 1.0
    with pytest.raises(ValueError, match="do not fit"):
        ModalModel(poles, np.ones((2, 3), complex))
    with pytest.raises(ValueError, match="do not fit"):
        ModalModel(poles, np.ones(2, complex))


def test_deviations_of_frequency_and_damping_follow_from_those_of_the_pole() -> None:
    """Of -3 + 4j: d|p| = (-3 dx + 4 dy) / 5, and d(-x / |p|) = -(16 dx + 12 dy) / 125."""
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    modes = LikelyModes(
        np.array([-3 + 4j]), np.ones((1, 1), complex), np.ones((1, 1), complex),
        Ties.none(1, 1), covariance, np.ones(1), 0.0, 4,
    )  # fmt: skip
    frequency = (9 * 0.04 + 16 * 0.09 - 2 * 12 * 0.01) / 25
    damping = (256 * 0.04 + 144 * 0.09 + 2 * 192 * 0.01) / 125**2
    assert modes.frequency_std_hz == pytest.approx([np.sqrt(frequency) / (2 * np.pi)])
    assert modes.damping_ratio_std == pytest.approx([np.sqrt(damping)])


# The limits of the choice of modes, each from both sides, as numbers ------------------------------


@pytest.mark.parametrize(("damping", "vibrating"), [(0.979, True), (0.981, False), (-0.1, True)])
def test_a_mode_has_less_than_98_per_cent_of_critical_damping(
    damping: float, vibrating: bool
) -> None:
    pole = oscillators([2.0], [damping])
    assert vibrates(pole).tolist() == [vibrating]
    assert vibrates(pole.conj()).tolist() == [False]  # one of a pair stands for both
    assert vibrates(pole.real.astype(complex)).tolist() == [False]


@pytest.mark.parametrize(("likeness", "again"), [(0.91, True), (0.89, False)])
@pytest.mark.parametrize(("off", "near"), [(0.9, True), (1.0, False), (1.1, False)])
def test_a_pole_comes_again_with_pole_and_shape(
    likeness: float, again: bool, off: float, near: bool
) -> None:
    turn = np.arccos(np.sqrt(likeness))
    pole = np.array([-1.0 + 10.0j])
    first = (pole, np.array([[1.0 + 0j], [0.0]]))
    other = (pole + 1j * off, np.array([[np.cos(turn) + 0j], [np.sin(turn)]]))
    assert seen_in(first, other, np.array([1.0])).tolist() == [again and near]


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 90.0])
def test_collinearity_of_two_equal_entries_is_the_square_of_the_cosine(degrees: float) -> None:
    phase = np.radians(degrees)
    shape = np.array([[1.0 + 0j], [np.exp(1j * phase)]])
    assert mpc(shape)[0] == pytest.approx(np.cos(phase) ** 2, abs=1e-12)


def test_the_margin_of_a_pair_is_to_the_nearest_third() -> None:
    """Shapes in a plane at 0 and 60 degrees, and at 10 and 90: MAC is the cosine squared."""

    def at(*degrees: float) -> ModalModel:
        angle = np.radians(degrees)
        poles = np.array([complex(-1.0, 10.0 + k) for k in range(len(degrees))])
        return ModalModel(poles, np.array([np.cos(angle), np.sin(angle)], dtype=complex))

    pairing = pair_modes(at(0.0, 60.0), at(10.0, 90.0))
    of_10, of_30, of_50 = np.cos(np.radians([10.0, 30.0, 50.0])) ** 2
    assert pairing.mac == pytest.approx([of_10, of_30])
    assert pairing.margin == pytest.approx([of_10 - of_50, of_30 - of_50])
    assert pairing.swapped == ()


@pytest.mark.parametrize(("n", "fine"), [(7, False), (8, True)])
def test_eight_samples_are_a_record(n: int, fine: bool) -> None:
    record = np.arange(2.0 * n).reshape(n, 2)
    if fine:
        assert len(checked_records([record], 10.0)) == 1
    else:
        with pytest.raises(ValueError, match=f"record 1 has {n} samples"):
            checked_records([record], 10.0)


@pytest.mark.parametrize(("noise", "clean"), [(0.0, True), (1e-13, True), (1e-8, False)])
def test_noise_above_rounding_is_noise(noise: float, clean: bool) -> None:
    rng = np.random.default_rng(0)
    record = free_decay(oscillators([2.0], [0.1]), np.ones((1, 1)), np.array([1.0]), 50.0, 4.0)
    record = record + noise * rng.standard_normal(record.shape)
    found = clean_modes([delay_space([record], 50.0, Delays(8, 1))])
    assert (found is not None) is clean


def test_delays_step_by_a_tenth_of_the_fastest_period_that_matters() -> None:
    """At 1 kHz, 5 Hz is 200 samples a period; half of 3 s holds 75 steps of 20."""
    record = free_decay(oscillators([5.0], [0.0]), np.ones((1, 1)), np.array([1.0]), 1000.0, 3.0)
    chosen = layouts([record[:3000]], 1000.0)
    assert [(d.blocks, d.step) for d in chosen] == [(75, 20), (37, 20), (240, 1), (120, 1)]


def of_pole(pole: complex, more: tuple[complex, ...] = ()) -> DelaySpace:
    """Return the delay vectors of a decay without noise, of one pole and perhaps some more."""
    poles = np.array([pole, *more])
    record = free_decay(poles, np.ones((1, len(poles))), np.ones(len(poles)), 50.0, 2.0)
    return delay_space([record], 50.0, Delays(10, 1))


@pytest.mark.parametrize(("off", "n"), [(0.9e-4, 1), (1.1e-4, 0), (-0.9e-4, 1), (-1.1e-4, 0)])
def test_a_mode_without_noise_comes_again_within_1e_4_in_another_layout(off: float, n: int) -> None:
    pole = -0.5 + 12.0j
    found = clean_modes([of_pole(pole), of_pole(pole * (1.0 + off))])
    assert found is not None
    assert len(found) == n
    alone = clean_modes([of_pole(pole)])
    assert alone is not None
    assert alone.poles == pytest.approx([pole], rel=1e-8)


def test_modes_without_noise_are_those_of_the_layout_that_shows_most() -> None:
    one, other = -0.5 + 12.0j, -1.0 + 40.0j
    for spaces in ([of_pole(one), of_pole(one, (other,))], [of_pole(other, (one,)), of_pole(one)]):
        found = clean_modes(spaces)
        assert found is not None
        assert found.poles == pytest.approx([one], rel=1e-6)
    both = clean_modes([of_pole(one), of_pole(one, (other,)), of_pole(other)])
    assert both is not None
    assert both.poles == pytest.approx([one, other], rel=1e-6)
