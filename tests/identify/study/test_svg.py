"""Figures as SVG: documents that parse, with words that can be read."""

from __future__ import annotations

from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np
import pytest

from identify.study.campaign import Campaign
from identify.study.drawing import svg
from identify.study.low_pass import fig9_study
from identify.study.noise import Outcome, noise_study
from identify.study.paper_figures import fig2_study, fig8_study, mass_error_study
from identify.study.result import CurvePanel, DotPanel, Study
from identify.study.tables import Attempt, table3_study

NAN = np.full(11, np.nan)
TEXT = "{http://www.w3.org/2000/svg}text"


def _noise(n: int) -> Study:
    outcomes = [Outcome(np.full(15, float(i)), np.ones(15), 1.0, True) for i in range(n)]
    return noise_study(Campaign(), np.ones(15), outcomes)


def _table3() -> Study:
    return table3_study(Campaign(), [Attempt(NAN, np.full(11, 30.0), np.full(11, 0.3))])


def _texts(document: str) -> list[ElementTree.Element]:
    return list(ElementTree.fromstring(document).iter(TEXT))


@pytest.mark.parametrize(
    "study",
    [
        fig2_study,
        lambda: mass_error_study("fig3"),
        fig8_study,
        lambda: fig9_study(1000.0, 30.0, 1),
        lambda: _noise(3),
        lambda: _noise(0),
        _table3,
    ],
    ids=["fig2", "fig3", "fig8", "fig9", "noise", "noise of nothing", "table3"],
)
def test_every_word_of_a_study_is_in_its_figure(study: Callable[[], Study]) -> None:
    result = study()
    words = {"".join(element.itertext()) for element in _texts(svg(result))}
    named = " ".join(words)
    for row in result.panels:
        for panel in row:
            assert {panel.title, panel.x_label} <= words
            match panel:
                case CurvePanel():
                    assert panel.y_label in words
                    assert all(curve.label in named for curve in panel.curves)
                case DotPanel():
                    assert set(panel.items) <= words
                    assert {series.label for series in panel.series} <= words


def test_the_same_study_draws_the_same_bytes() -> None:
    assert svg(fig2_study()) == svg(fig2_study())
