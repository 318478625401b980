"""Eigensystem realisation and stabilisation diagram, beside the closed form."""

from __future__ import annotations

import numpy as np
import pytest

from identify.modes.modal_model import mac
from identify.modes.state_variable_method import realised_modes, stabilisation_diagram

from ..structures import (
    chain_poles,
    chain_shapes,
    free_decay,
    oscillators,
    random_amplitudes,
    with_noise,
)

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


@pytest.mark.parametrize(
    ("rate_hz", "n_modes", "found"),
    [(40.0, 4, True), (40.0, 5, False), (8.0, 1, True), (8.0, 2, False)],
)
def test_a_column_is_a_quarter_of_a_second_of_at_least_four_samples(
    rate_hz: float, n_modes: int, found: bool
) -> None:
    """In one channel two states a mode need a sample each and one more: ten hold four modes."""
    frequencies = list(rate_hz * np.linspace(0.08, 0.42, n_modes))
    poles = oscillators(frequencies, [0.02] * n_modes)
    record = free_decay(poles, np.ones((1, n_modes)), np.ones(n_modes), rate_hz, 400 / rate_hz)
    realised = realised_modes([record], rate_hz, 2 * n_modes).poles
    near = [np.abs(realised / pole - 1.0).min(initial=1.0) < 1e-6 for pole in poles]
    assert all(near) is found


def test_a_column_of_four_samples_holds_a_mode_and_a_decay() -> None:
    poles = np.append(oscillators([2.0], [0.1]), -1.5)
    record = free_decay(poles, np.ones((1, 2)), np.array([1.0, 2.0]), 8.0, 8.0)
    (found,) = realised_modes([record], 8.0, 3).poles
    assert found == pytest.approx(poles[0], rel=1e-9)


def test_shapes_are_in_the_units_of_the_channels() -> None:
    units = np.array([1.0, 1e3, 0.02])
    record = free_decay(POLES, SHAPES, np.array([1.0, 0.8j, 0.9]), 50.0, 6.0) * units
    found = realised_modes([record], 50.0, 6)
    expected = units[:, None] * SHAPES
    assert found.shapes / found.shapes[0] == pytest.approx(
        expected / expected[0], rel=1e-6, abs=1e-6
    )


def test_an_order_beyond_what_a_short_record_holds_is_all_that_it_holds() -> None:
    """Eight samples are five columns of four samples."""
    record = np.random.default_rng(4).standard_normal((8, 5))
    most, beyond = realised_modes([record], 100.0, 5), realised_modes([record], 100.0, 1000)
    assert beyond.poles == pytest.approx(most.poles)
    assert beyond.shapes == pytest.approx(most.shapes)
