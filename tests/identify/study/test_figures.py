"""Figures 2 to 9 of the paper: closed forms, what the paper reads off them, and their drawings."""

from __future__ import annotations

from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np
import pytest

from daq.vehicle import PARAMETER_NAMES
from dbc.errors import InputError
from identify.study.campaign import Campaign, Outcome, noise_study
from identify.study.paper import (
    Attempt,
    fig2_study,
    fig8_study,
    fig9_study,
    mass_error_study,
    table3_study,
    taps,
)
from identify.study.result import CurvePanel, DotPanel, Study, svg

NAN = np.full(11, np.nan)
# Table 2: what the paper's simulation adds to every figure.
WILSON = {"a": -0.141, "b": -0.130, "k_sr": -0.078, "c_sf": -0.103}


def _ends(figure: str) -> dict[str, tuple[float, float]]:
    study = mass_error_study(figure)
    low, high = study.numbers("at_minus_5_percent"), study.numbers("at_plus_5_percent")
    return {name: (low[name], high[name]) for name in PARAMETER_NAMES}


def test_added_mass_lowers_every_mode_as_in_fig2() -> None:
    study = fig2_study()
    at_2 = list(study.numbers("at_2_percent").values())
    at_14 = list(study.numbers("at_14_percent").values())
    assert len(at_2) == len(at_14) == 7
    assert all(-1.05 <= change <= -0.95 for change in np.round(at_2, 2))
    assert all(-6.7 <= change <= -6.1 for change in at_14)
    for panel in study.panels[0]:
        assert isinstance(panel, CurvePanel)
        for curve in panel.curves:
            assert np.all(np.diff(curve.y) < 0.0)
            # An oscillator without damping goes with 1 / sqrt(1 + share); these are near it.
            share = curve.x / 100.0
            np.testing.assert_allclose(curve.y, 100 * ((1 + share) ** -0.5 - 1), rtol=0.08)


@pytest.mark.parametrize(
    ("figure", "wrong"),
    [("fig3", "m_s"), ("fig4", "I_yy"), ("fig5", "I_xx"), ("fig6", "m_uf"), ("fig7", "m_ur")],
)
def test_an_error_in_the_added_mass_goes_into_its_own_inertia(figure: str, wrong: str) -> None:
    ends = _ends(figure)
    for name in PARAMETER_NAMES[:5]:
        expected = (5.0, -5.0) if name == wrong else (0.0, 0.0)
        assert ends[name] == pytest.approx(expected, abs=1e-9)


def test_fig3_damping_by_hand() -> None:
    # Row 0 of C carries a factor 1 + d; 4 (x - d)^2 + 8 x^2 + 4 (2 x - 2 d)^2 is least at
    # x = 20 d / 28.
    ends = _ends("fig3")
    for name in ("c_sf", "c_sr"):
        assert ends[name] == pytest.approx((5 * 20 / 28, -5 * 20 / 28))


def test_fig3_as_the_paper_reads_it() -> None:
    ends = _ends("fig3")
    for name in ("k_sf", "k_sr", "c_sf", "c_sr"):
        assert ends[name] == pytest.approx((4.0, -4.0), abs=0.5)
    for name in ("a", "b", "t_f", "t_r"):
        assert ends[name][0] < -3.4
        assert ends[name][1] > 3.4
    assert ends["a"] == pytest.approx((-5.0, 5.0), abs=0.3)
    for name in ("k_tf", "k_tr"):
        assert max(map(abs, ends[name])) < 0.5


@pytest.mark.parametrize(("figure", "lengths"), [("fig4", ("a", "b")), ("fig5", ("t_f", "t_r"))])
def test_figs_4_and_5_move_only_their_lengths_by_half(
    figure: str, lengths: tuple[str, ...]
) -> None:
    # One of the two halves of K is wrong by 5 %: least squares takes the mean.
    for name, ends in _ends(figure).items():
        if name in PARAMETER_NAMES[5:]:
            assert ends == pytest.approx((2.5, -2.5) if name in lengths else (0, 0), abs=1e-9)


def test_the_papers_simulation_turns_2_5_into_its_2_4_and_2_6() -> None:
    ends = _ends("fig4")
    for name in ("a", "b"):
        assert round(ends[name][0] + WILSON[name], 1) == 2.4
        assert round(ends[name][1] + WILSON[name], 1) == -2.6


