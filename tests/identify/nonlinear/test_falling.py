"""No damper's force falls as the speed grows."""

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.elements.laws import knee
from identify.nonlinear.problem import too_flat

from .cars import bent, model_of

MODEL = model_of(knots="K3")
START = bent(MODEL)


def _flat(eta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the terms of the curves, one for each segment, front first; steep ones are free."""
    return np.maximum(too_flat(MODEL, eta)[0], 0.0)


def _slopes_beside_the_coefficient(h: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the slope in each segment over the secant within 0.1 m/s, of a curve drawn by hand."""

    def force(v: float) -> float:
        bends = sum(1000.0 * x * knee(v, at, 1e-9) for x, at in zip(h, KNOTS, strict=True))
        return float(2000.0 * v + bends)

    secant = (force(0.1) - force(-0.1)) / 0.2
    middles = (-0.5, -0.05, 0.05, 0.5)
    return np.array([(force(v + 1e-4) - force(v - 1e-4)) / 2e-4 / secant for v in middles])


KNOTS = (-0.15, 0.0, 0.15)


def test_a_straight_damper_costs_nothing() -> None:
    assert not _flat(START).any()


@pytest.mark.parametrize("h", [(-1.4, 0.3, -1.0), (0.0, -0.6, -1.3), (-1.9, 0.0, -2.2)])
def test_a_segment_counts_by_what_it_lacks_of_two_per_cent(h: tuple[float, float, float]) -> None:
    shares = _slopes_beside_the_coefficient(h)
    # The same curve about the Granada's 1,500 N s/m.
    secant = 2000.0 + 1000.0 * 0.5 * h[1]
    scale = 1500.0 / secant
    eta = bent(MODEL, **{f"h_f{j}": x * scale for j, x in enumerate(h, start=1)})
    expected = np.maximum(0.02 - shares, 0.0) / 0.01
    np.testing.assert_allclose(_flat(eta)[:4], expected, rtol=0.03, atol=0.03)
    assert not _flat(eta)[4:].any()


@pytest.mark.parametrize(("share", "counts"), [(0.021, False), (0.019, True)])
def test_the_limit_is_two_per_cent_of_the_coefficient(share: float, counts: bool) -> None:
    eta = bent(MODEL, h_r3=-1.5 * (1.0 - share))
    assert bool(_flat(eta).any()) is counts


def test_its_slopes_are_the_derivatives() -> None:
    eta = bent(MODEL, h_f1=-1.6, h_f2=0.2, h_r3=-1.7)
    _, slopes = too_flat(MODEL, eta)
    for k in range(len(eta)):
        step = np.zeros(len(eta))
        step[k] = 1e-6
        # What a segment lacks falls as its slope rises, that of steep ones too.
        rise = (too_flat(MODEL, eta - step)[0] - too_flat(MODEL, eta + step)[0]) / 2e-6
        np.testing.assert_allclose(slopes[:, k], rise, rtol=1e-4, atol=1e-4)
