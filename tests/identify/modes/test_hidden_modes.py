"""A mode that hides beside another is found, in every unit and under ties."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.modes import mode_selection as order_selection
from identify.modes.modal_likelihood import LikelyModes, Ties, gathered
from identify.modes.mode_selection import likely_modes
from identify.modes.waves import Block

from ..structures import free_decay, oscillators

POLES = oscillators([2.0, 5.0, 5.15], [0.03, 0.02, 0.025])
SHAPES = np.array([[1.0, 1.0, 0.6], [0.5, -0.7, 1.0], [-0.4, 0.3, 0.5]], dtype=complex)
AMPLITUDES = (np.array([1.0, 1.0, 0.3]), np.array([0.5j, 0.4, 1.0j]))


def block(units: NDArray[np.float64], shapes: NDArray[np.complex128] = SHAPES) -> Block:
    """Return two runs of 200 samples of three channels, noise of a hundredth of each unit."""
    rng = np.random.default_rng(12)
    runs = [free_decay(POLES, shapes, q, 40.0, 5.0) for q in AMPLITUDES]
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
    found = likely_modes(gathered([block(unit)]), POLES[seen], (SHAPES * unit[:, None])[:, seen])
    order = np.argsort(np.abs(found.poles))
    assert found.poles[order] == pytest.approx(POLES, rel=5e-3)
    shapes = found.shapes[:, order] / unit[:, None]
    assert shapes / shapes[0] == pytest.approx(SHAPES / SHAPES[0], abs=0.1)


def test_a_hidden_mode_has_the_kind_of_the_mode_that_hid_it() -> None:
    """Two equal channels and one in the middle; the hidden mode is symmetric as its neighbour."""
    alike = np.array([[1.0, 1.0, 0.6], [-1.0, 1.0, 0.6], [0.0, 0.3, -0.5]], dtype=complex)
    ties = Ties(np.array([0, 0, 1]), np.array([[1.0, 1.0], [-1.0, 1.0], [0.0, 1.0]]))
    found = likely_modes(gathered([block(np.ones(3), alike)]), POLES[:2], alike[:, :2], ties)
    assert len(found.poles) == 3
    order = np.argsort(np.abs(found.poles))
    assert found.poles[order] == pytest.approx(POLES, rel=5e-3)
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


def test_the_search_ends_with_the_first_second_pole_that_only_follows_a_drift(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One mode, 1 % higher in the second run: a second pole fits better, but is a copy of it."""
    tries: list[int] = []
    split = order_selection._split

    def counted(blocks: Sequence[Block], modes: LikelyModes) -> order_selection.Start:
        tries.append(len(modes.poles))
        return split(blocks, modes)

    monkeypatch.setattr(order_selection, "_split", counted)
    rng, pole = np.random.default_rng(14), oscillators([2.0], [0.03])
    runs = [free_decay(f * pole, SHAPES[:, :1], np.ones(1), 40.0, 5.0) for f in (1.0, 1.01)]
    values = np.hstack([run + 0.01 * rng.standard_normal(run.shape) for run in runs])
    drifted = Block(np.arange(200) / 40.0, values, np.repeat([0, 1], 3), np.tile(np.arange(3), 2))
    found = likely_modes(gathered([drifted]), pole, SHAPES[:, :1])
    assert tries == [1]
    assert found.poles == pytest.approx(1.005 * pole, rel=3e-3)
