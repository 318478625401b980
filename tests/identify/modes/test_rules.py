"""The rules by which poles are taken for modes, each on numbers worked out by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import chdtri

from daq.channels import Channel, Quantity
from identify.modes import state_variable_method as stabilisation
from identify.modes.modal_likelihood import LikelyModes, Ties, unit_scale
from identify.modes.modal_model import ModalModel, mpc, pair_modes
from identify.modes.mode_selection import _numerical_rank, _worth_trying, clean_modes, vibrates
from identify.modes.shape_fit import ModalFit, gain_by_noise, project, without_each
from identify.modes.state_variable_method import (
    Delays,
    DelaySpace,
    Poles,
    StabilisationDiagram,
    _highest_frequency_hz,
    _products,
    _running_mean,
    checked_records,
    delay_space,
    diagram_of,
    layouts,
    realised_modes,
    seen_in,
    standing_out,
)
from identify.modes.vehicle_modes import mirror_of
from identify.modes.waves import Block, even_blocks

from ..structures import free_decay, oscillators

Array = NDArray[np.float64]


@pytest.mark.parametrize(
    ("strength", "n"),
    [
        ([10.0, 2.87, 1.0, 1.0, 1.0], 2),
        ([10.0, 2.858, 1.0, 1.0, 1.0], 1),
        ([10.0, 2.84, 1.0, 1.0, 1.0], 1),
        ([1.0, 1.1e-11, 1e-15, 1e-15, 1e-15], 2),
        ([1.0, 0.9e-11, 1e-15, 1e-15, 1e-15], 1),
    ],
)
def test_a_state_stands_out_from_noise_and_rounding(strength: list[float], n: int) -> None:
    assert standing_out(np.array(strength)) == n


def test_a_record_of_a_few_samples_is_realised_by_half_of_them() -> None:
    """Two states need two blocks at least; of 8 samples there are four and five columns."""
    pole = complex(-1.0, 30.0)
    record = np.exp(pole * np.arange(8) / 100.0).real[:, None]
    (found,) = realised_modes([record], 100.0, 2).poles
    assert found == pytest.approx(pole, rel=1e-9)


@pytest.mark.parametrize(
    ("strength", "rank"),
    [
        ([1.0, 1e-8, 0.9e-11], 2),
        ([1.0, 1e-8, 1.1e-11], None),
        ([1.0, 1e-8, 1e-11], None),
        ([1.0, 100 * 2.0**-40, 2.0**-40], None),
        ([1.0, 101 * 2.0**-40, 2.0**-40], 2),
        ([1.0, 1.01e-9, 1e-11 * 0.9999], 2),
        ([1.0, 0.99e-9, 1e-11 * 0.9999], None),
        ([1.0, 1e-3, 1e-13, 1e-14], 2),
        ([1.0, 1e-14], 1),
        ([1.0], None),
        ([4.0, 4e-12, 4e-16], 1),
    ],
)
def test_records_without_noise_drop_to_rounding(strength: list[float], rank: int | None) -> None:
    """By a factor above 100 to below 1e-11 of the largest."""
    assert _numerical_rank(np.array(strength)) == rank


def poles_of(*values: complex) -> Poles:
    return np.array(values, dtype=complex), np.ones((2, len(values)), dtype=complex)


def test_sets_of_poles_that_are_alike_or_small_are_not_tried() -> None:
    most = poles_of(10j, 20j, 30j, 40j)
    near, far = poles_of(10.029j, 20j, 30j, 40j), poles_of(10.031j, 20j, 30j, 40j)
    half, less = poles_of(10j, 20j), poles_of(10j)
    chosen = _worth_trying([most, near, far, half, less])
    assert [p.tolist() for p, _ in chosen] == [p.tolist() for p, _ in (most, far, half)]
    assert _worth_trying([]) == []


@pytest.mark.parametrize(("low", "highest_hz"), [(0.981, 7.0), (0.979, 23.0)])
def test_98_per_cent_of_the_energy_tell_what_matters(low: float, highest_hz: float) -> None:
    t = np.arange(1000) / 100.0
    wave = np.sqrt(low) * np.sin(2 * np.pi * 7.0 * t) + np.sqrt(1 - low) * np.sin(46 * np.pi * t)
    assert _highest_frequency_hz([wave[:, None] + 5.0], 100.0) == pytest.approx(highest_hz)
    assert _highest_frequency_hz([np.zeros((1000, 1))], 100.0) == pytest.approx(0.1)


def test_the_running_mean_of_three() -> None:
    record = np.array([[1.0, 0.0], [2.0, 0.0], [6.0, 3.0], [4.0, 9.0]])
    assert _running_mean(record, 3).tolist() == [[3.0, 1.0], [4.0, 4.0]]
    assert _running_mean(record, 1).tolist() == record.tolist()


@pytest.mark.parametrize(
    ("n", "channels", "chosen"),
    [
        (40, 1, [(10, 2), (5, 2), (20, 1), (10, 1)]),  # a sixteenth of the record goes before 20
        (8, 1, [(4, 1)]),
        (1600, 2, [(40, 20), (20, 20), (120, 1), (60, 1)]),
        (1600, 100, [(4, 20), (4, 1)]),
    ],
)
def test_layouts_of_delays(n: int, channels: int, chosen: list[tuple[int, int]]) -> None:
    """At 1 kHz and 5 Hz a step is 20 samples; a vector has 4 to 240 rows, or half a record."""
    t = np.arange(n) / 1000.0
    record = np.repeat(np.sin(2 * np.pi * 5.0 * t)[:, None], channels, axis=1)
    if n < 200:  # less than a period: its own bin is the lowest one
        record = np.repeat(np.cos(2 * np.pi * np.arange(n) / n)[:, None], channels, axis=1)
        assert _highest_frequency_hz([record], 1000.0) == pytest.approx(1000.0 / n)
    delays = layouts([record], 1000.0)
    assert [(d.blocks, d.step) for d in delays] == chosen


def test_delay_vectors_of_all_records_span_the_directions() -> None:
    """Steps of 2 in vectors of 3: a record of 6 samples has none, one of 9 has four."""
    rng = np.random.default_rng(4)
    long, short = rng.standard_normal((9, 2)), rng.standard_normal((6, 2))
    mean = (long[:-1] + long[1:]) / 2
    rows = np.array([np.concatenate([mean[i], mean[i + 2], mean[i + 4]]) for i in range(4)])
    space = delay_space([long, short], 10.0, Delays(3, 2))
    assert space.strength[:4] == pytest.approx(np.linalg.svd(rows, compute_uv=False))
    assert space.directions.shape == (6, 4)
    assert [c.shape[0] for c in space.coordinates] == [4]
    assert space.coordinates[0] @ space.directions.T == pytest.approx(rows)
    assert delay_space([long], 10.0, Delays(3, 1)).coordinates == ()


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
    ("strength", "highest"),
    [
        (np.array([9.0, 2.1, 2.0, *np.ones(27)]), 14),  # two above twice the median, and 12
        (np.array([9.0, 9.0, 9.0, *np.ones(7)]), 8),  # all but two
    ],
)
def test_ranks_go_twelve_beyond_what_stands_out(
    monkeypatch: pytest.MonkeyPatch, strength: Array, highest: int
) -> None:
    found = diagram(monkeypatch, dict.fromkeys(range(1, 40), (1j,)), strength)
    assert found.rank.tolist() == list(range(1, highest + 1))
    assert found.stable.tolist() == [True] * (highest - 2) + [False, False]


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


def test_stable_sets_are_in_order_of_frequency(monkeypatch: pytest.MonkeyPatch) -> None:
    poles = (-1 + 20j, -1 + 10j, 5 + 3j)
    found = diagram(monkeypatch, dict.fromkeys((2, 3, 4), poles), np.array([9.0, *np.ones(9)]))
    ((kept, shapes),) = found.stable_sets
    assert kept.tolist() == [-1 + 10j, -1 + 20j]
    assert shapes.shape == (1, 2)


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


def test_unit_scale_holds_unknowns_without_effect_still() -> None:
    assert unit_scale(np.diag([4.0, 0.0, 0.25])).tolist() == [0.5, 1.0, 2.0]


def _fit(
    records: list[NDArray[np.float64]],
    rate_hz: float,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
) -> ModalFit:
    (fit,) = project(records, rate_hz, poles).fits(np.arange(len(poles))[None], shapes)
    return fit


def test_without_modes_the_likelihood_is_that_of_white_noise() -> None:
    """Each channel of n samples of variance v has -n ln v, twice the logarithm."""
    records = [np.array([[1.0, 2.0], [1.0, -4.0]]), np.array([[-2.0, 1.0]])]
    fit = _fit(records, 10.0, np.zeros(0, complex), np.zeros((2, 0), complex))
    assert fit.merit == pytest.approx(-3 * (np.log(6 / 3) + np.log(21 / 3)))
    silent = [np.array([[0.0], [0.0]])]
    still = _fit(silent, 10.0, np.zeros(0, complex), np.zeros((1, 0), complex))
    assert still.merit == pytest.approx(-2 * np.log(1e-24))


def test_modes_leave_what_they_do_not_explain() -> None:
    """Two runs of one mode, and in one channel a sample that no such mode reaches."""
    pole = np.array([-1.0 + 20.0j])
    t = np.arange(40) / 100.0
    wave = np.exp(pole[0] * t)
    shape = np.array([1.0, 0.5 - 0.5j])
    records = [(a * wave[:, None] * shape).real for a in (1.0, 2j)]
    rng = np.random.default_rng(3)
    noise = [1e-3 * rng.standard_normal((40, 2)) for _ in records]
    noisy = [record + more for record, more in zip(records, noise, strict=True)]
    fit = _fit(noisy, 100.0, pole, np.ones((2, 1), complex))
    assert fit.shapes[1, 0] / fit.shapes[0, 0] == pytest.approx(shape[1], abs=2e-3)
    assert np.linalg.norm(fit.shapes) == pytest.approx(1.0)
    # By least squares of the whole: 2 channels of 80 samples, 2 unknowns for each but the scale.
    columns = np.column_stack([wave.real, -wave.imag])
    left = [np.linalg.lstsq(columns, record, rcond=None)[1] for record in noisy]
    power = np.sum(left, axis=0) / 80
    gain = chdtri(8, 1e-3 / 80)
    assert fit.merit == pytest.approx(-80 * np.sum(np.log(power)) - gain, abs=8.0)
    assert fit.merit < -80 * np.sum(np.log(power)) - gain


def test_records_of_one_length_share_a_block() -> None:
    records = [np.full((n, 2), float(number)) for number, n in enumerate((4, 3, 4))]
    short, long = even_blocks(records, 10.0)
    assert (short.run.tolist(), short.channel.tolist()) == ([1, 1], [0, 1])
    assert (long.run.tolist(), long.channel.tolist()) == ([0, 0, 2, 2], [0, 1, 0, 1])
    assert long.values[0].tolist() == [0.0, 0.0, 2.0, 2.0]
    assert long.time_s.tolist() == [0.0, 0.1, 0.2, pytest.approx(0.3)]
    assert not long.free_level
    run = np.zeros(1, np.intp)
    level = Block(np.arange(3.0), np.array([[1.0], [2.0], [6.0]]), run, run, free_level=True)
    assert level.deviations.tolist() == [[-2.0], [-1.0], [3.0]]


@pytest.mark.parametrize("step", [1, 3])
def test_products_along_the_diagonal_are_those_of_the_delay_vectors(step: int) -> None:
    rng = np.random.default_rng(1)
    records, delays = [rng.standard_normal((n, 3)) for n in (60, 75)], Delays(5, step)
    tables = []
    for record in records:
        starts = range(len(record) - 4 * step)
        rows = [[record[k + step * block] for block in range(5)] for k in starts]
        tables.append(np.reshape(rows, (len(starts), 15)))
    whole = sum((table.T @ table for table in tables), np.zeros((15, 15)))
    upper = np.triu(np.ones((15, 15), dtype=bool))
    assert _products(records, delays)[upper] == pytest.approx(whole[upper], rel=1e-12, abs=1e-12)


def test_sets_that_are_fitted_at_once_are_fitted_as_each_alone() -> None:
    rng = np.random.default_rng(2)
    poles = np.array([-1.0 + 20.0j, -2.0 + 31.0j, -5.0])
    wave = np.exp(np.outer(np.arange(80) / 100.0, poles))
    shapes = rng.standard_normal((4, 3)) + 1j * rng.standard_normal((4, 3))
    shapes[:, 2] = shapes[:, 2].real
    records = []
    for length in (80, 80, 60):
        clean = (wave[:length] @ (shapes * rng.standard_normal(3)).T).real
        records.append(clean + 0.01 * rng.standard_normal((length, 4)))
    whole = project(records, 100.0, poles)
    sets = without_each(np.arange(3))
    assert sets.tolist() == [[1, 2], [0, 2], [0, 1]]
    bounds = whole.merits_without(np.arange(3))
    for chosen, found, bound in zip(sets, whole.fits(sets, shapes, 4), bounds, strict=True):
        (alone,) = whole.fits(chosen[None], shapes, 4)
        assert found.merit == pytest.approx(alone.merit, rel=1e-9)
        assert found.shapes == pytest.approx(alone.shapes, rel=1e-6)
        assert project(records, 100.0, poles[chosen]).most_merit == pytest.approx(bound, abs=0.05)
        assert found.merit < bound


def test_a_block_of_series_cannot_be_changed() -> None:
    run = np.zeros(1, dtype=int)
    block = Block(np.arange(3.0), np.array([[1.0], [2.0], [6.0]]), run, run, free_level=True)
    for array in (block.time_s, block.values, block.run, block.channel, block.deviations):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0


# The limits of the choice of modes, each from both sides, as numbers ------------------------------


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
