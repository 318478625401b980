"""Which sensor fault is named: a channel alone, lateness or a low-pass."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from identify.trust import sensor_faults
from identify.trust.refit import Explanation, first_repeats, largest_shift
from identify.trust.sensor_faults import _kind, _late_ms, sensor_explanations

ONE: Any = SimpleNamespace(fit=SimpleNamespace(eta=None))


def of(name: str, explained: float) -> Explanation:
    return Explanation(name, "", "", explained, 0.0, "k_sf", {})


def ranked(
    monkeypatch: pytest.MonkeyPatch, alone: dict[str, float], late: float, slow: float
) -> list[str]:
    """Return the faults in their order, of channels that explain so much each left out alone."""
    monkeypatch.setattr(sensor_faults, "refit", lambda *_: None)
    left_out = lambda _, __, name: of(name, alone[name])  # noqa: E731
    monkeypatch.setattr(sensor_faults, "_left_out", left_out)
    monkeypatch.setattr(sensor_faults, "_late", lambda *_: [of("hub sensors late", late)])
    monkeypatch.setattr(sensor_faults, "_slow", lambda *_: [of("low-pass", slow)])
    return [found.name for found in sensor_explanations(ONE, list(alone))]


@pytest.mark.parametrize(("share", "compared"), [(0.96, True), (0.98, False)])
def test_a_channel_with_which_nearly_all_goes_needs_no_comparison(
    monkeypatch: pytest.MonkeyPatch, share: float, compared: bool
) -> None:
    found = ranked(monkeypatch, {"a": share}, 0.2, 0.1)
    assert found == (["low-pass", "hub sensors late", "a"] if compared else ["a"])


def test_the_first_channel_with_which_nine_tenths_go_is_the_wrong_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert ranked(monkeypatch, {"a": 0.89, "b": 0.91, "c": 0.96}, 0.2, 0.1)[-1] == "b"
    assert ranked(monkeypatch, {"a": 0.89}, 0.2, 0.1) == ["low-pass", "hub sensors late"]
    # The four most suspected ones are tried.
    five = {"a": 0.1, "b": 0.1, "c": 0.1, "d": 0.1, "e": 0.99}
    assert "e" not in ranked(monkeypatch, five, 0.2, 0.1)
    assert "d" in ranked(monkeypatch, five | {"d": 0.99}, 0.2, 0.1)


@pytest.mark.parametrize(
    ("late", "slow", "best"),
    [
        (0.70, 0.81, "low-pass"),  # leaves 0.19, one and a half of which are less than 0.3
        (0.70, 0.79, "hub sensors late"),
        (1.2, 1.1, "low-pass"),  # neither leaves anything: as they come
    ],
)
def test_a_low_pass_must_leave_clearly_less_than_lateness(
    monkeypatch: pytest.MonkeyPatch, late: float, slow: float, best: str
) -> None:
    assert ranked(monkeypatch, {}, late, slow)[-1] == best


@pytest.mark.parametrize(
    ("travel_ms", "late"),
    [
        (0.9, {"hub sensors": 5.0}),
        (1.1, {"hub sensors": 5.0, "travel sensors": 1.1}),
        (0.0, {"hub sensors": 5.0}),
    ],
)
def test_sensors_are_late_by_a_fifth_of_the_latest_at_least(
    travel_ms: float, late: dict[str, float]
) -> None:
    """Counted from the earliest kind, for the fit knows differences only."""
    delays = {"body sensors": 0.0, "hub sensors": 5.0, "travel sensors": travel_ms}
    assert _late_ms(delays) == pytest.approx(late)
    assert _late_ms({kind: ms - 3.0 for kind, ms in delays.items()}) == pytest.approx(late)


def test_sensors_are_of_the_body_of_hubs_or_of_travel() -> None:
    at = Corner.FRONT_LEFT
    assert _kind(Channel("z", Quantity.BODY_ACCELERATION)) == "body sensors"
    assert _kind(Channel("h", Quantity.HUB_ACCELERATION, corner=at)) == "hub sensors"
    assert _kind(Channel("t", Quantity.SUSPENSION_TRAVEL, corner=at)) == "travel sensors"


def test_the_largest_shift_is_of_what_cannot_be_zero() -> None:
    """A bar that moves by three units has no share of its size."""
    assert largest_shift({"m_s": 0.1, "k_sf": -0.2, "k_af": 3.0}) == (0.2, "k_sf")
    assert largest_shift({"y_s": -4.0, "c_sf": 0.3, "c_tr": 9.0}) == (0.3, "c_sf")


def test_the_first_of_each_kind_of_run_is_enough_to_compare() -> None:
    def decay(label: str) -> Any:
        return SimpleNamespace(label=label, thinned=lambda hz: (label, hz))

    labels = ("baseline_roll_1", "baseline_roll_2", "added_roll_2", "baseline_pitch_1")
    kept: Any = first_repeats([decay(label) for label in labels])
    assert kept == (
        ("baseline_roll_1", 125.0), ("added_roll_2", 125.0), ("baseline_pitch_1", 125.0)
    )  # fmt: skip
