"""Modes from free decays of structures whose poles are known in closed form."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA
from dbc.words import InputError
from identify.model.matrices import PhysicalModel, physical_model
from identify.model.response import Bump, exact_response
from identify.modes import state_variable_method as module
from identify.modes.modal_model import ModalModel, mac, modes_of
from identify.modes.mode_selection import clean_modes, identify_modes
from identify.modes.state_variable_method import (
    Delays,
    DelaySpace,
    StabilisationDiagram,
    delay_space,
    diagram_of,
    layouts,
    poles_of_rank,
    realised_modes,
    seen_in,
    stabilisation_diagram,
)

from ..structures import (
    chain_poles,
    chain_shapes,
    free_decay,
    oscillators,
    random_amplitudes,
    with_noise,
)

PAPER_RUNS = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
BASELINE = physical_model(FORD_GRANADA)
ADDED = BASELINE.with_mass(np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]))
# docs/method.md, "The vehicle": Hz and damping ratio, computed with another program.
PUBLISHED_BASELINE = [
    (1.0511, 0.2663),
    (1.3078, 0.2502),
    (1.6516, 0.3596),
    (10.7678, 0.2541),
    (10.7712, 0.2506),
    (11.2859, 0.2600),
    (11.2881, 0.2651),
]
PUBLISHED_ADDED = [
    (1.0021, 0.2540),
    (1.2456, 0.2383),
    (1.5664, 0.3412),
    (10.2375, 0.2377),
    (10.2395, 0.2399),
    (10.7774, 0.2489),
    (10.7818, 0.2526),
]


def decays(
    model: PhysicalModel, rate_hz: float, quantity: str = "acceleration"
) -> list[NDArray[np.float64]]:
    bump = Bump()
    responses = [exact_response(model, run, bump, rate_hz, 3.0) for run in PAPER_RUNS]
    return [getattr(r, quantity)[r.time_s > bump.end_s - 0.5 / rate_hz] for r in responses]


def assert_poles(found: ModalModel, poles: NDArray[np.complex128], rtol: float) -> None:
    assert len(found) == len(poles)
    order = np.argsort(np.abs(poles))
    np.testing.assert_array_less(np.abs(found.poles / poles[order] - 1.0), rtol)


@pytest.mark.parametrize(
    ("model", "published", "rate_hz"),
    [(BASELINE, PUBLISHED_BASELINE, 100.0), (ADDED, PUBLISHED_ADDED, 1000.0)],
    ids=["baseline", "added"],
)
def test_the_vehicle_without_noise(
    model: PhysicalModel, published: list[tuple[float, float]], rate_hz: float
) -> None:
    found = identify_modes(decays(model, rate_hz), rate_hz)
    truth = modes_of(model.A)
    assert_poles(found, truth.poles, 1e-10)
    rounded = np.round(np.transpose([found.frequencies_hz, found.damping_ratios]), 4)
    np.testing.assert_allclose(rounded, published, atol=1.01e-4)
    likeness = np.diag(mac(found.shapes / found.poles**2, truth.shapes))
    assert likeness.min() > 1.0 - 1e-9


@pytest.mark.parametrize("zeta", [0.0, 0.02, 0.9])
def test_one_channel_with_one_mode(zeta: float) -> None:
    pole = oscillators([2.0], [zeta])
    record = free_decay(pole, np.ones((1, 1)), np.array([1.0 + 1.0j]), 100.0, 2.0)
    assert_poles(identify_modes([record], 100.0), pole, 1e-9)


def test_five_masses_and_records_of_different_lengths() -> None:
    rng = np.random.default_rng(0)
    poles, shapes = chain_poles(5, k=400.0, c=0.4, m=1.0), chain_shapes(5)
    records = [
        free_decay(poles, shapes, random_amplitudes(5, rng), 50.0, duration_s)
        for duration_s in (10.0, 4.0, 0.4)
    ]
    found = identify_modes(records, 50.0)
    assert_poles(found, poles, 1e-9)
    assert np.diag(mac(found.shapes, shapes.astype(complex))).min() > 1.0 - 1e-9


def test_units_of_the_channels_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    poles, unit = chain_poles(3, k=400.0, c=4.0, m=1.0), np.array([1e-6, 1.0, 1e5])
    record = free_decay(poles, chain_shapes(3), random_amplitudes(3, rng), 50.0, 10.0)
    record = with_noise(record, 50.0, rng)
    plain, scaled = identify_modes([record], 50.0), identify_modes([record * unit], 50.0)
    assert_poles(scaled, plain.poles, 1e-8)  # where the search ends; an interval is 1e5 wider
    assert np.diag(mac(scaled.shapes / unit[:, None], plain.shapes)).min() > 1.0 - 1e-9


def test_a_motion_slow_against_the_sampling() -> None:
    """20000 samples at 1 kHz, 0.5 and 0.7 Hz: delays of one sample would hardly differ."""
    poles = oscillators([0.5, 0.7], [0.02, 0.03])
    record = free_decay(poles, np.ones((1, 2)), np.array([1.0, 1.0]), 1000.0, 20.0)
    rng = np.random.default_rng(0)
    assert_poles(identify_modes([with_noise(record, 40.0, rng)], 1000.0), poles, 1e-2)


def test_a_weak_fast_mode_beside_a_slow_one_is_not_folded() -> None:
    """Delays of several samples leave its frequency open by multiples of their rate."""
    poles = oscillators([1.0, 170.0], [0.01, 0.0006])
    record = free_decay(poles, np.ones((1, 2)), np.array([1.0, 0.01]), 1000.0, 4.0)
    assert_poles(identify_modes([record], 1000.0), poles, 1e-7)


def test_an_offset_and_a_slow_drift_are_no_modes() -> None:
    rng = np.random.default_rng(3)
    poles = chain_poles(2, k=100.0, c=1.0, m=1.0)
    record = free_decay(poles, chain_shapes(2), np.array([1.0, 1.0]), 50.0, 6.0)
    time = np.arange(len(record)) / 50.0
    record += 0.3 + 0.5 * np.exp(-time / 3.0)[:, None] * [1.0, -0.4]
    assert_poles(identify_modes([record], 50.0), poles, 1e-6)
    found = identify_modes([with_noise(record, 40.0, rng)], 50.0)
    assert_poles(found, poles, 0.05)


def test_a_linear_drift_is_no_mode_that_grows() -> None:
    poles = oscillators([2.0], [0.05])
    noise = 0.005 * np.random.default_rng(0).standard_normal((500, 2))
    record = free_decay(poles, np.array([[1.0], [0.5]]), np.ones(1), 100.0, 5.0) + noise
    record += 0.05 * np.arange(500)[:, None] / 100.0
    for records in ([record], [record, 0.7 * record]):
        assert_poles(identify_modes(records, 100.0), poles, 0.01)


@pytest.mark.parametrize("n_records", [1, 2])
def test_the_count_is_right_at_40_db(n_records: int) -> None:
    poles, shapes = chain_poles(3, k=1000.0, c=1.0, m=1.0), chain_shapes(3)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        records = [
            with_noise(free_decay(poles, shapes, random_amplitudes(3, rng), 50.0, 8.0), 40.0, rng)
            for _ in range(n_records)
        ]
        found = identify_modes(records, 50.0)
        assert_poles(found, poles, 0.01)
        assert np.diag(mac(found.shapes, shapes.astype(complex))).min() > 0.99


def test_noise_alone_has_no_modes() -> None:
    for seed in range(4):
        noise = np.random.default_rng(seed).standard_normal((300, 1 + seed % 3))
        assert len(identify_modes([noise], 100.0)) == 0


def test_a_still_structure_has_no_modes() -> None:
    assert len(identify_modes([np.zeros((50, 3))], 100.0)) == 0
    assert len(identify_modes([np.ones((50, 3))], 100.0)) == 0


@pytest.mark.parametrize("held", [0.0, 1e-3, 9.81])
@pytest.mark.parametrize(("sigma", "tolerance"), [(0.0, 1e-9), (1e-3, 0.02)])
def test_a_silent_or_stuck_channel_has_no_part_in_the_shapes(
    held: float, sigma: float, tolerance: float
) -> None:
    poles = chain_poles(2, k=100.0, c=1.0, m=1.0)
    record = free_decay(poles, chain_shapes(2), np.array([1.0, 1.0]), 100.0, 4.0)
    record = record + sigma * np.random.default_rng(3).standard_normal(record.shape)
    found = identify_modes([np.column_stack([record, np.full(len(record), held)])], 100.0)
    assert_poles(found, poles, tolerance)
    assert not np.any(found.shapes[2])


GOOD = np.random.default_rng(0).standard_normal((50, 2))


@pytest.mark.parametrize(
    ("records", "rate_hz", "message"),
    [
        ([], 100.0, "there is no record"),
        ([GOOD, GOOD[:, :1]], 100.0, "record 2 has 1 channels, record 1 has 2"),
        ([GOOD[:7]], 100.0, "record 1 has 7 samples"),
        ([np.where(GOOD > 2.0, np.nan, GOOD)], 100.0, "not finite"),
        ([GOOD], 0.0, "rate is 0.0 Hz"),
        ([GOOD], float("nan"), "rate is nan Hz"),
        ([GOOD[:, 0]], 100.0, "record 1 is no"),
        ([GOOD + 1j], 100.0, "record 1 is no"),
        ([np.zeros((50, 0))], 100.0, "record 1 is no"),
        ([[["a", "b"]] * 50], 100.0, "record 1 is no"),
        ([[[1.0, 2.0], [3.0]] * 10], 100.0, "record 1 is no"),  # ragged
    ],
)
def test_bad_records_are_refused_in_one_line(
    records: list[NDArray[np.float64]], rate_hz: float, message: str
) -> None:
    with pytest.raises(InputError, match=message) as error:
        identify_modes(records, rate_hz)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("step", [4, 7])
def test_a_mode_that_turns_by_more_than_half_between_delays_keeps_its_frequency(step: int) -> None:
    """At 100 Hz, 2, 18 and 31 Hz turn by 0.08, 0.72 and 1.24 in four samples."""
    poles = oscillators([2.0, 18.0, 31.0], [0.02, 0.01, 0.01])
    shapes = np.array([[1.0, 1.0, 1.0], [1.0, -0.5, 0.3]])
    record = free_decay(poles, shapes, np.array([1.0, 0.8j, 0.9]), 100.0, 3.0)
    space = delay_space([record], 100.0, Delays(10, step))
    found, _ = poles_of_rank(space, 6)
    found = found[found.imag > 0.0]
    found = found[np.argsort(np.abs(found))]
    np.testing.assert_allclose(found, poles, rtol=1e-6)


# Eigensystem realisation and stabilisation diagram, beside the closed form ------------------------

POLES, SHAPES = chain_poles(3, k=400.0, c=4.0, m=1.0), chain_shapes(3)


def test_a_chain_of_masses_in_two_runs_of_different_lengths() -> None:
    rng = np.random.default_rng(0)
    records = [
        free_decay(POLES, SHAPES, random_amplitudes(3, rng), 50.0, duration_s)
        for duration_s in (6.0, 4.0)
    ]
    found = realised_modes(records, 50.0)
    assert np.abs(found.poles / POLES - 1.0).max() < 1e-9
    assert np.diag(mac(found.shapes, SHAPES.astype(complex))).min() > 1.0 - 1e-9


@pytest.mark.parametrize("order", [None, 6])
def test_noise_and_units_are_borne(order: int | None) -> None:
    rng = np.random.default_rng(1)
    record = free_decay(POLES, SHAPES, random_amplitudes(3, rng), 50.0, 8.0)
    record = with_noise(record, 50.0, rng) * [1.0, 1e4, 1e-3]
    found = realised_modes([record], 50.0, order)
    assert len(found) == 3
    assert np.abs(found.poles / POLES - 1.0).max() < 0.01
    for more in (-1, 34):  # 12 delays of three channels: 11 of them are regressed on 11
        with pytest.raises(InputError, match=f"order is {more} .give 1 to 33"):
            realised_modes([record], 50.0, more)


def test_a_channel_without_a_signal_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    record = free_decay(POLES, SHAPES, random_amplitudes(3, rng), 50.0, 6.0)
    silent = np.column_stack([record, np.zeros(len(record))])
    found = realised_modes([silent], 50.0)
    assert np.abs(found.poles / POLES - 1.0).max() < 1e-9
    assert np.all(np.abs(found.shapes[3]) < 1e-9 * np.abs(found.shapes[:3]).max(axis=0))
    noisy = with_noise(record, 60.0, rng)
    alone = stabilisation_diagram([noisy], 50.0)
    beside = stabilisation_diagram([np.column_stack([noisy, np.zeros(len(noisy))])], 50.0)
    assert np.all(np.isfinite(beside.shapes))
    for poles in (alone.poles, beside.poles):
        near = np.abs(poles[:, None] / POLES - 1.0).min(axis=0)
        assert near.max() < 0.01


def test_the_diagram_marks_what_comes_again() -> None:
    rng = np.random.default_rng(2)
    record = with_noise(free_decay(POLES, SHAPES, random_amplitudes(3, rng), 50.0, 8.0), 40.0, rng)
    diagram = stabilisation_diagram([record * [1.0, 1.0, 100.0]], 50.0)
    near = np.abs(diagram.poles[:, None] / POLES - 1.0).min(axis=1) < 0.05
    high = diagram.rank >= 8
    assert np.all(diagram.stable[near & high & (diagram.rank <= diagram.rank.max() - 2)])
    assert np.mean(diagram.stable[~near & high]) < 0.5
    assert not np.any(diagram.stable[diagram.rank > diagram.rank.max() - 2])
    best = diagram.shapes[:, near & high] / np.array([[1.0], [1.0], [100.0]])
    assert np.all(mac(best, SHAPES.astype(complex)).max(axis=1) > 0.98)


# The limits of the choice of poles, each from both sides ------------------------------------------


def diagram(
    monkeypatch: pytest.MonkeyPatch,
    ranks: Mapping[int, tuple[complex, ...]],
    strength: NDArray[np.float64],
    duration_s: float = 1.0,
) -> StabilisationDiagram:
    """Return the diagram of poles that are given for each rank, one channel."""
    monkeypatch.setattr(
        module,
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
    chosen = layouts([record[:3000]])
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
