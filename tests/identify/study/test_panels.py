"""Curves and dots of the studies hold the numbers of their panel, and a sheet holds all of them."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from identify.study.figures import svg
from identify.study.figures.curves import draw_curves
from identify.study.figures.dots import draw_dots
from identify.study.result import Column, Curve, CurvePanel, DotPanel, Dots, Panel, Study, percent

from ..artists import bars, named, points, segments, ticks, upright

NAN = float("nan")


def curves(*drawn: Curve) -> Axes:
    axes = Figure().add_subplot()
    draw_curves(axes, CurvePanel("Errors", "error / %", "change / %", drawn))
    return axes


def line(label: str, ends: tuple[float, float], hue: int = 0, n: int = 2) -> Curve:
    return Curve(label, np.linspace(0.0, 10.0, n), np.linspace(*ends, n), hue)


def labels(axes: Axes) -> dict[str, float]:
    """Return the height of each label, in units of the diagram."""
    low, high = axes.get_ylim()
    found = {}
    for text in axes.texts:
        x, share = text.get_position()
        assert x == 1.02
        found[text.get_text()] = round(low + share * (high - low), 6)
    return found


def test_a_curve_is_drawn_with_its_points_and_its_name_at_its_end() -> None:
    axes = curves(
        line("m_s", (0.0, 100.0), 1),
        Curve("k", np.arange(3.0), np.array([0.0, 50.0, 40.0]), 2, True),
    )
    zero, first, second = axes.lines
    assert list(np.asarray(zero.get_ydata())) == [0.0, 0.0]
    assert points(first) == [(0.0, 0.0), (10.0, 100.0)]
    assert points(second) == [(0.0, 0.0), (1.0, 50.0), (2.0, 40.0)]
    assert (first.get_color(), second.get_color()) == ("#0072b2", "#d55e00")
    assert (first.get_linestyle(), second.get_linestyle()) == ("-", "--")
    assert (axes.get_title(), axes.get_xlabel(), axes.get_ylabel()) == (
        "Errors", "error / %", "change / %",
    )  # fmt: skip
    assert axes.get_xlim() == (0.0, 10.0)
    assert axes.get_ylim() == pytest.approx((-6.0, 106.0))
    assert labels(axes) == {"m_s": 100.0, "k": 40.0}
    assert [text.get_color() for text in axes.texts] == ["#0072b2", "#d55e00"]


@pytest.mark.parametrize(("n", "width"), [(100, 1.6), (101, 0.9)])
def test_a_curve_of_more_than_a_hundred_points_is_a_signal_and_thin(n: int, width: float) -> None:
    assert curves(line("m_s", (0.0, 1.0), n=n)).lines[1].get_linewidth() == width


@pytest.mark.parametrize(
    ("second", "hue", "n", "together"),
    [
        ((0.0, 98.7), 0, 2, True),
        ((0.0, 98.6), 0, 2, False),
        ((1.4, 100.0), 0, 2, False),
        ((0.0, 100.0), 1, 2, False),
        ((0.0, 100.0), 0, 3, False),
    ],
)
def test_curves_that_look_like_one_share_a_label(
    second: tuple[float, float], hue: int, n: int, together: bool
) -> None:
    """The diagram is 112 high, of which 1.2 % are 1.344."""
    axes = curves(line("a", (0.0, 100.0)), line("b", second, hue, n))
    assert [text.get_text() for text in axes.texts] == (["a, b"] if together else ["a", "b"])


def test_signals_never_share_a_label() -> None:
    same = [line(name, (0.0, 100.0), n=101) for name in ("a", "b")]
    assert [text.get_text() for text in curves(*same).texts] == ["a", "b"]
    short = [line(name, (0.0, 100.0), n=100) for name in ("a", "b")]
    assert [text.get_text() for text in curves(*short).texts] == ["a, b"]


@pytest.mark.parametrize(
    ("ends", "placed"),
    [
        # 6.2 % of 112 are 6.944: those that are closer move apart about their middle.
        ((100.0, 93.0), (100.0, 93.0)),
        ((100.0, 94.0), (100.472, 93.528)),
        ((94.0, 100.0), (93.528, 100.472)),
        ((100.0, 97.0, 94.0), (103.944, 97.0, 90.056)),
        ((100.0, 98.0, 50.0), (102.472, 95.528, 50.0)),
        ((100.0, 95.0, 88.5), (101.444, 94.5, 87.556)),
    ],
)
def test_labels_move_apart_as_little_as_need_be(
    ends: tuple[float, ...], placed: tuple[float, ...]
) -> None:
    drawn = [line(f"c{i}", (0.0, end), i) for i, end in enumerate(ends)]
    found = labels(curves(*drawn, Curve("top", np.arange(3.0), np.array([0.0, 100.0, 10.0]), 4)))
    assert [found[f"c{i}"] for i in range(len(ends))] == pytest.approx(placed, abs=1e-3)


def series(label: str, values: list[float], hue: int, reach: list[float] | None = None) -> Dots:
    return Dots(label, np.array(values), hue, None if reach is None else np.array(reach))


def dots(panel: DotPanel) -> Axes:
    axes = Figure().add_subplot()
    draw_dots(axes, panel)
    return axes


def test_dots_stand_on_the_line_of_their_item() -> None:
    printed, found = series("printed", [1.0, 2.0, NAN], 0), series("found", [1.5, -0.5, 3.0], 2)
    axes = dots(DotPanel("Errors", "error / %", ("m_s", "k_sf", "c_sf"), (printed, found)))
    first, second = named(axes, "printed"), named(axes, "found")
    assert np.asarray(first.get_ydata()).tolist() == [0.0, 1.0, 2.0]
    np.testing.assert_array_equal(np.asarray(first.get_xdata()), [1.0, 2.0, NAN])
    assert points(second) == [(1.5, 0.0), (-0.5, 1.0), (3.0, 2.0)]
    assert (first.get_marker(), second.get_marker()) == ("|", "o")
    assert (first.get_markersize(), second.get_markersize()) == (11.0, 4.5)
    assert (first.get_markeredgewidth(), second.get_markeredgewidth()) == (2.0, 0.0)
    assert second.get_color() == "#d55e00"
    assert ticks(axes) == ["m_s", "k_sf", "c_sf"]
    assert axes.get_ylim() == (2.6, -0.6)
    assert segments(axes) == [[[0.0, float(i)], [1.0, float(i)]] for i in range(3)]
    assert (axes.get_title(), axes.get_xlabel()) == ("Errors", "error / %")
    assert upright(axes) == [0.0]
    held = axes.get_legend()
    assert held is not None
    assert [text.get_text() for text in held.get_texts()] == ["printed", "found"]


def test_series_with_whiskers_are_spread_about_the_line_of_their_item() -> None:
    panel = DotPanel(
        "t", "x", ("m_s", "k_sf"),
        (
            series("a", [1.0, 2.0], 1, [3.0, 5.0]),
            series("b", [4.0, 6.0], 3),
            series("c", [7.0, 8.0], 4),
        ),
    )  # fmt: skip
    axes = dots(panel)
    assert points(named(axes, "a")) == [(1.0, -0.25), (2.0, 0.75)]
    assert points(named(axes, "b")) == [(4.0, 0.0), (6.0, 1.0)]
    assert points(named(axes, "c")) == [(7.0, 0.25), (8.0, 1.25)]
    _, whiskers = axes.collections
    paths = [np.asarray(path.vertices).tolist() for path in whiskers.get_paths()]
    assert paths == [[[1.0, -0.25], [3.0, -0.25]], [[2.0, 0.75], [5.0, 0.75]]]


@pytest.mark.parametrize(
    ("values", "zero_at"), [([2.0, 4.0], "left"), ([-4.0, -2.0], "right"), ([-1.0, 1.0], "inside")]
)
def test_zero_is_always_in_a_list_of_dots(values: list[float], zero_at: str) -> None:
    axes = dots(DotPanel("t", "x", ("a", "b"), (series("s", values, 1),)))
    low, high = axes.get_xlim()
    assert {"left": low == 0.0, "right": high == 0.0, "inside": low < -1.0 and high > 1.0}[zero_at]
    assert upright(axes) == [0.0]


def test_values_over_decades_stand_on_a_logarithmic_scale_without_a_zero() -> None:
    axes = dots(DotPanel("t", "x", ("a", "b"), (series("s", [0.01, 100.0], 1),), logarithmic=True))
    assert axes.get_xscale() == "log"
    assert upright(axes) == []
    written = axes.xaxis.get_major_formatter()
    assert [written(x, 0) for x in (0.01, 1.0, 100.0)] == ["0.01", "1", "100"]


def test_where_values_should_lie_is_a_band_without_a_zero() -> None:
    axes = dots(DotPanel("t", "x", ("a",), (series("s", [1.1], 1),), expected=(0.9, 1.2)))
    ((low, high, _),) = bars(axes)
    assert (low, high) == (0.9, 1.2)
    assert axes.patches[0].get_label() == "within chance"
    assert axes.get_xlim()[0] > 0.0
    assert upright(axes) == []


def study(*rows: tuple[Panel, ...]) -> Study:
    return Study(
        "A study", (Column("a", "A"), Column("b", "B")), (("x", 1.0), ("y", 2.0)), (), rows
    )


def size_in(document: str) -> tuple[float, float]:
    root = ElementTree.fromstring(document)
    width, height = (float(root.get(key, "").removesuffix("pt")) for key in ("width", "height"))
    return width / 72.0, height / 72.0


@pytest.mark.parametrize(
    ("n_items", "with_curves", "height"),
    [(1, False, 1.6), (15, False, 5.8), (1, True, 3.2), (15, True, 5.8)],
)
def test_a_row_of_a_sheet_is_as_high_as_its_highest_panel(
    n_items: int, with_curves: bool, height: float
) -> None:
    items = tuple(f"i{i}" for i in range(n_items))
    listed = DotPanel("dots", "x", items, (Dots("s", np.ones(n_items), 1),))
    drawn = CurvePanel("curves", "x", "y", (line("a", (0.0, 1.0)),))
    row: tuple[Panel, ...] = (listed, drawn) if with_curves else (listed,)
    assert size_in(svg(study(row))) == pytest.approx((9.0, height), abs=1e-3)
    assert size_in(svg(study(row, (drawn,)))) == pytest.approx((9.0, height + 3.2), abs=1e-3)


def test_a_row_begins_where_the_one_above_it_ends() -> None:
    listed = DotPanel("dots", "x", ("i",) * 15, (series("s", [1.0] * 15, 1),))
    drawn = CurvePanel("curves", "x", "y", (line("a", (0.0, 1.0)),))
    root = ElementTree.fromstring(svg(study((listed,), (drawn,))))
    texts = root.iter("{http://www.w3.org/2000/svg}text")
    (title,) = (text for text in texts if "".join(text.itertext()) == "curves")
    assert 5.8 < float(title.get("y", "nan")) / 72.0 < 6.2


@pytest.mark.parametrize(("second", "alike"), [("y", True), ("other", False)])
def test_curves_of_one_measure_side_by_side_are_on_one_scale(second: str, alike: bool) -> None:
    """Numbers at the upright axes: 80 is written on the first one only where the scale is one."""
    small = CurvePanel("small", "x", "y", (line("a", (0.0, 1.0)),))
    large = CurvePanel("large", "x", second, (line("b", (0.0, 80.0)),))
    root = ElementTree.fromstring(svg(study((small, large))))
    texts = ["".join(t.itertext()) for t in root.iter("{http://www.w3.org/2000/svg}text")]
    assert texts.count("80") == (2 if alike else 1)
    assert "A study" in "".join(root.itertext())


def test_a_column_of_a_study_is_found_by_its_key() -> None:
    one = study()
    assert one.column("b") == (1.0, 2.0)
    assert one.numbers("b") == {"x": 1.0, "y": 2.0}


def test_an_error_in_per_cent_is_that_of_the_known() -> None:
    known: NDArray[np.float64] = np.array([100.0, 4.0])
    np.testing.assert_allclose(percent([101.0, 3.0], known), [1.0, -25.0])


def test_the_points_of_a_curve_are_floats_that_cannot_be_changed() -> None:
    one = Curve("k", np.array([0, 1, 2]), np.array([5, 6, 7]))
    assert (one.x.dtype.name, one.y.dtype.name) == ("float64", "float64")
    assert not one.x.flags.writeable
    assert not one.y.flags.writeable
