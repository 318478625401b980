"""A channel in another unit or upside down is named with its factor, before elements are sought."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from daq.sessions import Session
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, first_estimate
from identify.fit.generic_vehicles import generic_vehicles
from identify.pipeline import grey_box, identify_parameters
from identify.trust.faults import wrong_channel
from identify.trust.finding import Verdict

from .campaigns import campaign, shortly_estimated, with_group


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
    ("channel", "factor"),
    [
        ("hub_acc_fl", 9.80665),  # its unit is stated as g, and it sends m/s2
        ("pitch_rate", 57.29578),
        ("body_acc_z", -1.0),
    ],
)
def test_a_channel_in_another_unit_is_named_first_with_its_factor(
    channel: str, factor: float
) -> None:
    result = identify_parameters(_scaled(channel, factor))
    assert result.quality.verdict is Verdict.REFUSED
    named = re.search(
        rf"likely cause: gain of {channel} \(it shows (\S+) times", str(result.quality.reasons[0])
    )
    assert named, result.quality.reasons
    assert float(named[1]) == pytest.approx(factor, rel=0.1)
    assert result.estimation is not None
    assert result.estimation.nonlinear is None


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
