"""Runs that are left out and predicted, and the words of parameters."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest

from identify.fit.cross_validation import Prediction
from identify.report.panels import PredictionPanel
from identify.report.prediction import prediction_data, prediction_section
from identify.report.words import parameter_words, plain

from .pages import at, picture, sources, tables, texts

PREDICTIONS = (
    Prediction("roll_1", 1.01, 1.05, 1.05, "k_sf", -1.234),
    Prediction("pitch_1", 1.0, 1.2, 1.1, "m_s", 5.0),
    Prediction("bounce_1", 0.99, nan, nan, "", nan),
)


def test_each_run_is_predicted_or_is_said_not_to_be() -> None:
    section = prediction_section(PREDICTIONS)
    (found,) = tables(section).values()
    assert texts(found) == [
        ["roll_1", "1.0100", "1.0500", "1.0500", "✓ at noise level", "k_sf", "-1.23"],
        ["pitch_1", "1.0000", "1.2000", "1.1000", "✕ not predicted", "m_s", "+5.00"],
        ["bounce_1", "0.99000", "", "", "the others do not determine all parameters", "", ""],
    ]
    assert sources(found)[0][1:] == [
        "left_out/roll_1/fitted", "left_out/roll_1/predicted", "left_out/roll_1/limit", "",
        "left_out/roll_1/parameter", "left_out/roll_1/moved",
    ]  # fmt: skip
    named = [source for row in sources(found) for source in row if source]
    assert all(at(prediction_data(PREDICTIONS), source) is not None for source in named)
    assert "Here 1 of 2 runs are predicted down to the noise." in section.lead
    assert section.lead.endswith(" For 1 the others do not determine the vehicle.")
    panel = picture(section, "prediction").panel
    assert isinstance(panel, PredictionPanel)
    assert panel.runs == ("roll_1", "pitch_1", "bounce_1")
    np.testing.assert_array_equal(panel.fitted, [1.01, 1.0, 0.99])
    np.testing.assert_array_equal(panel.predicted, [1.05, 1.2, nan])
    np.testing.assert_array_equal(panel.limit, [1.05, 1.1, nan])


def test_without_runs_that_are_left_out_there_is_a_sentence_and_no_table() -> None:
    section = prediction_section(())
    assert section.blocks == ()
    assert section.lead.endswith("Here 0 of 0 runs are predicted down to the noise.")
    assert prediction_data(()) == {"left_out": {}}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("I_yy", "pitch inertia"),
        ("t_f", "half width, front"),
        ("k_sf", "suspension spring, front"),
        ("k_tr", "tyre spring, rear"),
        ("k_afl", "anti-roll bar, front left"),
        ("c_sfr", "damper, front right"),
        ("m_url", "wheel mass, rear left"),
        ("c_trr", "tyre damping, rear right"),
        ("y_s", "CG left of the middle"),
    ],
)
def test_a_parameter_has_words(name: str, words: str) -> None:
    assert parameter_words(name) == words
    assert plain("rear_pitch_1") == "rear pitch 1"
