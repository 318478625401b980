from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dbc.finding import Severity
from identify.decays.decay import FreeDecay, Record, Recording
from identify.fit.estimation import Estimation
from identify.trust.residuals import whiteness_findings

from ..stress import REST_S
from .campaigns import SEEDS, by_gate, doubtful, estimated

Array = NDArray[np.float64]
CHANNEL = "body_acc_z"


def autoregressive(shape: int, r: float, sigma: float, rng: np.random.Generator) -> Array:
    """Noise whose samples are correlated by `r` with the one before."""
    noise = rng.standard_normal(shape)
    for k in range(1, shape):
        noise[k] = r * noise[k - 1] + np.sqrt(1.0 - r**2) * noise[k]
    return sigma * noise


def with_residuals(estimation: Estimation, change: Callable[[Array], Array]) -> Estimation:
    left = tuple(
        replace(r, values={**r.values, CHANNEL: change(r.values[CHANNEL])})
        for r in estimation.residuals
    )
    return replace(estimation, residuals=left)


def with_rest(estimation: Estimation, change: Callable[[Array], Array]) -> Estimation:
    """Change what a channel says at rest."""

    def changed(recording: Recording) -> Recording:
        names = [channel.name for channel in recording.group.channels]
        if CHANNEL not in names:
            return recording
        values = recording.values.copy()
        quiet, column = recording.time_s < REST_S, names.index(CHANNEL)
        values[quiet, column] = change(values[quiet, column])
        return Recording(recording.group, recording.time_s, values)

    def record(old: Record) -> Record:
        return replace(old, recordings=tuple(map(changed, old.recordings)))

    return replace(estimation, records=tuple(map(record, estimation.records)))


def coloured(r: float, seed: int) -> Callable[[Array], Array]:
    rng = np.random.default_rng(seed)

    def change(values: Array) -> Array:
        return np.asarray(values.mean() + autoregressive(len(values), r, values.std(), rng))

    return change


@pytest.mark.parametrize("seed", SEEDS)
def test_white_noise_has_no_finding(seed: int) -> None:
    assert whiteness_findings(estimated("linear", seed)) == ()


def test_a_misfit_that_chi2_hardly_shows_is_doubtful() -> None:
    """Hubs that are 1 ms late bend the fit of the body, and chi2/n is 1.04."""
    estimation = estimated("hubs_late_1ms", 1)
    assert estimation.chi2_per_n < 1.1
    (finding,) = whiteness_findings(estimation)
    assert (finding.code, finding.severity) == ("whiteness", Severity.WARNING)
    assert "at rest (z " in finding.text


@pytest.mark.parametrize(
    ("r", "severity", "factor"),
    # The mean of n samples correlated by r has the variance of (1 - r) / (1 + r) n white ones.
    [(0.6, Severity.WARNING, 2.0), (0.15, Severity.NOTE, 1.16)],
)
def test_noise_coloured_at_rest_and_in_the_residuals_narrows_the_intervals(
    r: float, severity: Severity, factor: float
) -> None:
    noisy = with_rest(estimated("linear", 1), coloured(r, 1))
    (finding,) = whiteness_findings(with_residuals(noisy, coloured(r, 2)))
    assert (finding.code, finding.severity) == ("coloured_noise", severity)
    assert CHANNEL in finding.text
    found = float(finding.text.split("narrow by up to ")[1].split(" ")[0])
    assert found == pytest.approx(factor, rel=0.06)


def test_residuals_more_coloured_than_the_rest_are_a_misfit_too() -> None:
    noisy = with_rest(estimated("linear", 1), coloured(0.15, 1))
    findings = by_gate(whiteness_findings(with_residuals(noisy, coloured(0.5, 2))))
    assert set(findings) == {"coloured_noise", "whiteness"}
    assert doubtful(findings.values()) == ["whiteness"]


def test_without_rest_colour_may_be_noise_or_misfit() -> None:
    estimation = estimated("linear", 1)
    moving = replace(
        estimation,
        records=tuple(
            replace(r, recordings=tuple(q.between(1.25, 9.0) for q in r.recordings))
            for r in estimation.records
        ),
        rest={},
    )
    assert whiteness_findings(moving) == ()
    (finding,) = whiteness_findings(with_residuals(moving, coloured(0.4, 4)))
    assert finding.severity is Severity.WARNING
    assert "or the noise is coloured" in finding.text


def test_the_steps_of_a_coarse_converter_are_not_judged() -> None:
    def coarse(values: Array) -> Array:
        slow = 0.02 * np.sin(np.arange(len(values)) / 30.0)
        return np.asarray(np.rint((9.80665 + slow) / 0.02) * 0.02)

    assert whiteness_findings(with_rest(estimated("linear", 1), coarse)) == ()


def test_a_gap_makes_no_pair() -> None:
    """Every fourth sample is lost, and those beside the gap are alike."""
    rng = np.random.default_rng(5)
    estimation = estimated("linear", 1)
    decays, left = [], []
    for decay, residuals in zip(estimation.decays, estimation.residuals, strict=True):
        recordings, values = [], dict(residuals.values)
        for q in decay.recordings:
            keep = np.arange(len(q.time_s)) % 4 != 0
            recordings.append(Recording(q.group, q.time_s[keep], q.values[keep]))
            for channel in q.group.channels:
                n = int(keep.sum())
                noise = 0.03 * rng.standard_normal(n)
                noise[3::3] = noise[2 : n - 1 : 3][: len(noise[3::3])]
                values[channel.name] = noise * estimation.noise[channel.name] / 0.03
        decays.append(replace(decay, recordings=tuple(recordings)))
        freedom = {name: float(len(column)) for name, column in values.items()}
        left.append(replace(residuals, values=values, freedom=freedom))
    gappy = replace(estimation, decays=tuple(decays), residuals=tuple(left))
    assert whiteness_findings(gappy) == ()
    assert doubtful(whiteness_findings(replace(gappy, decays=tuple(map(evened, decays)))))


def evened(decay: FreeDecay) -> FreeDecay:
    """Take the gaps out of the time stamps."""
    even = tuple(
        Recording(q.group, np.linspace(0.0, q.time_s[-1], len(q.time_s)), q.values)
        for q in decay.recordings
    )
    return replace(decay, recordings=even)
