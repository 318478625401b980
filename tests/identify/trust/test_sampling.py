from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import Losses, RunStatus, SampleGroup
from daq.sessions import Session
from dbc.finding import Finding, Severity
from identify.decays.decay import record_of
from identify.decays.usable import usable
from identify.trust.samples import sample_findings

from ..stress import BUMP_S, REST_S
from .campaigns import SEEDS, by_gate, campaign, doubtful, with_group, with_runs

Array = NDArray[np.float64]
HUBS_FRONT = "hub_acc_fl"
AFTER_BUMP_S = REST_S + BUMP_S


def judged(session: Session) -> tuple[Finding, ...]:
    return tuple(sample_findings(session, usable(session).records))


def found(session: Session) -> dict[str, Finding]:
    return by_gate(judged(session))


def kept(group: SampleGroup, keep: NDArray[np.bool_]) -> SampleGroup:
    return SampleGroup(
        group.name,
        group.time_s[keep],
        group.t_ns[keep],
        {name: column[keep] for name, column in group.values.items()},
        group.quality[keep],
    )


def without(session: Session, label: str, begin_s: float, end_s: float) -> Session:
    """Lose what the front hubs say between two times of the runs whose label begins so."""
    return with_group(
        session,
        label,
        HUBS_FRONT,
        lambda g: kept(g, (g.time_s < begin_s) | (g.time_s > end_s)),
    )


def retimed(group: SampleGroup, time_s: Array) -> SampleGroup:
    return replace(group, time_s=time_s, t_ns=np.rint(time_s * 1e9).astype(np.int64))


def revalued(group: SampleGroup, channel: str, values: Array) -> SampleGroup:
    return replace(group, values={**group.values, channel: values})


@pytest.mark.parametrize("seed", SEEDS)
def test_even_complete_sampling_has_no_finding(seed: int) -> None:
    assert judged(campaign("linear", seed)) == ()


def test_a_gap_in_the_wheels_motion_is_doubtful() -> None:
    begin = AFTER_BUMP_S + 0.05
    session = without(campaign("linear", 1), "added_roll_2", begin, begin + 0.04)
    finding = found(session)["gaps"]
    assert finding.severity is Severity.WARNING
    assert "hub_acc_fl in added_roll_2;" in finding.text
    assert "45 ms (limit 20)" in finding.text  # 8 of 5 ms lost: 9 intervals


def test_a_gap_that_begins_on_the_bump_and_ends_in_the_decay_is_seen() -> None:
    lost = without(campaign("linear", 1), "added_roll_2", AFTER_BUMP_S - 0.05, AFTER_BUMP_S + 0.05)
    assert doubtful(judged(lost)) == ["gaps"]


@pytest.mark.parametrize("begin_s", [REST_S - 0.2, AFTER_BUMP_S + 0.4])
def test_a_gap_elsewhere_is_no_doubt(begin_s: float) -> None:
    session = without(campaign("linear", 1), "added_roll_2", begin_s, begin_s + 0.04)
    assert doubtful(judged(session)) == []


def test_slow_sampling_is_no_gap() -> None:
    session = campaign("linear", 1)
    slow = with_group(session, "", HUBS_FRONT, lambda g: kept(g, np.arange(len(g.time_s)) % 5 == 0))
    assert judged(slow) == ()


@pytest.mark.parametrize(("share", "gates"), [(0.01, []), (0.2, ["lost_samples"])])
def test_losses_are_doubtful_only_if_large(share: float, gates: list[str]) -> None:
    rng = np.random.default_rng(4)

    def lossy(group: SampleGroup) -> SampleGroup:
        late = group.time_s > AFTER_BUMP_S + 0.3
        return kept(group, ~late | (rng.random(len(late)) > share))

    session = with_group(campaign("linear", 1), "baseline", HUBS_FRONT, lossy)
    findings = found(session)
    assert set(findings) == {"lost_samples"}
    assert doubtful(findings.values()) == gates
    assert "and 3 more" in findings["lost_samples"].text  # six runs, three named


