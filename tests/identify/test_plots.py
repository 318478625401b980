"""Figures and tables for notebooks: each shows what it is given, and says why it cannot."""

from __future__ import annotations

import re
from collections.abc import Callable
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from dbc.words import InputError
from identify import Identification, ModalModel, StabilisationDiagram, identify, plots
from identify.numbers import half_width_percent
from tests.tui.batches import paper_session, refused_session

from .artists import upright


@pytest.fixture(scope="module")
def result() -> Identification:
    return identify(paper_session(1))


def _texts(figure: Figure) -> str:
    figure.savefig(BytesIO(), format="png")  # it can be drawn
    return "\n".join(text.get_text() for text in figure.findobj(Text) if isinstance(text, Text))


def test_decays_show_every_run_as_measured_and_what_is_left(result: Identification) -> None:
    figure = plots.decays(result)
    texts = _texts(figure)
    assert all(residual.label in texts for residual in result.residuals)
    estimation = result.estimation
    assert estimation is not None
    label, decay = result.residuals[0].label, estimation.decays[0]
    channel = next(c.name for c in decay.recordings[0].group.channels if f"{c.name}," in texts)
    column = [c.name for c in decay.recordings[0].group.channels].index(channel)
    fitted = decay.recordings[0].values[:, column] - result.residuals[0].values[channel]
    panels = (axes for part in figure.subfigs for axes in part.axes)
    axes = next(axes for axes in panels if any(channel in t.get_text() for t in axes.texts))
    drawn = np.asarray(axes.get_lines()[1].get_ydata(), dtype=np.float64)
    assert label == decay.label
    assert np.isin(np.round(drawn, 9), np.round(fitted, 9)).all()


def test_parameters_name_each_with_its_interval(result: Identification) -> None:
    texts = _texts(plots.parameters(result))
    for name, e in result.parameters.items():
        assert name in texts
        assert f"±{half_width_percent(e.value, e.low, e.high)}" in texts


@pytest.mark.parametrize("state", ["baseline", "added"])
def test_modes_name_each_with_its_frequency(result: Identification, state: str) -> None:
    texts = _texts(plots.modes(result, state))
    for name, frequency_hz in zip(
        result.mode_names[state], result.modal[state].frequencies_hz, strict=True
    ):
        shown = re.search(rf"{name}\n([0-9.]+) Hz", texts)
        assert shown
        assert float(shown[1]) == pytest.approx(frequency_hz, abs=6e-4)


def test_correlation_shows_each_pair(result: Identification) -> None:
    texts = _texts(plots.correlation(result)).splitlines()
    n = len(result.correlation.names)
    assert len([t for t in texts if t[:1] in "+-" and "." in t]) == n * (n - 1)


def test_stabilisation_puts_poles_over_their_rank() -> None:
    poles = 2 * np.pi * np.array([1.0, 1.0, 3.0, 10.0]) * np.exp(0.55j * np.pi)
    stable = np.array([True, True, False, True])
    rank = np.array([1, 2, 2, 2])
    figure = plots.stabilisation(
        StabilisationDiagram(rank, poles, np.ones((1, 4), complex), stable)
    )
    (axes,) = figure.axes
    drawn = {
        (round(x, 6), y)
        for line in axes.get_lines()
        for x, y in np.asarray(line.get_xydata(), dtype=np.float64).tolist()
    }
    assert {(1.0, 1.0), (1.0, 2.0), (3.0, 2.0), (10.0, 2.0)} <= drawn


@pytest.mark.parametrize(
    "plot", [plots.decays, plots.parameters, plots.modes, plots.dampers, plots.correlation]
)
def test_a_refused_session_has_no_figures(plot: Callable[[Identification], Figure]) -> None:
    with pytest.raises(InputError, match=r"no fit.*added mass"):
        plot(identify(refused_session(1)))


def test_an_unknown_mass_state_is_named(result: Identification) -> None:
    with pytest.raises(InputError, match="choose baseline, added"):
        plots.modes(result, "loaded")


@pytest.mark.parametrize(
    ("stable", "rank", "modes"),
    [
        ([True, True, True, True], [2, 4, 4, 4], [2.0, 4.0]),
        ([True, True, True, False], [2, 2, 2, 4], [1.0, 2.0]),
        ([False, False, False, False], [2, 2, 2, 4], []),
    ],
)
def test_modes_are_the_stable_poles_of_the_highest_rank(
    stable: list[bool], rank: list[int], modes: list[float]
) -> None:
    """Poles of 1, 2 and 4 Hz, and a third that does not swing."""
    poles = np.array([2.0j, 4.0j, -6.0 + 0.0j, 8.0j]) * complex(np.pi)
    diagram = StabilisationDiagram(
        np.array(rank), poles, np.ones((1, 4), complex), np.array(stable)
    )
    (axes,) = plots.stabilisation(diagram).axes
    assert upright(axes) == pytest.approx(modes)


# Tables of modes -------------------------------------------------------------------------------


class _Cells(HTMLParser):
    """Collects the texts of cells and paragraphs."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.open: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []  # well-formed

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)
        if tag in ("tr", "p", "caption"):
            self.rows.append([])

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.rows[-1].append(data)


def test_modes_show_what_they_are() -> None:
    # 2 Hz, 10 % damped, the second entry opposite in phase and half as large.
    size = 2 * np.pi * 2.0
    pole = size * complex(-0.1, np.sqrt(1 - 0.01))
    shown = _Cells(ModalModel(np.array([pole]), np.array([[1.0], [-0.5 + 0j]]))._repr_html_())
    assert shown.rows[-1] == ["1", "2.0000", "0.1000", "1.00 ∠ 0°", "0.50 ∠ 180°"]


def test_modes_show_deviations_where_they_are_known_and_the_angle_of_what_moves() -> None:
    """Poles of |3 + 4i| and |6 + 8i|; an entry of 1e-9 of the largest has no angle."""
    poles = np.array([-6 + 8j, -3 + 4j])
    shapes = np.array([[1.0, 0.9e-9j], [-0.25j, complex(0.5, -0.0)], [2e-9j, 1.0]])
    model = ModalModel(poles, shapes, np.array([0.123, 0.0456]), np.array([np.nan, 0.002]))
    shown = _Cells(model._repr_html_())
    assert shown.rows[0] == ["2 modes"]
    assert shown.rows[1] == [
        "mode", "frequency, Hz", "std", "damping ratio", "std", "entry 1", "entry 2", "entry 3",
    ]  # fmt: skip
    slow = ["1", "0.7958", "0.046", "0.6000", "0.002", "0.00 ∠ 0°", "0.50 ∠ 0°", "1.00 ∠ 0°"]
    fast = ["2", "1.5915", "0.12", "0.6000", "1.00 ∠ 0°", "0.25 ∠ -90°", "0.00 ∠ 90°"]
    assert shown.rows[2:] == [slow, fast]
