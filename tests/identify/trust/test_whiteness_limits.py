"""Where whiteness is judged: each limit from both sides, on samples made by hand."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from dbc.finding import Finding, Severity
from identify.decays.decay import ChannelGroup, FreeDecay, Record, Recording
from identify.fit.estimation import Estimation
from identify.fit.likelihood import Residuals
from identify.trust.whiteness import whiteness_findings

Array = NDArray[np.float64]
GROUP = ChannelGroup("g", (Channel("a", Quantity.BODY_ACCELERATION, "m/s2"),))
RATE_HZ = 1000.0


def wave(n: int, r: float) -> Array:
    """Return a wave whose samples are correlated by r with the one before, of power 1 / 2."""
    return np.asarray(np.cos(np.arccos(r) * np.arange(n) + 0.3))


def white(n: int, seed: int = 0) -> Array:
    """Return noise of power 1 / 2 whose correlation from sample to sample is nil to 1e-6."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(n)
    for _ in range(40):
        r = (noise[1:] @ noise[:-1]) / (noise @ noise)
        noise[1:] = noise[1:] - r * noise[:-1]
    return np.asarray(noise * np.sqrt(0.5 * n / (noise @ noise)))


def estimation(
    left: Array, rest: Array | None = None, fitted: float = 0.0, time_s: Array | None = None
) -> Estimation:
    """Return one run's residuals of one channel, and what the channel shows before a bump."""
    time = np.arange(len(left)) / RATE_HZ if time_s is None else time_s
    decay = FreeDecay("run", "baseline", 0.0, (Recording(GROUP, time, left[:, None]),))
    residuals = Residuals("run", {"a": left}, {"a": len(left) - fitted})
    records: tuple[Record, ...] = ()
    if rest is not None:
        # A tenth of a second of a hundred times the motion, and rest again.
        whole = np.concatenate([rest, 100.0 * wave(100, 0.9), 0.7 * white(200, 9)])
        whole_s = np.arange(len(whole)) / RATE_HZ
        records = (Record("run", "baseline", 0.1, (Recording(GROUP, whole_s, whole[:, None]),)),)
    return Estimation(
        cast(Any, None), records, cast(Any, None), (decay,), {"a": 0.7}, {}, (residuals,), 1.0
    )


def misfit(*given: Any, **more: Any) -> list[Finding]:
    return [f for f in whiteness_findings(estimation(*given, **more)) if f.code == "whiteness"]


@pytest.mark.parametrize(("n", "named"), [(475, False), (540, True)])
def test_a_correlation_counts_from_four_and_a_half_standard_deviations(n: int, named: bool) -> None:
    """Of n pairs one of 0.2 has 0.2 sqrt(n): 4.36 and 4.65.

    The first 0.3 s alone have 0.2 sqrt(300) = 3.5.
    """
    assert bool(misfit(wave(n, 0.2))) is named


@pytest.mark.parametrize(
    ("until", "words"), [(299, "the first 0.3 s"), (240, "the first 0.3 s"), (2000, "the decays")]
)
def test_what_is_over_early_is_said_to_be(until: int, words: str) -> None:
    """Samples of 1 kHz; white ones after the first so many."""
    left = white(2000)
    left[:until] = wave(until, 0.4)
    (finding,) = misfit(left)
    assert f"worst a in {words} " in finding.text


def test_the_early_window_ends_after_three_tenths_of_a_second() -> None:
    """A correlation from 0.3 s on is none of it: 0.4 of the last 140 of 2000 samples is too few."""
    left = white(2000)
    left[300:440] = wave(140, 0.4)
    assert misfit(left) == []
    left = white(2000)
    left[160:300] = wave(140, 0.4)
    assert misfit(left) == []  # 0.4 of 140 in 300: z = 3.2
    left[80:300] = wave(220, 0.4)
    assert len(misfit(left)) == 1  # z = 5.1


