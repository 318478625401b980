"""Results of the modal identification cannot be changed by who receives them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.modes.modal_likelihood import Ties, gathered, most_likely_modes
from identify.modes.modal_model import modes_of
from identify.modes.state_variable_method import Delays, delay_space, stabilisation_diagram
from identify.modes.waves import even_blocks

from ..structures import free_decay, oscillators

POLE = oscillators([2.0], [0.1])
RECORD = free_decay(POLE, np.ones((2, 1)), np.ones(1), 20.0, 3.0)
RECORD += 0.01 * np.random.default_rng(0).standard_normal((60, 2))


def found() -> dict[str, tuple[NDArray[np.generic], ...]]:
    """Return the arrays of each kind of result."""
    ties = Ties(np.array([0, 0]), np.ones((2, 1)))
    likely = most_likely_modes(
        gathered(even_blocks([RECORD], 20.0)), POLE, np.ones((2, 1), complex)
    )
    space = delay_space([RECORD], 20.0, Delays(6, 1))
    diagram = stabilisation_diagram([RECORD], 20.0)
    model = modes_of(np.array([[0.0, 1.0], [-4.0, -0.2]]))
    return {
        "ties": (ties.owner, ties.sign),
        "likely modes": (
            likely.poles, likely.shapes, likely.amplitudes, likely.pole_covariance, likely.noise,
        ),
        "delay space": (space.directions, space.strength),
        "diagram": (diagram.rank, diagram.poles, diagram.shapes, diagram.stable),
        "modal model": (
            model.poles, model.shapes, model.frequency_std_hz, model.damping_ratio_std,
        ),
    }  # fmt: skip


@pytest.mark.parametrize("kind", ["ties", "likely modes", "delay space", "diagram", "modal model"])
def test_an_array_of_a_result_cannot_be_changed(kind: str) -> None:
    for array in found()[kind]:
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0