def test_unusable_samples_are_lost_ones() -> None:
    def unusable(group: SampleGroup) -> SampleGroup:
        values = group.values[HUBS_FRONT].copy()
        values[200::4] = np.nan
        return revalued(group, HUBS_FRONT, values)

    session = with_group(campaign("linear", 1), "baseline_bounce_1", HUBS_FRONT, unusable)
    assert doubtful(judged(session)) == ["lost_samples"]
    assert found(session)["lost_samples"].text.startswith("25% ")


def test_random_sampling_is_legal() -> None:
    rng = np.random.default_rng(6)

    def random(group: SampleGroup) -> SampleGroup:
        return retimed(group, np.sort(rng.uniform(0.0, 4.0, len(group.time_s))))

    session = with_group(campaign("linear", 1), "baseline_bounce_1", HUBS_FRONT, random)
    assert "lost_samples" not in found(session)


def test_a_channel_that_some_runs_lack_is_named() -> None:
    def lacking(group: SampleGroup) -> SampleGroup:
        values = {name: v for name, v in group.values.items() if name != HUBS_FRONT}
        return replace(group, values=values)

    session = with_group(campaign("linear", 1), "baseline_pitch_2", HUBS_FRONT, lacking)
    findings = found(session)
    assert set(findings) == {"missing_channels"}
    assert findings["missing_channels"].severity is Severity.NOTE
    assert "hub_acc_fl in baseline_pitch_2;" in findings["missing_channels"].text


@pytest.mark.parametrize("from_s", [0.0, AFTER_BUMP_S + 0.1])
def test_a_channel_frozen_in_one_run_is_doubtful(from_s: float) -> None:
    def frozen(group: SampleGroup) -> SampleGroup:
        values = group.values[HUBS_FRONT]
        last = values[np.searchsorted(group.time_s, from_s)]
        return revalued(group, HUBS_FRONT, np.where(group.time_s < from_s, values, last))

    session = with_group(campaign("linear", 1), "added_bounce_1", HUBS_FRONT, frozen)
    assert set(found(session)) == set(), "the run is left out"
    records = [record_of(run, session.channels) for run in session.runs]
    findings = by_gate(sample_findings(session, records))
    assert set(findings) == {"stuck_channels"}
    assert findings["stuck_channels"].severity is Severity.WARNING
    assert "hub_acc_fl in added_bounce_1;" in findings["stuck_channels"].text


@pytest.mark.parametrize("lsb", [0.001, 0.01, 0.1])
def test_a_coarse_quiet_channel_is_not_stuck(lsb: float) -> None:
    """The roll rate of a bounce run shows nothing but the steps of the converter."""
    session = with_group(
        campaign("linear", 2),
        "",
        "roll_rate",
        lambda g: revalued(g, "roll_rate", lsb * np.rint(g.values["roll_rate"] / lsb)),
    )
    assert judged(session) == ()


def test_losses_counted_by_the_recorder_are_reported() -> None:
    session = with_runs(
        campaign("linear", 1),
        lambda run: replace(run, losses=Losses(counter_gaps=2, crc_bad=1, unknown_id=50)),
    )
    findings = found(session)
    assert set(findings) == {"frame_losses"}
    assert findings["frame_losses"].severity is Severity.NOTE
    assert "36 frames" in findings["frame_losses"].text
    assert "3 in baseline_bounce_1" in findings["frame_losses"].text


def test_rejected_runs_do_not_count() -> None:
    begin = AFTER_BUMP_S + 0.05
    spoilt = without(campaign("linear", 1), "added_roll_2", begin, begin + 0.04)
    session = with_runs(
        spoilt,
        lambda run: replace(run, status=RunStatus.REJECTED) if run.label == "added_roll_2" else run,
    )
    assert judged(session) == ()
