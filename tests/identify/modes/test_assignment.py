"""Pairs that are worth most, whether or not two rows want the same column."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from identify.modes.modal_model import best_pairs


def test_no_other_pairs_are_worth_more() -> None:
    rng = np.random.default_rng(3)
    for shape in [(4, 4)] * 20 + [(3, 5), (5, 3)]:
        worth = rng.random(shape)
        rows, columns = best_pairs(worth)
        wide = worth if shape[0] <= shape[1] else worth.T
        orders = permutations(range(wide.shape[1]), len(wide))
        best = max(sum(row[j] for row, j in zip(wide, order, strict=True)) for order in orders)
        assert len(set(rows.tolist())) == len(set(columns.tolist())) == min(shape)
        assert np.isclose(worth[rows, columns].sum(), best)


def test_without_modes_there_are_no_pairs() -> None:
    assert len(best_pairs(np.zeros((0, 3)))[0]) == 0
