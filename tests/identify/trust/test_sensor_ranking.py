"""Which sensor fault is named: a channel alone, lateness or a low-pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from identify.trust import sensor_faults
from identify.trust.refit import Explanation, first_repeats, largest_shift
from identify.trust.sensor_faults import _kind, _late_ms, gain_of, sensor_explanations

ONE: Any = SimpleNamespace(fit=SimpleNamespace(eta=None))


def of(name: str, explained: float) -> Explanation:
    return Explanation(name, "", "", explained, 0.0, "k_sf", {})


def ranked(
    monkeypatch: pytest.MonkeyPatch, alone: dict[str, float], late: float, slow: float
) -> list[str]:
    """Return the faults in their order, of channels that explain so much each left out alone."""
    monkeypatch.setattr(sensor_faults, "refit", lambda *_: None)
    monkeypatch.setattr(sensor_faults, "_left_out", lambda *at: of(at[-1], alone[at[-1]]))
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


BODY = Channel("body_az", Quantity.BODY_ACCELERATION, "m/s2")
WHEELS = tuple(
    Channel(name, quantity, corner=Corner.FRONT_LEFT)
    for name, quantity in (
        ("hub", Quantity.HUB_ACCELERATION), ("travel", Quantity.SUSPENSION_TRAVEL)
    )
)  # fmt: skip


def slow(
    monkeypatch: pytest.MonkeyPatch, names: set[str], true_hz: float
) -> tuple[Explanation, list[tuple[int, float]]]:
    """Return what is found where some channels have a low-pass, and what was tried.

    That is the number of channels with a low-pass, and its frequency.  The cost is how far the
    frequency is off, and 10 for each channel that has a low-pass in one place only.
    """
    tried = []

    def refit(
        _: Any, change: Callable[[Channel], Channel], *__: object, **___: object
    ) -> SimpleNamespace:
        changed = [change(channel) for channel in (BODY, *WHEELS)]
        filtered = {c.name: c.low_pass_hz for c in changed if c.low_pass_hz}
        cost = 99.0
        if filtered:
            (hz,) = set(filtered.values())
            tried.append((len(filtered), hz))
            cost = abs(np.log(hz / true_hz)) + 10.0 * len(names ^ filtered.keys())
        group = SimpleNamespace(channels=(BODY, *WHEELS))
        box = SimpleNamespace(parameters=("m_s", "k_sf"), groups=(group,))
        eta = np.array([0.0, 0.3 if filtered else 0.0])
        fit = SimpleNamespace(cost=cost, eta=eta)
        return SimpleNamespace(fit=fit, box=box, excess=0.4 if filtered else 2.0)

    monkeypatch.setattr(sensor_faults, "refit", refit)
    monkeypatch.setattr(sensor_faults, "_late", lambda *_: [])
    monkeypatch.setattr(sensor_faults, "replace", lambda one, **kw: _changed(one, **kw))
    monkeypatch.setattr(sensor_faults, "first_repeats", lambda decays: decays)
    one: Any = SimpleNamespace(fit=SimpleNamespace(eta=np.zeros(2)), decays=())
    (found,) = sensor_explanations(one, [])
    return found, tried


def _changed(one: Any, **changes: Any) -> Any:
    return replace(one, **changes) if isinstance(one, Channel) else one


@pytest.mark.parametrize(
    ("names", "true_hz", "sizes"),
    [
        ({"body_az"}, 60.0, "near 56 Hz on body sensors"),
        ({"hub", "travel"}, 8.5, "near 8 Hz on sensors at the wheels"),
        ({"hub", "travel"}, 27.0, "near 28 Hz on sensors at the wheels"),
        ({"hub", "travel", "body_az"}, 200.0, "near 80 Hz on all sensors"),
        ({"hub", "travel", "body_az"}, 40.0, "near 40 Hz on all sensors"),
    ],
)
def test_a_low_pass_is_sought_on_each_kind_of_sensors(
    monkeypatch: pytest.MonkeyPatch, names: set[str], true_hz: float, sizes: str
) -> None:
    found, _ = slow(monkeypatch, names, true_hz)
    assert (found.name, found.sizes) == ("low-pass", sizes)
    assert found.explained == pytest.approx(0.8)  # 0.4 of 2 are left
    assert found.shift == pytest.approx(0.3)
    assert found.shifted == "k_sf"


@pytest.mark.parametrize(
    ("true_hz", "fine"), [(50.0, [20.0, 28.0, 56.0, 80.0]), (12.0, [8.0, 10.0, 20.0, 28.0])]
)
def test_a_low_pass_is_sought_finely_where_the_coarse_search_ended(
    monkeypatch: pytest.MonkeyPatch, true_hz: float, fine: list[float]
) -> None:
    """By 15 and 40 Hz on body, wheels and all; then within a factor of 2.5 of the better one."""
    _, tried = slow(monkeypatch, {"body_az"}, true_hz)
    assert tried[:6] == [(n, hz) for n in (1, 2, 3) for hz in (15.0, 40.0)]
    assert tried[6:-1] == [(1, hz) for hz in fine]


@pytest.mark.parametrize(
    ("shown", "sizes", "advice"),
    [(2.0, "it shows 2 times", "unit"), (-1.0, "it shows -1 times", "turn its sign")],
)
def test_a_channel_shows_so_many_times_what_the_others_predict(
    monkeypatch: pytest.MonkeyPatch, shown: float, sizes: str, advice: str
) -> None:
    """Of a travel of a tenth of a millimetre about 5 mm, beside another channel."""
    motion = 1e-4 * np.array([1.0, -1.0, 2.0, -2.0])
    values = np.column_stack([np.arange(4.0), shown * motion + 5e-3])
    group = SimpleNamespace(channels=WHEELS)
    recording = SimpleNamespace(group=group, values=values)
    decays = (SimpleNamespace(recordings=(recording,)),) * 2
    box = SimpleNamespace(parameters=("m_s",))

    def refit(_: Any, change: Callable[[Channel], Channel | None], *__: object) -> SimpleNamespace:
        kept = [change(channel) for channel in WHEELS]
        fit = SimpleNamespace(eta=np.zeros(1))
        return SimpleNamespace(box=box, decays=decays, fit=fit, excess=2.0 if all(kept) else 0.5)

    noises = []

    def residuals(_: Any, __: Any, noise: dict[str, float], ___: Any) -> list[SimpleNamespace]:
        noises.append(noise)
        left = {"hub": np.zeros(4), "travel": values[:, 1] - motion}
        return [SimpleNamespace(values=left)] * 2

    monkeypatch.setattr(sensor_faults, "refit", refit)
    monkeypatch.setattr(sensor_faults, "residuals", residuals)
    monkeypatch.setattr(sensor_faults, "parameters_as_start", lambda *_: np.zeros(1))
    one: Any = SimpleNamespace(
        fit=SimpleNamespace(eta=np.zeros(1)), noise={"hub": 0.1, "travel": 2e-4}
    )
    found = gain_of(one, "travel")
    assert found.sizes.startswith(sizes)
    assert advice in found.advice
    assert found.explained == pytest.approx(0.75)
    # The first state is found without this channel: it counts as very noisy.
    assert noises == [{"hub": 0.1, "travel": pytest.approx(0.2)}]
