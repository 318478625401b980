"""Faults of the bench that are named with their sizes: labels, channels, clocks, signs, axes."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from daq.runs import Run, SampleGroup
from daq.sessions import Session
from daq.vehicle import FORD_GRANADA
from dbc.words import Severity
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate, first_estimate, generic_vehicles
from identify.pipeline import grey_box, identify_parameters
from identify.trust.faults import swapped_labels, wrong_channel, wrong_sensors
from identify.trust.finding import Verdict
from tests.identify import stress
from tests.identify.stress import BODY, HUBS, TRAVELS, Stress, stress_session

from ...simulated.elements import SensorFault
from .campaigns import (
    by_gate,
    campaign,
    fitted,
    short_campaign,
    shortly_estimated,
    with_group,
    with_runs,
)


def _exchanged(session: Session, a: str, b: str) -> Session:
    """Return the session with the samples of two channels under each other's name."""
    other = {a: b, b: a}
    return with_runs(
        session,
        lambda run: replace(
            run,
            groups=tuple(
                replace(g, values={other.get(k, k): column for k, column in g.values.items()})
                for g in run.groups
            ),
        ),
    )


def test_a_swap_is_named_although_the_car_has_friction() -> None:
    swapped = _exchanged(short_campaign("friction", 1), "pitch_rate", "roll_rate")
    found = swapped_labels(fitted(swapped))
    assert found is not None
    assert found.finding.severity is Severity.ERROR
    assert "likely cause: pitch_rate and roll_rate swapped " in found.finding.text


_LONG = ("friction", "hubs_late_5ms", "hot_damper", "tyre_damping")


@pytest.mark.parametrize(
    "name",
    ["linear", *(pytest.param(name, marks=pytest.mark.long) for name in _LONG)],
)
def test_what_is_no_swap_is_not_taken_for_one(name: str) -> None:
    assert swapped_labels(shortly_estimated(name, 1)) is None


def _scaled(channel: str, factor: float) -> Session:
    return with_group(
        campaign("linear", 1),
        "",
        channel,
        lambda group: replace(
            group, values={**group.values, channel: factor * group.values[channel]}
        ),
    )


def _first_fit(session: Session) -> Estimation:
    records = usable(session).records
    return first_estimate(grey_box(session, records), records, generic_vehicles())


@pytest.mark.parametrize(
    ("factor", "wrong"), [(0.62, True), (0.75, False), (1.3, False), (1.5, True)]
)
def test_a_factor_near_one_is_a_matter_of_calibration(factor: float, wrong: bool) -> None:
    """Which the score test finds and sizes; the limits are 0.7 and 1.4."""
    estimation = _first_fit(_scaled("hub_acc_fl", factor))
    found = wrong_channel(estimation)
    assert (found is not None) is wrong
    if found is not None:
        assert found.name == "gain of hub_acc_fl"
        assert found.explained == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("name", ["friction_mild", "hubs_late_5ms"])
def test_what_all_channels_show_is_no_wrong_channel(name: str) -> None:
    assert wrong_channel(shortly_estimated(name, 1)) is None


def late_fit(name: str) -> Estimation:
    session = stress_session(name, 1, 100.0, travels=True, repeats=1)
    records = usable(session).records
    return estimate(grey_box(session, records), records, [FORD_GRANADA.to_array()])


def test_hubs_5_ms_late_are_sized_5_ms_beside_travels_that_are_on_time() -> None:
    *_, found = wrong_sensors(late_fit("hubs_late_5ms"), [])
    assert found.name == "hub sensors late"
    assert 4.8 < float(found.sizes.removesuffix(" ms")) < 5.2
    assert found.explained > 0.9


