"""Table 3: the paper's chain beside the likelihood."""

from __future__ import annotations

import numpy as np
import pytest

from dbc.errors import InputError
from identify.study.campaign import Campaign
from identify.study.tables import Attempt, attempt, table3_campaign, table3_study

NONE = np.full(11, np.nan)


def test_without_noise_every_route_is_exact_filter_or_not() -> None:
    clean = attempt(table3_campaign(1000.0, np.inf), 0)
    assert np.max(np.abs(clean.unfiltered)) < 1e-5
    assert np.max(np.abs(clean.filtered)) < 1e-4
    assert np.max(np.abs(clean.likelihood)) < 1e-3


def test_at_30_db_the_likelihood_holds_and_the_chain_does_not() -> None:
    noisy = attempt(table3_campaign(1000.0, 30.0), 1)
    assert np.max(np.abs(noisy.likelihood)) < 1.5
    for route in (noisy.filtered, noisy.unfiltered):
        assert np.max(np.abs(route)) > 10.0


def test_the_table_of_known_attempts() -> None:
    attempts = [
        Attempt(np.full(11, 10.0), np.full(11, -5.0), np.full(11, 0.1)),
        Attempt(np.full(11, -30.0), NONE, np.full(11, -0.3)),
        Attempt(NONE, NONE, np.full(11, 0.2)),
    ]
    study = table3_study(table3_campaign(1000.0, 30.0), attempts)
    assert set(study.numbers("chain_filtered_median_percent").values()) == {20.0}
    assert set(study.numbers("chain_filtered_worst_percent").values()) == {30.0}
    assert set(study.numbers("chain_unfiltered_worst_percent").values()) == {5.0}
    assert set(study.numbers("likelihood_median_percent").values()) == {0.2}
    assert "no answer in 1 of 3" in study.notes[0]
    assert "no answer in 2 of 3" in study.notes[1]
    assert "no answer in 0 of 3" in study.notes[2]


def test_the_papers_column_is_its_known_and_identified_columns() -> None:
    # Table 3 as printed: known, identified.
    printed = {
        "m_s": (1380, 1348.17),
        "I_yy": (2440, 2526.28),
        "I_xx": (380, 368.91),
        "m_uf": (40.5, 41.28),
        "m_ur": (45.4, 44.32),
        "k_sf": (17000, 17271.05),
        "k_sr": (22000, 21167.61),
        "k_tf": (192000, 187684.01),
        "k_tr": (192000, 194985.47),
        "c_sf": (1500, 1445.30),
        "c_sr": (1500, 1534.06),
    }
    column = table3_study(Campaign(), [Attempt(NONE, NONE, NONE)]).numbers("paper_percent")
    assert list(column) == list(printed)
    for name, (known, identified) in printed.items():
        assert column[name] == pytest.approx(abs(identified / known - 1) * 100, abs=0.003)


def test_no_answer_at_all_still_makes_a_table() -> None:
    study = table3_study(Campaign(), [Attempt(NONE, NONE, NONE)])
    assert all(np.isnan(x) for x in study.numbers("likelihood_worst_percent").values())


def test_a_rate_too_low_for_the_filter() -> None:
    with pytest.raises(InputError, match="100 Hz"):
        table3_campaign(100.0, 30.0)
