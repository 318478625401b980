"""What a further unknown would gain: by normal equations of three unknowns, one of them free."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.nonlinear import score
from identify.nonlinear.problem import Normal
from identify.nonlinear.score import gain_of

H = np.array([[4.0, 2.0, 0.0], [2.0, 10.0, 1.0], [0.0, 1.0, 8.0]])
G = np.array([1.0, 3.5, -4.0])


def gains(
    monkeypatch: pytest.MonkeyPatch,
    matrix: NDArray[np.float64],
    right: NDArray[np.float64],
    extra: tuple[int, ...] = (12, 15),
    path: bool = True,
) -> tuple[list[float], list[float]]:
    """Return gains and sizes of two unknowns beside the free one, which is number 13."""
    released: list[list[int]] = []

    class Given(SimpleNamespace):
        def releasing(self, free: NDArray[np.intp]) -> Given:
            released.append(free.tolist())
            return Given(free=free)

    def point(problem: Any, eta: Any, initials: Any, grade: Any) -> Any:
        assert (eta.tolist(), initials, grade) == ([7.0], ("own",), "usual")
        return SimpleNamespace() if path else None

    monkeypatch.setattr(score, "point", point)
    equations = Normal((), matrix, right, np.zeros(0), np.zeros((0, len(matrix))))
    monkeypatch.setattr(score, "normal", lambda _: equations)
    there = SimpleNamespace(
        problem=SimpleNamespace(free=np.array([13])), initials=("own",), grade="usual"
    )
    best: Any = SimpleNamespace(point=there)
    given: Any = Given()
    found = gain_of(given, best, np.array([7.0]), np.array(extra))
    assert released == [sorted({13, *extra})]
    return found[0].tolist(), found[1].tolist()


def test_each_gains_alone_what_the_free_ones_do_not_explain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Unknowns 12, 13 and 15; of 12, 4 less 2^2 / 10, and of 15, 8 less 1^2 / 10.

    Their pulls are 1 less 2 * 3.5 / 10, and -4 less 3.5 / 10.
    """
    gain, size = gains(monkeypatch, H, G)
    assert size == pytest.approx([0.3 / 3.6, -4.35 / 7.9])
    assert gain == pytest.approx([0.09 / 3.6, 4.35**2 / 7.9])
    turned = gains(monkeypatch, H, G, (15, 12))
    assert turned[0] == pytest.approx(gain[::-1])
    assert turned[1] == pytest.approx(size[::-1])


@pytest.mark.parametrize(("left", "seen"), [(3e-10, False), (5e-10, True)])
def test_what_a_free_unknown_does_as_well_gains_nothing(
    left: float, seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an information of 4, as little as 4e-10 may be left."""
    alike = H.copy()
    alike[0, 0] = 4.0
    alike[0, 1] = alike[1, 0] = (10.0 * (4.0 - left)) ** 0.5
    gain, size = gains(monkeypatch, alike, G)
    assert bool(size[0]) is bool(gain[0]) is seen
    assert size[1] == pytest.approx(-4.35 / 7.9)


def test_without_path_or_tangents_nothing_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = ([0.0, 0.0], [0.0, 0.0])
    assert gains(monkeypatch, H, G, path=False) == nothing
    monkeypatch.setattr(Normal, "finite", False)
    assert gains(monkeypatch, H, G) == nothing