@pytest.mark.parametrize(("fitted", "named"), [(190.0, False), (215.0, True)])
def test_values_that_the_fit_took_out_are_given_back(fitted: float, named: bool) -> None:
    """What is fitted is smooth, so 200 of 2000 values hide a correlation of 0.1: z = 4.5.

    Early, a share of them only: 30 of 300 are 1.7.
    """
    assert bool(misfit(white(2000), fitted=fitted)) is named


def test_with_what_the_fit_took_out_the_correlation_is_that_of_the_noise() -> None:
    (finding,) = misfit(white(2000), fitted=400.0)
    assert "with a correlation of 0.20 from sample to sample and there is no rest" in finding.text


@pytest.mark.parametrize(("r", "gates"), [(0.19, []), (0.22, ["coloured_noise"])])
def test_noise_at_rest_is_coloured_from_four_and_a_half_standard_deviations(
    r: float, gates: list[str]
) -> None:
    """Of 495 pairs: the last 5 ms before the motion do not count, a mean is fitted: 4.3 and 4.9."""
    found = whiteness_findings(estimation(white(2000), wave(501, r)))
    assert [f.code for f in found] == gates


@pytest.mark.parametrize(("r", "severity"), [(0.247, Severity.NOTE), (0.262, Severity.WARNING)])
def test_intervals_too_narrow_by_three_tenths_are_doubtful(r: float, severity: Severity) -> None:
    """sqrt((1 + r) / (1 - r)) is 1.30 at r = 0.2565."""
    (finding,) = whiteness_findings(estimation(white(2000), wave(4001, r)))
    assert (finding.code, finding.severity) == ("coloured_noise", severity)


@pytest.mark.parametrize(("r", "named"), [(0.35, False), (0.40, True)])
def test_residuals_are_held_against_the_rest(r: float, named: bool) -> None:
    """Rest of 0.2 on 995 pairs, residuals of 2999: a standard deviation of 0.98 / 27.3 = 0.0358.

    4.5 of them above 0.2 are 0.361.
    """
    assert bool(misfit(wave(3000, r), wave(1001, 0.2))) is named


@pytest.mark.parametrize(("late", "pairs"), [(0.4, True), (0.6, False)])
def test_samples_half_a_period_off_make_no_pair(late: float, pairs: bool) -> None:
    """Of the last third, alternate ones are late by a share of the period.

    There, samples are alike two by two: 200 of 1199 pairs, z = 0.167 sqrt(1199) = 5.8.
    """
    time, left = np.arange(1200) / RATE_HZ, white(1200)
    time[801::2] += late / RATE_HZ
    left[800:] = np.repeat(white(200, 3), 2)
    assert bool(misfit(left, time_s=time)) is pairs


@pytest.mark.parametrize(("n", "judged"), [(104, False), (108, True)])
def test_rest_ends_five_milliseconds_before_the_motion(n: int, judged: bool) -> None:
    """A correlation is reported from a hundred pairs on: of 104 samples 98 are left, of 108 102."""
    found = whiteness_findings(estimation(white(2000), wave(n, 0.6)))
    assert [f.code for f in found] == ["coloured_noise"] * judged


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_unit_of_a_channel_does_not_matter(unit: float) -> None:
    one = estimation(wave(1000, 0.3), wave(1001, 0.0))
    (decay,), (left,), (record,) = one.decays, one.residuals, one.records
    (q,) = record.recordings
    scaled = Estimation(
        one.box,
        (Record("run", "baseline", 0.1, (Recording(GROUP, q.time_s, unit * q.values),)),),
        one.fit,
        (decay,),
        {"a": 0.7 * unit},
        {},
        (Residuals("run", {"a": unit * left.values["a"]}, left.freedom),),
        1.0,
    )
    (finding,) = whiteness_findings(scaled)
    assert "with a correlation of 0.30 from sample to sample but 0.00 at rest (z 6.7," in (
        finding.text
    )
