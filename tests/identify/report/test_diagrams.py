"""Colours, poles, decays, dampers and cars of the report hold the numbers of their panel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from daq.vehicle import FORD_GRANADA
from identify.report.figures.panels import draw, figure_of, size_in
from identify.report.panels import (
    AxleCurve,
    CorrelationPanel,
    DamperPanel,
    DecayPanel,
    OverlayPanel,
    ShapePanel,
    SnrPanel,
    StabilisationPanel,
    Trace,
)
from identify.report.shapes import at_rest, outline, shape_of

from .artists import legend, named, points, ticks, upright

NAN = float("nan")


def mesh(axes: Axes) -> tuple[list[list[float | None]], tuple[float, float]]:
    (one,) = axes.collections
    values: list[list[float | None]] = np.ma.asarray(one.get_array()).tolist()
    return values, one.get_clim()


def written(axes: Axes) -> dict[tuple[float, float], tuple[str, str]]:
    """Return text and colour of each cell by column and row."""
    return {t.get_position(): (t.get_text(), to_hex(t.get_color())) for t in axes.texts}


def heads(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_xticklabels()]


def test_a_correlation_stands_in_its_row_and_column_and_the_diagonal_is_empty() -> None:
    matrix = np.array([[1.0, 0.5, -0.61], [0.5, 1.0, 0.63], [-0.63, 0.004, 1.0]])
    panel = CorrelationPanel(("m_s", "k_sf", "$x$"), matrix)
    assert size_in(panel) == pytest.approx((7.4, 0.5 + 3 * 0.215))
    (axes,) = figure_of(panel).axes
    values, limits = mesh(axes)
    assert values == [[None, 0.5, -0.61], [0.5, None, 0.63], [-0.63, 0.004, None]]
    assert limits == (-1.0, 1.0)
    dark, white = "#262626", "#ffffff"
    assert written(axes) == {
        (0, 0): ("", dark), (1, 0): ("+.50", dark), (2, 0): ("-.61", dark),
        (0, 1): ("+.50", dark), (1, 1): ("", dark), (2, 1): ("+.63", white),
        (0, 2): ("-.63", white), (1, 2): ("+.00", dark), (2, 2): ("", dark),
    }  # fmt: skip
    assert (ticks(axes), heads(axes)) == (["m_s", "k_sf", "$x$"], ["m_s", "k_sf", "$x$"])
    assert axes.get_ylim() == (2.5, -0.5)
    assert axes.xaxis.get_ticks_position() == "top"
    assert (1.0 - axes.get_position().y1) * size_in(panel)[1] == pytest.approx(0.25)
    assert axes.get_position().y0 == pytest.approx(0.0)


def test_a_mode_that_a_run_does_not_show_has_a_triangle() -> None:
    panel = SnrPanel(
        ("baseline_roll_1", "baseline_$2$"),
        ("body bounce", "front wheels in phase"),
        np.array([[30.4, -0.3], [NAN, 20.0]]),
        20.0,
    )
    assert size_in(panel) == pytest.approx((7.4, 0.5 + 2 * 0.215))
    (axes,) = figure_of(panel).axes
    values, limits = mesh(axes)
    assert values == [[30.4, -0.3], [None, 20.0]]
    assert limits == (0.0, 40.0)
    assert {at: text for at, (text, _) in written(axes).items()} == {
        (0, 0): "30", (1, 0): "0", (0, 1): "", (1, 1): "20",
    }  # fmt: skip
    assert [(points(line), line.get_marker()) for line in axes.lines] == [([(0.58, 0.0)], "v")]
    assert ticks(axes) == ["baseline_roll_1", "baseline_$2$"]
    assert heads(axes) == ["body bounce", "front wheels\nin phase"]
    assert (1.0 - axes.get_position().y1) * size_in(panel)[1] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("largest", "top"), [(NAN, 40.0), (5.0, 40.0), (39.0, 40.0), (41.0, 41.0), (60.0, 60.0)]
)
def test_the_scale_of_the_energy_reaches_twice_the_limit_or_the_largest(
    largest: float, top: float
) -> None:
    panel = SnrPanel(("run",), ("mode", "other"), np.array([[largest, NAN]]), 20.0)
    (axes,) = figure_of(panel).axes
    assert mesh(axes)[1] == (0.0, top)


def test_poles_that_come_again_stand_out_from_those_that_do_not() -> None:
    panel = StabilisationPanel(
        np.array([0.0, 1.0, 1.2, 10.0, 13.5, 13.4]),
        np.array([4.0, 6.0, 8.0, 10.0, 12.0, 30.0]),
        np.array([True, True, False, True, True, False]),
        np.array([1.0, 10.0]),
    )
    assert size_in(panel) == (3.62, 2.7)
    figure = figure_of(panel)
    (axes,) = figure.axes
    assert upright(axes) == [1.0, 10.0]
    by_mark = {line.get_marker(): points(line) for line in axes.lines if len(points(line)) > 1}
    assert by_mark["x"] == [(1.2, 8.0), (13.4, 30.0)]
    assert by_mark["o"] == [(1.0, 6.0), (10.0, 10.0)]
    assert axes.get_xscale() == "log"
    assert axes.get_xlim() == pytest.approx((0.6, 13.5))
    assert axes.get_ylim() == (0.0, 31.0)
    assert heads(axes) == ["1", "2", "3", "5", "7", "10"]
    assert axes.get_xticks().tolist() == [1, 2, 3, 5, 7, 10]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("frequency, Hz", "rank")
    assert legend(axes) == ["recurs", "does not", "identified mode"]
    assert named(axes, "recurs").get_marker() == "o"
    assert named(axes, "does not").get_marker() == "x"
    assert named(axes, "identified mode").get_linestyle() == "-"
    figure.canvas.draw()
    assert figure.legends[0].get_window_extent().y0 >= axes.bbox.y1


def test_a_diagram_without_poles_and_modes_is_drawn_all_the_same() -> None:
    nothing = np.array([])
    panel = StabilisationPanel(nothing, nothing, nothing.astype(bool), nothing)
    (axes,) = figure_of(panel).axes
    assert axes.get_xlim() == pytest.approx((0.6, 1.35))
    assert axes.get_ylim() == (0.0, 2.0)


def trace(channel: str, unit: str, largest: float) -> Trace:
    time = np.array([0.2, 0.5, 0.9])
    return Trace(
        channel,
        unit,
        np.array([[0.15, 0.5, 0.9], [1.0, 2.0, -3.0]]),
        np.stack([time, [1.5, 2.5, -2.5]]),
        np.stack([time, [0.5, -largest, 1.0]]),
    )


def test_a_decay_shows_each_trace_over_what_the_fit_leaves_of_it() -> None:
    panel = DecayPanel((trace("z_s", "m/s²", 3.0), trace("$h$", "m", 20.0)), 0.18, 0.25, 0.85)
    assert size_in(panel) == (3.62, 2.75)
    axes = figure_of(panel).axes
    assert len(axes) == 4
    for top, under, channel, reach in (
        (axes[0], axes[1], "z_s, m/s²", 6.0),
        (axes[2], axes[3], "$h$, m", 21.0),
    ):
        measured, fitted = top.lines[:2]
        assert points(measured) == [(0.15, 1.0), (0.5, 2.0), (0.9, -3.0)]
        assert points(fitted) == [(0.2, 1.5), (0.5, 2.5), (0.9, -2.5)]
        assert measured.get_color() == "#9a9a9a"
        assert upright(top) == [0.25, 0.18]
        assert [text.get_text() for text in top.texts] == [channel]
        (left,) = under.lines
        assert points(left) == [(0.2, 0.5), (0.5, -reach / 1.05 if reach > 6.0 else -3.0), (0.9, 1)]
        assert left.get_color() == fitted.get_color()
        assert under.get_ylim() == pytest.approx((-reach, reach))
        assert under.get_ylabel() == "sigma"
        band = next(p for p in under.patches if p.get_zorder() == 0.5).get_extents()
        low, high = under.transData.inverted().transform([band.p0, band.p1])[:, 1]
        assert (low, high) == pytest.approx((-2.0, 2.0))
        assert top.get_xlim() == pytest.approx((0.15, 0.85))
        for one in (top, under):
            window = one.patches[0].get_extents()
            ends = one.transData.inverted().transform([window.p0, window.p1])[:, 0]
            assert ends.tolist() == pytest.approx([0.25, 0.85])
    heights = [one.get_position().height for one in axes]
    assert [h / heights[1] for h in heights] == pytest.approx([3.0 / 1.15, 1.0, 3.0 / 1.15, 1.0])
    hues = {one.lines[-1].get_color() for one in axes[1::2]}
    assert len(hues) == 2
    assert [one.get_xlabel() for one in axes] == ["", "", "", "time in the run, s"]
    shown = [any(tick.label1.get_visible() for tick in one.xaxis.majorTicks) for one in axes]
    assert shown == [False, False, False, True]


def test_a_record_that_begins_in_motion_has_no_line_for_the_onset() -> None:
    panel = DecayPanel((trace("z_s", "m", 3.0),), NAN, 0.25, 0.85)
    top, _ = figure_of(panel).axes
    assert upright(top) == [0.25]


def test_a_run_without_a_channel_to_show_is_an_empty_figure() -> None:
    assert figure_of(DecayPanel((), NAN, 0.25, 0.85)).axes == []


def test_sessions_lie_over_each_other_the_first_broad_and_beneath() -> None:
    curves = tuple(np.array([[0.0, 0.1], [float(i), 1.0]]) for i in range(6))
    labels = ("a" * 20, "b" * 21, "c", "d", "e", "f")
    panel = OverlayPanel("z_s", "m/s²", labels, curves)
    assert size_in(panel) == (3.62, 2.0)
    (axes,) = figure_of(panel).axes
    assert [points(line) for line in axes.lines] == [[(0.0, i), (0.1, 1.0)] for i in range(6)]
    assert [line.get_linewidth() for line in axes.lines] == [1.9, 0.9, 0.9, 0.9, 0.9, 0.9]
    colours = [line.get_color() for line in axes.lines]
    assert len(set(colours[:5])) == 5
    assert colours[5] == colours[0]
    held = axes.get_legend()
    assert held is not None
    texts = [text.get_text() for text in held.get_texts()]
    assert texts == ["a" * 20, "…" + "b" * 19, "c", "d", "e", "f"]
    assert axes.get_xlabel() == "time since the start of the decay, s"
    place = axes.get_position()  # under three rows of names of 8 % each
    assert (place.y0, place.y1) == pytest.approx((0.17, 0.9 - 3 * 0.08))


def curve(axle: str, c: float) -> AxleCurve:
    speed = np.array([-0.2, 0.0, 0.2])
    force = c * speed
    return AxleCurve(axle, speed, force, force - 10.0, force + 20.0, force + 5.0)


def test_each_axle_has_its_damper_with_its_band_on_one_scale() -> None:
    panel = DamperPanel((curve("front", 1000.0), curve("rear", 2000.0)))
    assert size_in(panel) == (7.4, 2.9)
    front, rear = figure_of(panel).axes
    for axes, c in ((front, 1000.0), (rear, 2000.0)):
        ends = 0.2 * c
        damper, both = named(axes, "damper, 95 % band"), named(axes, "with friction")
        assert points(damper) == [(-0.2, -ends), (0.0, 0.0), (0.2, ends)]
        assert points(both) == [(-0.2, 5.0 - ends), (0.0, 5.0), (0.2, ends + 5.0)]
        assert (damper.get_linestyle(), both.get_linestyle()) == ("-", "--")
        (band,) = axes.collections
        (path,) = band.get_paths()
        edge = {(x, y) for x, y in np.asarray(path.vertices).round(9).tolist()}
        assert edge == {
            (-0.2, -ends - 10.0), (0.0, -10.0), (0.2, ends - 10.0),
            (-0.2, -ends + 20.0), (0.0, 20.0), (0.2, ends + 20.0),
        }  # fmt: skip
        assert axes.get_xlabel() == "speed, m/s, compression positive"
        level, middle = axes.lines[:2]
        assert list(np.asarray(level.get_ydata())) == [0.0, 0.0]
        assert list(np.asarray(middle.get_xdata())) == [0.0, 0.0]
    assert (front.get_title(loc="left"), rear.get_title(loc="left")) == ("front", "rear")
    assert (front.get_ylabel(), rear.get_ylabel()) == ("force, N", "")
    assert front.get_legend() is not None
    assert rear.get_legend() is None
    assert front.get_ylim() == rear.get_ylim()
    lefts = [axes.get_position().x0 for axes in (front, rear)]
    rights = [axes.get_position().x1 for axes in (front, rear)]
    assert lefts == pytest.approx([0.1, 0.55])
    assert rights == pytest.approx([0.48, 0.93])


@pytest.mark.parametrize(
    ("n", "height"), [(0, 1.55), (1, 1.55), (4, 1.55), (5, 3.1), (8, 3.1), (9, 4.65)]
)
def test_cars_stand_four_in_a_row(n: int, height: float) -> None:
    heave = np.array([1.0, 0, 0, 0, 0, 0, 0], dtype=complex)
    shape = shape_of("1 body bounce", "1.2 Hz, 25 %", 1.2, heave, FORD_GRANADA.geometry)
    panel = ShapePanel((shape,) * n)
    assert size_in(panel) == pytest.approx((7.4, height))
    axes = figure_of(panel).axes
    assert len(axes) == n
    places = [one.get_subplotspec() for one in axes]
    assert [(p.rowspan.start, p.colspan.start) for p in places if p] == [
        divmod(i, 4) for i in range(n)
    ]


def test_a_car_is_drawn_grey_at_rest_and_coloured_at_its_largest_motion() -> None:
    roll = np.array([0, 0, 1.0, 0, 0, 0, 0], dtype=complex)
    shape = shape_of("3 $roll", "1.5 Hz, 20 %", 1.5, roll, FORD_GRANADA.geometry)
    figure = figure_of(ShapePanel((shape,)))
    (axes,) = figure.axes
    assert axes.get_title(loc="left") == "3 $roll\n1.5 Hz, 20 %"
    assert (axes.get_xlim(), axes.get_ylim()) == ((-2.15, 2.15), (1.55, -1.4))
    assert axes.get_aspect() == 1.0
    assert not axes.axison
    still, moved = axes.lines[:12], axes.lines[12:]
    assert len(moved) == 12
    for lines, car in ((still, at_rest(shape.geometry)), (moved, outline(shape, 0.0))):
        pillars = [np.asarray(line.get_xydata()) for line in lines[:4]]
        np.testing.assert_allclose([one[0] for one in pillars], car.deck)
        np.testing.assert_allclose([one[1] for one in pillars], car.roof)
        springs = [np.asarray(line.get_xydata()) for line in lines[4::2]]
        wheels = [np.asarray(line.get_xydata()) for line in lines[5::2]]
        np.testing.assert_allclose(springs, car.springs)
        np.testing.assert_allclose(wheels, car.wheels)
    assert {line.get_color() for line in (*still[:4], *still[4::2])} == {"#b8b8b8"}
    assert len({still[5].get_color(), moved[5].get_color(), moved[4].get_color()}) == 3
    assert [patch.get_fill() for patch in axes.patches] == [True, False] * 4
    plates = [np.asarray(patch.get_path().vertices)[:4] for patch in axes.patches]
    car, turned = at_rest(shape.geometry), outline(shape, 0.0)
    expected = [one for c in (car, turned) for one in (c.deck, c.deck, c.roof, c.roof)]
    np.testing.assert_allclose(plates, expected)
    margins = figure.subplotpars
    assert (margins.left, margins.right, margins.bottom) == (0.01, 0.99, 0.01)
    assert 0.85 <= margins.top <= 0.9  # two lines of title stand above


def test_what_is_no_panel_is_not_drawn() -> None:
    figure = figure_of(DamperPanel(()))
    other: Any = "m_s"
    with pytest.raises(TypeError, match="no drawing of a str"):
        draw(other, figure)