@pytest.mark.parametrize(
    ("channels", "name"),
    [
        (BODY, "body sensors late"),
        (TRAVELS, "travel sensors late"),
        (HUBS + TRAVELS, "hub sensors and travel sensors late"),
    ],
)
def test_the_kinds_that_are_late_are_named(
    channels: tuple[str, ...], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = Stress("8 ms late", faults=tuple(SensorFault(c, late_s=0.008) for c in channels))
    monkeypatch.setattr(stress, "STRESSES", {"late": late})
    found = next(
        one
        for one in wrong_sensors(late_fit("late"), [])
        if one.name == name and "against" not in one.sizes  # against the others, it is one kind
    )
    for size in found.sizes.split(", "):
        assert 7.6 < float(size.removesuffix(" ms").split()[-1]) < 8.4


JUMP_S = 0.1
AT_S = 2.0
"""Half of each run; the decays begin at about 1.1 s."""


def jumped(group: SampleGroup) -> SampleGroup:
    return replace(group, time_s=group.time_s + JUMP_S * (group.time_s > AT_S))


def lost(group: SampleGroup) -> SampleGroup:
    kept = (group.time_s <= AT_S) | (group.time_s > AT_S + JUMP_S)
    values = {name: column[kept] for name, column in group.values.items()}
    quality, t_ns = group.quality[kept], group.t_ns[kept]
    return replace(group, time_s=group.time_s[kept], t_ns=t_ns, quality=quality, values=values)


def with_clock(
    change: Callable[[SampleGroup], SampleGroup], names: set[str] | None, begins: str = ""
) -> Session:
    def of_run(run: Run) -> Run:
        if not run.label.startswith(begins):
            return run
        groups = (change(g) if names is None or g.name in names else g for g in run.groups)
        return replace(run, groups=tuple(groups))

    return with_runs(short_campaign("linear", 1), of_run)


def all_jump(at_s: float) -> Session:
    def change(group: SampleGroup) -> SampleGroup:
        return replace(group, time_s=group.time_s + JUMP_S * (group.time_s > at_s))

    return with_clock(change, None)


@pytest.mark.long
def test_clocks_that_all_jump_soon_after_the_bump_are_named_by_what_fits_after_it() -> None:
    """The bump ends at 1.2 s."""
    found = identify_parameters(all_jump(1.27))
    assert found.quality.findings[0].code == "clocks_that_jump"
    assert "all sensors by about 0.1 s in 6 of 6 runs; from there" in found.quality.reasons[0]


@pytest.mark.long
def test_a_jump_that_a_later_start_leaves_out_is_a_late_start() -> None:
    found = by_gate(identify_parameters(all_jump(1.22)).quality.findings)
    assert "late_start" in found
    assert "clocks_that_jump" not in found


def test_a_lost_piece_is_no_jump() -> None:
    found = identify_parameters(with_clock(lost, None))
    assert "clocks_that_jump" not in by_gate(found.quality.findings)
    assert found.quality.verdict == "ok"
    m_s = found.parameters["m_s"]
    whole = identify_parameters(short_campaign("linear", 1)).parameters["m_s"]
    assert np.isclose(m_s.value, whole.value, rtol=0.0, atol=m_s.high - m_s.value)


def _turned(run: Run, angle: float) -> Run:
    """Return a run as an IMU shows it that is turned to the left, as seen from above."""
    groups = []
    for group in run.groups:
        shown = dict(group.values)
        if "roll_rate" in shown:
            roll, pitch = shown["roll_rate"], shown["pitch_rate"]  # about x forward, y to the left
            shown["roll_rate"] = np.cos(angle) * roll + np.sin(angle) * pitch
            shown["pitch_rate"] = np.cos(angle) * pitch - np.sin(angle) * roll
        groups.append(replace(group, values=shown))
    return replace(run, groups=tuple(groups))


@pytest.mark.parametrize("angle_deg", [pytest.param(5.0, marks=pytest.mark.long), -2.0])
def test_the_angle_of_a_turned_imu_is_found(angle_deg: float) -> None:
    angle = np.radians(angle_deg)
    result = identify_parameters(
        with_runs(short_campaign("linear", 1), lambda run: _turned(run, angle))
    )
    assert result.quality.verdict is Verdict.DOUBTFUL
    text = by_gate(result.quality.findings)["IMU_turned_about_z"].text
    assert "with its x axis along the car" in text
    size, half = re.findall(r"body_acc_z (\S+) ± (\S+) deg", text)[0]
    # To first order, and what remains of a large turn widens nothing.
    assert abs(float(size) - angle_deg) < max(2.0 * float(half), 0.03 * abs(angle_deg))
    assert result.forces is None  # no element of the car is sought for a fault of the bench