@pytest.mark.parametrize(("figure", "own", "other"), [("fig6", "f", "r"), ("fig7", "r", "f")])
def test_figs_6_and_7(figure: str, own: str, other: str) -> None:
    ends = _ends(figure)
    # By hand as in Fig. 3: 10 u + 4 v = 4 d and 10 v + 4 u = 0.
    assert ends[f"c_s{own}"] == pytest.approx((5 * 0.4 / 0.84, -5 * 0.4 / 0.84))
    assert ends[f"c_s{other}"] == pytest.approx((-2 * 0.4 / 0.84, 2 * 0.4 / 0.84))
    largest = max(max(map(abs, ends[name])) for name in PARAMETER_NAMES[5:])
    assert largest == max(map(abs, ends[f"k_t{own}"]))
    assert 5.2 < largest < 5.6


def _fig8() -> dict[str, dict[str, tuple[float, float]]]:
    study = fig8_study()
    result = {}
    for length in ("a", "b", "t_f", "t_r"):
        low = study.numbers(f"{length}_at_minus_5_percent")
        high = study.numbers(f"{length}_at_plus_5_percent")
        result[length] = {name: (low[name], high[name]) for name in low}
    return result


def test_fig8_as_the_paper_reads_it() -> None:
    by_length = _fig8()
    assert by_length["a"]["k_sf"] == pytest.approx((-4.8, 4.7), abs=0.15)
    assert by_length["a"]["c_sf"] == pytest.approx((-4.8, 4.7), abs=0.35)
    assert by_length["b"]["k_sr"] == pytest.approx((-5.8, 5.9), abs=0.25)
    assert by_length["b"]["c_sr"] == pytest.approx((-5.8, 5.9), abs=0.4)
    for name in ("k_sf", "c_sf"):
        assert by_length["t_f"][name] == pytest.approx((-0.74, 0.4), abs=0.17)
    for table in by_length.values():
        for name in ("k_tf", "k_tr"):
            assert max(map(abs, table[name])) < 0.7


def test_fig8_with_the_papers_own_simulation_error() -> None:
    t_r = _fig8()["t_r"]
    for name, printed in {"k_sr": (-0.48, 0.25), "c_sf": (-0.35, 0.15)}.items():
        low, high = t_r[name]
        assert (low + WILSON[name], high + WILSON[name]) == pytest.approx(printed, abs=0.011)


def test_fig9_filters_as_much_noise_as_its_weights_say() -> None:
    study = fig9_study(1000.0, 30.0, 1)
    before, after = study.numbers("noise_rms"), study.numbers("noise_filtered_rms")
    share = float(np.sqrt(np.sum(taps(1000.0) ** 2)))
    for name, signal in study.numbers("signal_rms").items():
        assert before[name] == pytest.approx(signal * 10**-1.5, rel=0.6)
        assert after[name] / before[name] == pytest.approx(share, rel=0.15)
    low, high = study.numbers("decay_db"), study.numbers("decay_filtered_db")
    assert all(high[name] > low[name] + 5.0 for name in low)


def test_fig9_refuses_what_it_cannot_show() -> None:
    with pytest.raises(InputError, match="16 Hz"):
        fig9_study(100.0, 30.0, 1)
    with pytest.raises(InputError, match="noise"):
        fig9_study(1000.0, np.inf, 1)


def _noise(n: int) -> Study:
    outcomes = [Outcome(np.full(15, float(i)), np.ones(15), 1.0, True) for i in range(n)]
    return noise_study(Campaign(), np.ones(15), outcomes)


def _table3() -> Study:
    return table3_study(Campaign(), [Attempt(NAN, np.full(11, 30.0), np.full(11, 0.3))])


@pytest.mark.parametrize(
    "study",
    [
        lambda: mass_error_study("fig3"),
        lambda: fig9_study(1000.0, 30.0, 1),
        lambda: _noise(3),
        lambda: _noise(0),
        _table3,
    ],
    ids=["fig3", "fig9", "noise", "noise of nothing", "table3"],
)
def test_every_word_of_a_study_is_in_its_figure(study: Callable[[], Study]) -> None:
    result = study()
    drawn = ElementTree.fromstring(svg(result)).iter("{http://www.w3.org/2000/svg}text")
    words = {"".join(element.itertext()) for element in drawn}
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
