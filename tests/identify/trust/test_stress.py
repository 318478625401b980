"""The stress list: an error above 5 % that is not flagged is a defect, and so is a wrong cause."""

from __future__ import annotations

import pytest

from identify.fit.uncertainty import estimates
from identify.trust.finding import Verdict
from identify.trust.judge import judge

from ..stress import STRESSES, true_value
from .campaigns import doubtful, short_campaign, shortly_estimated

CAUSES = {
    # Half of the motion is spent sticking: a linear fit is too far off to name what it meets.
    "friction": "amplitude",
    "friction_mild": "friction_in_the_suspension",
    "damper": "dampers_stronger_in_rebound_than_in_compression",
    "damper_mild": "dampers_stronger_in_rebound_than_in_compression",
    "bars": "anti-roll_bars",
    "tyre_damping": "tyre_damping",
    "sides": "left_and_right_differ",
    "cg_offset": "CG_off_the_middle",
    "hubs_late_1ms": "hub_sensors_late",
    "hubs_late_5ms": "hub_sensors_late",
    "body_low_pass": "low-pass",
    "gain": "gain",
    "polarity": "gain",
    "unit": "gain",
    "saturation": "saturation",
    "lift_off_high": "lift_off",
    "early_20ms": "late_start",
    "second_bump": "odd_run",
    "hot_damper": "odd_run",
    "no_roll": "undetermined",
}
"""Stress to the gate that names it; the others are corrected."""
TEXTS = {
    "bars": "anti_roll_bars = true",
    "body_low_pass": "low-pass (near 20 Hz on body sensors",
    "gain": "gain of hub_acc_fl",
    "polarity": "gain of hub_acc_rr",
    "unit": "gain of hub_acc_fr",
    "saturation": "hub_acc_fl",
    "second_bump": "baseline_bounce_2",
    "hot_damper": "baseline_bounce_2",
    "no_roll": "I_xx",
}
"""What the finding must say of it."""
LONG = {
    "friction", "damper", "tyre_damping", "hubs_late_5ms", "polarity", "unit", "lift_off",
    "second_bump", "sides", "cg_offset", "low_pass", "early",
}  # fmt: skip
"""Stresses whose milder or like form stands beside them, or that `test_score_test` names."""
RIVALS = set(CAUSES.values()) - {"amplitude", "late_start", "undetermined"}
"""Gates that name a cause; a stress may set off only its own."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.long] if name in LONG else [])
        for name in STRESSES
        if name != "linear"
    ],
)
def test_each_stress_is_corrected_or_flagged_with_its_cause(name: str) -> None:
    result = shortly_estimated(name, 1)
    quality = judge(short_campaign(name, 1), result)
    values = dict(zip(result.box.names, result.box.values(result.fit.eta).tolist(), strict=True))
    errors = [abs(value / true_value(name, p) - 1.0) for p, value in values.items()]
    assert quality.verdict is not Verdict.OK or max(errors) < 0.05
    flagged = doubtful(quality.findings)
    cause = CAUSES.get(name)
    if cause is None:
        assert max(errors) < 0.05
    else:
        assert cause in flagged
        text = next(f.text for f in quality.findings if f.code == cause)
        assert TEXTS.get(name, "") in text
    assert RIVALS.intersection(flagged) <= {cause}
    if quality.verdict is not Verdict.OK:
        # Noise within three sigmas, and a cause that may move them by one.
        found = estimates(result.box, result.fit)
        for p in quality.survival.surviving:
            assert abs(found[p].value - true_value(name, p)) < 4.0 * found[p].std, p
        assert set(quality.survival.surviving) | set(quality.survival.lost) == set(values)
