from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import SampleGroup
from daq.sessions import Session
from daq.sim.car import NOISE
from dbc.finding import Finding, Severity
from dbc.samples import Quality
from identify.decays.onset import GUARD_S, decay_start_s
from identify.decays.usable import usable
from identify.trust.samples import sample_findings

from ..stress import BUMP_S, REST_S
from .campaigns import SEEDS, campaign, doubtful, with_group

Array = NDArray[np.float64]
CHANNEL = "hub_acc_rl"
AFTER_BUMP_S = REST_S + BUMP_S


def judged(session: Session) -> tuple[Finding, ...]:
    return tuple(sample_findings(session, usable(session).records))


def rear_left(session: Session, change: Callable[[Array, Array], Array]) -> Session:
    """Change the values of a hub in the bounce runs of the baseline, by time and value."""

    def changed(group: SampleGroup) -> SampleGroup:
        values = change(group.time_s, group.values[CHANNEL])
        return replace(group, values={**group.values, CHANNEL: values})

    return with_group(session, "baseline_bounce", CHANNEL, changed)


def quantised(session: Session, lsb: float) -> Session:
    def coarse(group: SampleGroup) -> SampleGroup:
        return replace(
            group, values={name: lsb * np.rint(v / lsb) for name, v in group.values.items()}
        )

    for channel in ("body_acc_z", "hub_acc_fl", "hub_acc_rl"):  # one of each device
        session = with_group(session, "", channel, coarse)
    return session


@pytest.mark.parametrize("seed", SEEDS)
def test_the_control_is_not_saturated(seed: int) -> None:
    assert judged(campaign("linear", seed)) == ()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_hub_that_ends_at_2_g_is_doubtful(seed: int) -> None:
    (finding,) = judged(campaign("saturation", seed))
    assert finding.severity is Severity.WARNING
    assert "at 19.61 m/s2" in finding.text
    assert "hub_acc_fl in added_bounce_1" in finding.text
    assert "hub_acc_fr" not in finding.text


def test_saturation_survives_the_steps_of_the_converter() -> None:
    session = quantised(campaign("saturation", 1), 0.005)
    assert doubtful(judged(session)) == ["saturation"]


def test_on_the_bump_it_is_harmless() -> None:
    """A steeper bump than the simulated one: the sensor ends at 60 m/s2, the decay at 46."""

    def steep(t_s: Array, values: Array) -> Array:
        on_bump = (t_s > REST_S) & (t_s < AFTER_BUMP_S - 0.02)
        return np.where(on_bump, np.minimum(3.0 * values, 60.0), values)

    assert judged(rear_left(campaign("linear", 1), steep)) == ()


@pytest.mark.parametrize(
    ("before_s", "found"), [(0.5 * GUARD_S, ["saturation"]), (2.5 * GUARD_S, [])]
)
def test_a_top_within_the_guard_before_the_decay_may_be_of_it(
    before_s: float, found: list[str]
) -> None:
    session = campaign("linear", 1)
    (record,) = (r for r in usable(session).records if r.label == "baseline_bounce_1")
    start_s = decay_start_s(record)

    def cut(t_s: Array, values: Array) -> Array:
        last = np.searchsorted(t_s, start_s - before_s)
        top = (np.arange(len(t_s)) <= last) & (np.arange(len(t_s)) > last - 5)
        return np.where(top, 3.0 * values.max(), values)

    said = [f for f in judged(rear_left(session, cut)) if "baseline_bounce_1" in f.text]
    assert [f.code for f in said] == found


def test_a_limit_that_the_decay_reaches_is_doubtful() -> None:
    session = rear_left(campaign("linear", 1), lambda _, values: np.minimum(values, 30.0))
    assert doubtful(judged(session)) == ["saturation"]


@pytest.mark.parametrize("lsb", [1e-4, 1e-3, 1e-2, 0.1, 1.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_quantisation_is_no_saturation(lsb: float, seed: int) -> None:
    """From a fine converter to one whose step hides all the noise."""
    assert judged(quantised(campaign("linear", seed), lsb)) == ()


def test_noise_may_repeat_the_highest_value_of_a_run() -> None:
    """A travel sensor with noise of 20 converter steps: one run in some thousand has such a top."""
    lsb = NOISE.hub_acceleration_m_s2 / 20.0

    def repeated(_: Array, values: Array) -> Array:
        values = lsb * np.rint(values / lsb)
        top = int(values.argmax())
        return np.where(np.abs(np.arange(len(values)) - top) <= 1, values[top], values)

    session = rear_left(quantised(campaign("linear", 1), lsb), repeated)
    assert judged(session) == ()


@pytest.mark.parametrize("lsb", [0.003, 0.01, 0.03, 0.1, 0.3])
def test_a_rounded_top_is_not_a_flat_one(lsb: float) -> None:
    """A slow wave without noise stays on the converter's highest step for a while."""

    def wave(group: SampleGroup) -> SampleGroup:
        t = group.time_s - AFTER_BUMP_S
        motion = np.where(t > 0, 10 * np.exp(-t) * np.sin(5.0 * t), 0.0)
        values: Array = lsb * np.rint(motion / lsb)
        if lsb == 0.3:
            assert (values == values.max()).sum() >= 3
        return replace(group, values={**group.values, CHANNEL: values})

    session = with_group(campaign("linear", 1), "", CHANNEL, wave)
    assert judged(session) == ()


@pytest.mark.parametrize(
    ("at_s", "found"), [(REST_S + 0.05, []), (AFTER_BUMP_S + 0.05, ["out_of_range"])]
)
def test_samples_out_of_range_are_reported(at_s: float, found: list[str]) -> None:
    def flagged(group: SampleGroup) -> SampleGroup:
        quality = group.quality.copy()
        quality[np.searchsorted(group.time_s, at_s)] |= Quality.OUT_OF_RANGE
        return replace(group, quality=quality)

    session = with_group(campaign("linear", 1), "added_roll_1", CHANNEL, flagged)
    said = judged(session)
    assert [finding.code for finding in said] == found
    assert all(f"{CHANNEL} in added_roll_1" in finding.text for finding in said)
