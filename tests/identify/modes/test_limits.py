"""The limits of the choice of modes, each from both sides, as numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import chdtri

from daq.channels import Channel, Quantity
from identify.modes.modal_model import ModalModel, mpc, pair_modes
from identify.modes.mode_selection import clean_modes, vibrates
from identify.modes.shape_fit import gain_by_noise, project
from identify.modes.state_variable_method import (
    Delays,
    DelaySpace,
    checked_records,
    delay_space,
    layouts,
    seen_in,
)
from identify.modes.vehicle_modes import mirror_of

from ..structures import free_decay, oscillators


@pytest.mark.parametrize(("damping", "vibrating"), [(0.979, True), (0.981, False), (-0.1, True)])
def test_a_mode_has_less_than_98_per_cent_of_critical_damping(
    damping: float, vibrating: bool
) -> None:
    pole = oscillators([2.0], [damping])
    assert vibrates(pole).tolist() == [vibrating]
    assert vibrates(pole.conj()).tolist() == [False]  # one of a pair stands for both
    assert vibrates(pole.real.astype(complex)).tolist() == [False]


@pytest.mark.parametrize(("gap_m", "image"), [(0.0049, [1, 0]), (0.0051, [-1, -1])])
def test_mirrored_places_agree_to_5_mm(gap_m: float, image: list[int]) -> None:
    left = Channel("left", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.0, y_m=0.5)
    right = Channel("right", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.0 + gap_m, y_m=-0.5)
    assert list(mirror_of((left, right)).image) == image


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


def test_the_gain_by_noise_is_that_of_chi_squared() -> None:
    """Two pairs and a real pole, three channels and two records of 500 samples in all."""
    poles = np.array([-1.0 + 5.0j, -1.0 + 9.0j, -3.0 + 0j])
    expected = 2.0 * chdtri(10, 1e-3 / 500) + chdtri(5, 1e-3 / 500)
    assert gain_by_noise(poles, 3, 2, 500) == pytest.approx(expected, rel=1e-9)


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


def test_shapes_are_found_from_afar_as_from_the_truth() -> None:
    """Two near modes in three channels: one alternation from equal shapes is far from enough."""
    rng = np.random.default_rng(2)
    poles = np.array([-1.0 + 20.0j, -2.0 + 23.0j])
    wave = np.exp(np.outer(np.arange(120) / 100.0, poles))
    true = np.array([[1.0, 1.0], [0.5j, -1.0], [-0.3, 0.8j]], dtype=np.complex128)
    records = [
        (wave @ (true * amplitudes).T).real + 0.01 * rng.standard_normal((120, 3))
        for amplitudes in ([1.0, 0.2], [0.3, 1.0], [1j, 1.0])
    ]
    given, sets = project(records, 100.0, poles), np.arange(2)[None]
    afar = np.array(1.0 + 0.3 * rng.standard_normal((3, 2)), dtype=np.complex128)
    (once,), (found,) = given.fits(sets, afar, 1), given.fits(sets, afar)
    (near,) = given.fits(sets, true)
    assert once.merit < near.merit - 1000.0
    assert found.merit == pytest.approx(near.merit, abs=0.1)
    assert near.merit < given.most_merit


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
