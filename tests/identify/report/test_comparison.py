"""The page of a comparison: what changed first, and the decays over each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from identify import Identification, Judgement
from identify.compare import Comparison, compare
from identify.fit.estimation import Estimation
from identify.fit.uncertainty import estimates
from identify.report.blocks import Gallery, Table
from identify.report.comparison import comparison_sections
from identify.report.decays import overlay_drawing, overlay_gallery
from identify.report.figure import figure_of
from identify.report.html import comparison_html

from ..changes import session
from .pages import drawn


def held(fits: list[Estimation]) -> Comparison:
    results = [
        Identification(Judgement((), 1.0), {}, parameters=estimates(e.box, e.fit), estimation=e)
        for e in fits
    ]
    return compare([f"session {i + 1}" for i in range(len(fits))], results)


@pytest.fixture(scope="module")
def fits() -> list[Estimation]:
    return [session({}, 1), session({"c_sf": 0.03}, 2)]


def test_the_table_and_the_document_name_the_change(fits: list[Estimation]) -> None:
    comparison = held(fits)
    document = comparison.document()
    assert document["change"]["sentence"].startswith("Changed: c_sf (+2.85")
    first, *_ = comparison_sections(comparison)
    table = next(b for b in first.blocks if isinstance(b, Table) and "joint" in b.title)
    ((name, kind, by, *_, share, chance),) = table.rows
    assert chance.text == "below 1e-09"  # 3e-79
    assert (name.text, kind.text, share.text) == ("c_sf", "differs", "+2.85 %")
    assert by.source == "change/named/0/changes/0"
    assert document["change"]["named"][0]["changes"][0]["value"] == pytest.approx(43.865, abs=1e-2)
    assert "all else is unchanged: chi2 35.6 on 27" in table.note
    one = comparison.parameters[0]
    rows = tuple(
        replace(row, differences=tuple(replace(d, significant=row is one) for d in row.differences))
        for row in comparison.parameters
    )
    named = replace(comparison, parameters=rows)
    page = comparison_html(named)
    assert "Stated differently" not in page
    other = comparison_html(replace(named, unlike=("vehicle Golf in a; Polo in b",)))
    assert "Stated differently: is it one car" in other
    assert "vehicle Golf in a; Polo in b" in other
    assert "c_sf (+2.85 ± 0.30 %)" in page
    assert f"<dd>1 of {len(named.quantities)}</dd>" in page
    assert f"<strong>Differ:</strong> {one.name}</p>" in page
    assert "<strong>Drift:</strong>" not in page


def test_where_nothing_changed_the_table_says_so() -> None:
    comparison = held([session({}, 1), session({}, 4)])
    first, *_ = comparison_sections(comparison)
    table = next(b for b in first.blocks if isinstance(b, Table) and "joint" in b.title)
    assert [row[0].text for row in table.rows] == ["Nothing differs beyond chance."]
    assert "everything is unchanged" in table.note


def test_each_run_of_both_is_drawn_over_the_other(fits: list[Estimation]) -> None:
    gallery = overlay_gallery(["before", "after"], fits)
    assert isinstance(gallery, Gallery)
    assert len(gallery.pictures) == 6
    title, _, curves = drawn(gallery.pictures[0])
    channel, _, _ = title.partition(", ")
    names = [c.name for c in fits[0].decays[0].recordings[0].group.channels]
    for fit, curve in zip(fits, curves, strict=True):
        recording = fit.decays[0].recordings[0]
        early = recording.time_s < 1.5
        measured = recording.values[early, names.index(channel)]
        apart = curve[1] - measured  # a constant, of the first session none
        np.testing.assert_allclose(apart, apart[0], atol=1e-12)
        assert np.mean(curve[1]) == pytest.approx(np.mean(curves[0][1]), abs=1e-9)
    np.testing.assert_array_equal(curves[0][1], measured_first(fits, channel))
    figure = figure_of(gallery.pictures[0].drawing)
    (axes,) = figure.axes
    assert [line.get_label() for line in axes.lines] == ["before", "after"]


@pytest.mark.parametrize("n", [2, 4])
def test_channel_and_names_of_sessions_stand_above_the_curves(n: int) -> None:
    labels = tuple(f"2026-11-2{i}-morning/session_000{i}" for i in range(n))
    curve = np.array([[0.0, 1.5], [-0.045, 0.02]])
    figure = figure_of(overlay_drawing("travel_rr, m", labels, (curve,) * n))
    (axes,) = figure.axes
    legend = axes.get_legend()
    assert legend is not None
    assert legend.get_title().get_text() == "travel_rr, m"
    assert [len(text.get_text()) for text in legend.get_texts()] == [20] * n
    figure.canvas.draw()
    box = legend.get_window_extent()
    assert axes.bbox.y1 <= box.y0 < box.y1 <= figure.bbox.y1
    assert axes.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1


def measured_first(fits: list[Estimation], channel: str) -> NDArray[np.float64]:
    """Return what the first session measured in the first 1.5 s of its first decay."""
    recording = fits[0].decays[0].recordings[0]
    names = [c.name for c in recording.group.channels]
    first: NDArray[np.float64] = recording.values[recording.time_s < 1.5, names.index(channel)]
    return first


def test_a_sensor_whose_zero_lies_elsewhere_is_drawn_over_the_other(
    fits: list[Estimation],
) -> None:
    """5 mm of a travel's zero are no change of the car, and the fit has a constant for them."""
    decay = fits[1].decays[0]
    moved = tuple(replace(r, values=r.values + 0.5) for r in decay.recordings)
    other = replace(fits[1], decays=(replace(decay, recordings=moved), *fits[1].decays[1:]))
    plain, shifted = (overlay_gallery(["a", "b"], [fits[0], one]) for one in (fits[1], other))
    assert plain is not None
    assert shifted is not None
    (_, _, curves), (_, _, others) = (drawn(one.pictures[0]) for one in (plain, shifted))
    np.testing.assert_allclose(others[1][1], curves[1][1], atol=1e-9)


def test_sessions_without_a_run_in_common_have_no_gallery(fits: list[Estimation]) -> None:
    assert overlay_gallery([], []) is None
