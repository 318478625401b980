"""Bars and dots of the report hold the numbers of their panel, in its order."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from identify.report.figures.panels import figure_of, size_in
from identify.report.panels import (
    ClosedFormPanel,
    DifferencePanel,
    IntervalPanel,
    PredictionPanel,
    TrendPanel,
)

from .artists import bars, legend, named, points, segments, ticks, upright

NAN = float("nan")


def test_intervals_lie_about_zero_and_what_they_rest_on_adds_up_to_a_hundred() -> None:
    shares = np.array([[0.75, 0.25], [0.1, 0.9], [NAN, NAN]])
    half = np.array([2.0, 40.0, NAN])
    panel = IntervalPanel(("m_s", "k_af", "t_f"), half, ("bounce", "facts"), shares)
    left, right = figure_of(panel).axes
    assert bars(left) == [(-2.0, 2.0, 0.0), (-40.0, 40.0, 1.0), (0.0, 0.0, 2.0)]
    assert ticks(left) == ["m_s", "k_af", "t_f"]
    assert [(t.get_text(), t.get_position()) for t in left.texts] == [
        (" ±2.0 %", (2.0, 0)),
        (" ±40 %", (40.0, 1)),
        (" not determined", (0.0, 2)),
    ]
    assert left.get_xlim() == pytest.approx((-44.0, 76.0))
    assert segments(left) == [[[0.0, -0.5], [0.0, 2.5]]]
    assert left.get_xlabel() == "95 % interval about the estimate, %"
    assert left.get_title(loc="left") == "How well each is known"
    assert bars(right) == [
        (0.0, 75.0, 0.0), (0.0, 10.0, 1.0), (0.0, 0.0, 2.0),
        (75.0, 100.0, 0.0), (10.0, 100.0, 1.0), (0.0, 0.0, 2.0),
    ]  # fmt: skip
    assert right.get_xlim() == (0.0, 100.0)
    assert ticks(right) == ["", "", ""]
    assert right.get_xlabel() == "share of its precision, %"
    assert right.get_title(loc="left") == "What it rests on"
    assert legend(right) == ["bounce", "facts"]
    colours = [to_hex(one.get_facecolor()) for one in right.patches]
    assert len(set(colours)) == 2
    assert colours[:3] == colours[:1] * 3


def test_twelve_kinds_have_eleven_colours_that_come_again_in_their_order() -> None:
    kinds = tuple(f"kind {i}" for i in range(12))
    panel = IntervalPanel(("m_s",), np.array([1.0]), kinds, np.full((1, 12), 1 / 12))
    colours = [to_hex(one.get_facecolor()) for one in figure_of(panel).axes[1].patches]
    assert len(set(colours[:11])) == 11
    assert colours[11] == colours[0]


@pytest.mark.parametrize(
    ("half", "text", "place", "limits"),
    [
        (100.0, " ±100 %", 100.0, (-110.0, 190.0)),
        (100.1, " may be zero", 0.0, (-1.1, 1.9)),
        (0.0, " not determined", 0.0, (-1.1, 1.9)),
    ],
)
def test_an_interval_is_drawn_up_to_the_whole_value(
    half: float, text: str, place: float, limits: tuple[float, float]
) -> None:
    panel = IntervalPanel(("m_s",), np.array([half]), ("bounce",), np.ones((1, 1)))
    left, _ = figure_of(panel).axes
    assert [(t.get_text(), t.get_position()) for t in left.texts] == [(text, (place, 0))]
    assert left.get_xlim() == pytest.approx(limits)


def test_lines_of_text_stand_beneath_each_other_from_the_top() -> None:
    """Five rows of 0.195 inches hang 0.32 inches below the top of the figure."""
    panel = IntervalPanel(("a",) * 5, np.ones(5), ("bounce",), np.ones((5, 1)))
    figure = figure_of(panel)
    width, height = figure.get_size_inches()
    assert (width, height) == pytest.approx((7.4, 0.32 + 0.62 + 0.17 + 5 * 0.195))
    left, right = figure.axes
    assert left.get_position().x0 == pytest.approx(0.075)
    assert left.get_position().x1 == pytest.approx(0.45)
    assert right.get_position().x0 == pytest.approx(0.5)
    assert right.get_position().x1 == pytest.approx(0.985)
    for axes in (left, right):
        place = axes.get_position()
        assert (1.0 - place.y1) * height == pytest.approx(0.32)
        assert place.height * height == pytest.approx(5 * 0.195)
        assert axes.get_ylim() == (4.5, -0.5)
        assert not axes.spines["left"].get_visible()


@pytest.mark.parametrize(("kinds", "rows"), [(0, 0), (1, 1), (5, 1), (6, 2), (10, 2), (11, 3)])
def test_the_figure_grows_by_a_row_for_every_five_entries_of_its_legend(
    kinds: int, rows: int
) -> None:
    names = tuple(str(i) for i in range(kinds))
    panel = IntervalPanel(("m_s", "t_f"), np.ones(2), names, np.ones((2, kinds)))
    assert size_in(panel) == pytest.approx((7.4, 0.94 + 0.17 * rows + 2 * 0.195))


def test_the_closed_form_is_a_diamond_beside_the_bar_of_the_likelihood() -> None:
    panel = ClosedFormPanel(("m_s", "k_sf"), np.array([2.0, 3.0]), np.array([-5.0, 0.5]))
    (axes,) = figure_of(panel).axes
    assert bars(axes) == [(-2.0, 2.0, 0.0), (-3.0, 3.0, 1.0)]
    diamonds = named(axes, "closed form (paper's chain)")
    assert (points(diamonds), diamonds.get_marker()) == ([(-5.0, 0.0), (0.5, 1.0)], "D")
    square = named(axes, "likelihood, 95 % interval")
    assert (points(square), square.get_marker()) == ([], "s")
    assert ticks(axes) == ["m_s", "k_sf"]
    assert axes.get_xlim() == pytest.approx((-5.5, 5.5))
    assert axes.get_xlabel() == "difference from the likelihood's estimate, %"
    assert legend(axes) == ["closed form (paper's chain)", "likelihood, 95 % interval"]
    assert size_in(panel) == pytest.approx((7.4, 0.94 + 0.17 + 2 * 0.195))


def predictions(fitted: list[float], predicted: list[float], limit: list[float]) -> Axes:
    names = tuple(f"run {i + 1}" for i in range(len(fitted)))
    panel = PredictionPanel(names, np.array(fitted), np.array(predicted), np.array(limit))
    assert size_in(panel) == pytest.approx((7.4, 0.94 + 0.17 + 0.195 * len(fitted)))
    (axes,) = figure_of(panel).axes
    return axes


def test_a_predicted_run_is_joined_to_its_fit_over_the_level_of_the_noise() -> None:
    axes = predictions([0.95, 1.02], [1.0, 1.3], [1.2, NAN])
    assert bars(axes) == [(1.0, 1.2, 0.0), (1.0, 1.0, 1.0)]
    assert segments(axes) == [[[0.95, 0.0], [1.0, 0.0]], [[1.02, 1.0], [1.3, 1.0]]]
    fitted, left_out = named(axes, "fitted"), named(axes, "predicted, left out")
    assert (points(fitted), fitted.get_marker()) == ([(0.95, 0.0), (1.02, 1.0)], "o")
    assert (points(left_out), left_out.get_marker()) == ([(1.0, 0.0), (1.3, 1.0)], "D")
    assert ticks(axes) == ["run 1", "run 2"]
    assert axes.get_xlabel() == "chi2/n of the run's residuals; 1 = noise alone"
    assert legend(axes) == ["fitted", "predicted, left out", "noise level"]
    assert axes.get_xscale() == "linear"
    assert axes.get_xlim() == pytest.approx((0.9, 1.32))
    assert upright(axes) == [1.0]


@pytest.mark.parametrize(
    ("fitted", "predicted", "limit", "scale", "limits"),
    [
        ([1.0], [1.01], [1.05], "linear", (0.9, 1.1)),
        ([0.5], [1.01], [1.05], "linear", (0.48, 1.1)),
        ([1.0], [1.2], [1.5], "linear", (0.9, 1.52)),
        ([1.0], [NAN], [NAN], "linear", (0.9, 1.1)),
        ([1.0], [3.0], [1.2], "linear", (0.9, 3.02)),
        ([1.0], [3.1], [1.2], "log", (0.8, 4.03)),
        ([1.0, 20.0], [NAN, 40.0], [NAN, 1.1], "log", (0.8, 52.0)),
    ],
)
def test_the_axis_of_the_runs_holds_all_of_them(
    fitted: list[float],
    predicted: list[float],
    limit: list[float],
    scale: str,
    limits: tuple[float, float],
) -> None:
    axes = predictions(fitted, predicted, limit)
    assert axes.get_xscale() == scale
    assert axes.get_xlim() == pytest.approx(limits)


def test_differences_that_stand_have_a_mark_of_their_own() -> None:
    panel = DifferencePanel(
        ("m_s", "k_sf", "c_sf"),
        np.array([1.0, -4.0, 0.5]),
        np.array([2.0, 1.0, 0.75]),
        np.array([False, True, False]),
    )
    assert size_in(panel) == pytest.approx((7.4, 0.94 + 0.17 + 3 * 0.195))
    (axes,) = figure_of(panel).axes
    assert segments(axes) == [
        [[-1.0, 0.0], [3.0, 0.0]],
        [[-5.0, 1.0], [-3.0, 1.0]],
        [[-0.25, 2.0], [1.25, 2.0]],
    ]
    differs, chance = named(axes, "differs"), named(axes, "within chance")
    assert (points(differs), differs.get_marker()) == ([(-4.0, 1.0)], "D")
    assert (points(chance), chance.get_marker()) == ([(1.0, 0.0), (0.5, 2.0)], "o")
    assert differs.get_color() != chance.get_color()
    assert ticks(axes) == ["m_s", "k_sf", "c_sf"]
    assert legend(axes) == ["differs", "within chance"]
    assert axes.get_xlabel() == "difference, % of the first session's value"
    assert upright(axes) == [0.0]


def test_the_line_of_a_trend_goes_through_the_weighted_middle() -> None:
    """Weights 1, 1, 4: the middle lies at (1 + 2 + 12) / 6 = 2.5 and (10 + 16 + 48) / 6."""
    panel = TrendPanel(np.array([10.0, 16.0, 12.0]), np.array([2.0, 2.0, 1.0]), 3.0, "kg")
    assert size_in(panel) == (3.62, 1.7)
    (axes,) = figure_of(panel).axes
    (held,) = axes.containers
    dots, _, (whiskers,) = held
    assert points(dots) == [(1.0, 10.0), (2.0, 16.0), (3.0, 12.0)]
    ends = [np.asarray(path.vertices).tolist() for path in whiskers.get_paths()]
    assert ends == [
        [[1.0, 8.0], [1.0, 12.0]], [[2.0, 14.0], [2.0, 18.0]], [[3.0, 11.0], [3.0, 13.0]],
    ]  # fmt: skip
    line = axes.lines[-1]
    rising = 74.0 / 6.0 + 3.0 * (np.array([1.0, 2.0, 3.0]) - 2.5)
    np.testing.assert_allclose(points(line), np.stack([[1.0, 2.0, 3.0], rising], axis=1))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("session", "kg")
    assert axes.get_xticks().tolist() == [1, 2, 3]
    assert axes.get_xlim() == pytest.approx((0.84, 3.16))


@pytest.mark.parametrize(
    ("n", "shown"),
    [
        (1, [1]),
        (7, [1, 2, 3, 4, 5, 6, 7]),
        (15, list(range(1, 16))),
        (16, [1, 3, 5, 7, 9, 11, 13, 15]),
    ],
)
def test_many_sessions_are_numbered_with_gaps(n: int, shown: list[int]) -> None:
    panel = TrendPanel(np.arange(float(n)), np.ones(n), 1.0, "")
    (axes,) = figure_of(panel).axes
    assert axes.get_xticks().tolist() == shown
