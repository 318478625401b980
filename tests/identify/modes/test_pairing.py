"""Pairing of modes by shape."""

from __future__ import annotations

import numpy as np
import pytest

from daq.channels import paper_channels
from daq.runs import ADDED as ADDED_STATE
from daq.runs import BASELINE as BASELINE_STATE
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA
from dbc.errors import InputError
from identify.model.matrices import physical_model
from identify.modes.modal_model import (
    ModalModel,
    displacement_shapes,
    mode_names,
    modes_of,
    pair_modes,
)
from identify.modes.vehicle_modes import sensed_modes

from ..bumps import CASES, paper_records

BASELINE = physical_model(FORD_GRANADA)
ADDED = BASELINE.with_mass(np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]))


def test_the_swapped_wheel_modes_are_paired_by_shape() -> None:
    pairing = pair_modes(modes_of(BASELINE.A), modes_of(ADDED.A))
    assert list(pairing.baseline) == [0, 1, 2, 3, 4, 5, 6]
    assert list(pairing.added) == [0, 1, 2, 4, 3, 5, 6]  # reference: 4 and 5 change places
    assert pairing.swapped == ((3, 4),)
    assert pairing.mac.min() > 0.995
    assert pairing.margin.min() > 0.8


def test_symmetric_modes_stay_symmetric_through_the_pairing() -> None:
    pairing = pair_modes(modes_of(BASELINE.A), modes_of(ADDED.A))
    for model, order in ((BASELINE, pairing.baseline), (ADDED, pairing.added)):
        shapes = modes_of(model.A).shapes[:, order]
        roll = np.abs(shapes[5] - shapes[6]) > np.abs(shapes[5] + shapes[6])
        assert list(roll) == [False, False, True, True, False, True, False]


def test_a_mode_without_partner_stays_alone() -> None:
    modes = modes_of(BASELINE.A)
    fewer = ModalModel(modes.poles[[0, 2, 6]], modes.shapes[:, [0, 2, 6]])
    pairing = pair_modes(modes, fewer)
    assert list(pairing.baseline) == [0, 2, 6]
    assert list(pairing.added) == [0, 1, 2]
    assert pairing.swapped == ()


def test_shapes_of_different_channels_are_refused() -> None:
    modes = modes_of(BASELINE.A)
    with pytest.raises(InputError, match="7 and of 6 channels"):
        pair_modes(modes, ModalModel(modes.poles, modes.shapes[:6]))


def test_the_swapped_pair_is_matched_from_clean_and_from_noisy_decays() -> None:
    for noise_db, seeds in ((200.0, 1), (30.0, 2)):
        for seed in range(seeds):
            records = paper_records(200.0, noise_db, seed, (*CASES, Excitation.WARP))
            models = []
            for state in (BASELINE_STATE, ADDED_STATE):
                mine = [record for record in records if record.mass_state == state]
                sensed = sensed_modes(mine, [record.decay(0.3 + 1e-9) for record in mine])
                models.append(sensed.model)
            names = [
                mode_names(
                    displacement_shapes(model, paper_channels(), FORD_GRANADA.geometry),
                    FORD_GRANADA.geometry,
                )
                for model in models
            ]
            pairing = pair_modes(*models)
            assert len(pairing.baseline) == 7
            for light, heavy in zip(pairing.baseline, pairing.added, strict=True):
                assert names[0][light] == names[1][heavy]
            assert pairing.margin.min() > 0.7
            if noise_db > 100.0:
                assert pairing.swapped == ((3, 4),)


def test_without_modes_there_is_nothing_to_pair_and_a_pairing_cannot_be_changed() -> None:
    modes = modes_of(BASELINE.A)
    none = ModalModel(np.zeros(0, complex), np.zeros((7, 0), complex))
    for pairing in (pair_modes(modes, none), pair_modes(none, modes), pair_modes(none, none)):
        assert (len(pairing.mac), len(pairing.margin), pairing.swapped) == (0, 0, ())
    whole = pair_modes(modes, modes)
    for array in (whole.baseline, whole.added, whole.mac, whole.margin):
        assert not array.flags.writeable
