"""The limits of the time stamps, each from both sides, on stretches of samples made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dbc.finding import Severity
from identify.trust.format import listed
from identify.trust.sampling import _gaps, _jitter, _lost, _Stretch


def stretch(time_s: NDArray[np.floating], period_s: float) -> _Stretch:
    return _Stretch("HUB in run_1", np.asarray(time_s, dtype=np.float64), period_s)


def gapped(period_s: float, start_s: float, length_s: float) -> _Stretch:
    """Return even samples from before the decay on, none within a gap."""
    time_s = np.arange(-1, 1000) * period_s
    keep = (time_s <= start_s + 1e-9) | (time_s >= start_s + length_s - 1e-9)
    return stretch(time_s[keep], period_s)


@pytest.mark.parametrize(
    ("period_s", "start_s", "length_s", "bad"),
    [
        (0.001, 0.05, 0.019, False),
        (0.001, 0.05, 0.021, True),
        (0.001, -0.001, 0.021, True),  # on the bump
        (0.001, 0.199, 0.021, True),
        (0.001, 0.2, 0.021, False),
        (0.01, 0.05, 0.03, False),  # two lost in a row
        (0.01, 0.05, 0.04, True),
    ],
)
def test_a_gap_while_the_wheels_move(
    period_s: float, start_s: float, length_s: float, bad: bool
) -> None:
    found = list(_gaps([gapped(period_s, start_s, length_s)]))
    assert [(f.code, f.severity) for f in found] == [("gaps", Severity.WARNING)] * bad


def test_the_longest_gap_is_named_first_with_its_limit() -> None:
    short, long = gapped(0.001, 0.05, 0.03), gapped(0.01, 0.05, 0.06)
    (finding,) = _gaps([short, long])
    assert finding.text.startswith("no sample for 60 ms (limit 35) in the first 0.2 s")
    (finding,) = _gaps([short])
    assert finding.text.startswith("no sample for 30 ms (limit 20) in the first 0.2 s")


def losing(lost: int, n: int = 1000) -> _Stretch:
    """Return a clock of 1 ms of which every so many-th sample is missing, `lost` in all."""
    gone = np.round(np.linspace(5, n - 5, lost)).astype(int)
    return stretch(np.delete(np.arange(n), gone) * 1e-3, 1e-3)


@pytest.mark.parametrize(
    ("lost", "severity"), [(99, Severity.NOTE), (101, Severity.WARNING), (0, None)]
)
def test_a_tenth_of_the_samples_may_be_missing(lost: int, severity: Severity | None) -> None:
    part = losing(lost)
    assert part.lost_share == pytest.approx(lost / 1000)
    found = list(_lost([losing(3), part] if lost else [part]))
    assert [f.severity for f in found] == ([] if severity is None else [severity])
    if severity is Severity.NOTE:
        assert found[0].text.startswith("up to 9.9% of the samples are missing (limit 10%)")
    if severity is Severity.WARNING:
        assert found[0].text.startswith("10% of the samples are missing (limit 10%): HUB")


def test_a_single_sample_that_is_missing_is_not_stated_as_none() -> None:
    (found,) = _lost([losing(1, n=5000)])
    assert found.text.startswith("up to 0.02% of the samples are missing")


def scattered(jitter_s: float, period_s: float) -> _Stretch:
    """Return stamps that are early and late in turn: intervals scatter by 2 j, stamps by sqrt 2 j.

    The scatter of the stamps is that of the intervals over the square root of two.
    """
    late = np.where(np.arange(1001) % 2, jitter_s, -jitter_s) / np.sqrt(2.0)
    return stretch(np.arange(1001) * period_s + late, period_s)


@pytest.mark.parametrize(("jitter_s", "noted"), [(0.9e-4, False), (1.1e-4, True)])
def test_a_scatter_of_a_tenth_of_a_millisecond_is_noted(jitter_s: float, noted: bool) -> None:
    part = scattered(jitter_s, 0.01)
    assert part.jitter_s == pytest.approx(jitter_s, rel=1e-3)
    found = list(_jitter([scattered(1e-5, 0.01), part]))
    assert [(f.code, f.severity) for f in found] == [("jitter", Severity.NOTE)] * noted
    if noted:
        assert "scatter by 0.11 ms about an even clock of 10 ms: HUB;" in found[0].text


@pytest.mark.parametrize(("share", "even"), [(0.11, True), (0.13, False)])
def test_times_that_scatter_by_an_eighth_of_the_period_know_of_no_clock(
    share: float, even: bool
) -> None:
    part = scattered(share * 0.01, 0.01)
    assert part.even is even
    spread = np.where(np.arange(1001) % 2, 1, -1) * share * 0.01 / np.sqrt(2.0)
    lossy = stretch(np.delete(np.arange(1001) * 0.01 + spread, [500]), 0.01)
    assert (lossy.lost_share > 0.0) is even


def test_a_sample_that_comes_twice_is_no_loss() -> None:
    double = stretch(np.array([0.0, 0.01, 0.02, 0.0201, 0.03, 0.04, 0.05]), 0.01)
    assert double.jitter_s == pytest.approx(
        float(np.std([0, 0, 0.0001 - 0.01, -0.0001, 0, 0])) / np.sqrt(2.0)
    )
    assert gapped(0.01, 5.0, 0.03).lost_share == pytest.approx(2 / 1001)


def test_three_places_are_listed_and_the_others_counted() -> None:
    assert listed(["a", "b", "c"]) == "a, b, c"
    assert listed(["a", "b", "a", "c", "d", "e"]) == "a, b, c and 2 more"


@pytest.mark.parametrize(
    ("sigma_s", "severity"),
    [(None, Severity.NOTE), (2.9e-4, Severity.WARNING), (3.1e-4, Severity.NOTE)],
)
def test_arrivals_that_scatter_more_than_is_stated_are_doubtful(
    sigma_s: float | None, severity: Severity
) -> None:
    (finding,) = _jitter([replace(scattered(3e-4, 0.01), arrival_sigma_s=sigma_s)])
    assert finding.severity is severity
    assert finding.code == ("arrival_times" if severity is Severity.WARNING else "jitter")
