"""When modes are sought as symmetric and antisymmetric ones, and when they are left free."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.modes import vehicle_modes as module
from identify.modes.modal_model import originals
from identify.modes.vehicle_modes import SensedModes, sensed_modes

from ..structures import oscillators

HUBS = tuple(
    Channel(f"hub_{corner}", Quantity.HUB_ACCELERATION, "m/s2", corner=corner)
    for corner in (Corner.FRONT_LEFT, Corner.FRONT_RIGHT)
)


def records(channels: tuple[Channel, ...] = HUBS) -> list[Record]:
    time_s = np.arange(400) / 100.0
    values = np.random.default_rng(0).standard_normal((400, len(channels)))
    return [
        Record("run", "baseline", 0.2, (Recording(ChannelGroup("g", channels), time_s, values),))
    ]


def modes(n: int, log_likelihood: float, n_unknowns: int) -> Any:
    poles = oscillators([2.0 + k for k in range(n)], [0.1] * n)
    return SimpleNamespace(
        poles=poles, shapes=np.ones((2, n), dtype=complex), amplitudes=np.ones((1, n)),
        n_unknowns=n_unknowns, log_likelihood=log_likelihood, frequency_std_hz=np.ones(n),
        damping_ratio_std=np.ones(n),
    )  # fmt: skip


class Start(SimpleNamespace):
    """Poles and shapes that a fit starts from."""

    def __len__(self) -> int:
        return len(self.poles)


def sensed(
    monkeypatch: pytest.MonkeyPatch,
    tied: Any,
    free: float,
    found: tuple[int, int] = (1, 1),
    symmetric: bool = True,
) -> tuple[SensedModes, list[Any]]:
    """Return modes where the tied fit is given, and the likelihood of the free one.

    `found`: number of symmetric and antisymmetric modes that regression starts from.
    """
    counts = iter([*found, 1])
    asked: list[Any] = []

    def regression(grids: Any, rate_hz: float) -> Start:
        n, width = next(counts), grids[0].shape[1]
        asked.append((width, rate_hz))
        return Start(poles=oscillators([2.0] * n, [0.1] * n), shapes=np.ones((width, n)))

    def likely(samples: Any, poles: Any, shapes: Any, ties: Any = None) -> Any:
        asked.append((len(poles), None if ties is None else ties.sign.tolist()))
        return modes(1, 0.0, 6) if ties is None else tied

    def more_likely(samples: Any, poles: Any, shapes: Any, ties: None, wanted: float) -> Any:
        asked.append(wanted)
        return modes(1, free, 6) if free > wanted else None

    monkeypatch.setattr(module, "regression_modes", regression)
    monkeypatch.setattr(module, "likely_modes", likely)
    monkeypatch.setattr(module, "more_likely_modes", more_likely)
    given = records()
    return sensed_modes(given, [record.decay(0.5) for record in given], symmetric), asked


@pytest.mark.parametrize(("free", "mirrored"), [(116.2, True), (116.3, False)])
def test_free_shapes_must_be_more_likely_than_chance_makes_them(
    monkeypatch: pytest.MonkeyPatch, free: float, mirrored: bool
) -> None:
    """A pair in two channels and one run has 6 numbers, tied 3: chi-squared of 3 is 16.27."""
    found, asked = sensed(monkeypatch, modes(1, 100.0, 3), free)
    assert found.mirrored is mirrored
    assert asked[:2] == [(1, 100.0), (1, 100.0)]  # the sum and the difference of both hubs
    assert asked[2] == (2, [[1.0, 1.0], [1.0, -1.0]])
    assert asked[3] == pytest.approx(116.27, abs=0.01)


def test_where_a_channel_has_the_wrong_sign_shapes_are_free_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, asked = sensed(monkeypatch, modes(1, 100.0, 3), 0.0, symmetric=False)
    assert not found.mirrored
    assert asked == [(2, 100.0), (1, None)]


def test_where_ties_take_no_number_there_is_nothing_to_compare(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, asked = sensed(monkeypatch, modes(1, 100.0, 6), 1e9)
    assert found.mirrored
    assert len(asked) == 3


@pytest.mark.parametrize(("n", "mirrored"), [(7, True), (8, False)])
def test_a_vehicle_has_seven_modes_of_both_kinds(
    monkeypatch: pytest.MonkeyPatch, n: int, mirrored: bool
) -> None:
    """An eighth is a mode of neither kind, found in both."""
    found, _ = sensed(monkeypatch, modes(n, 100.0, 3), 0.0)
    assert found.mirrored is mirrored
    assert len(found.model) == (7 if mirrored else 1)


def test_without_a_mode_of_either_kind_modes_are_free(monkeypatch: pytest.MonkeyPatch) -> None:
    found, asked = sensed(monkeypatch, modes(1, 100.0, 3), 0.0, (0, 0))
    assert not found.mirrored
    assert asked[2:] == [(2, 100.0), (1, None)]
    one_kind, _ = sensed(monkeypatch, modes(1, 100.0, 3), 0.0, (0, 1))
    assert one_kind.mirrored


@pytest.mark.parametrize(
    ("rate_hz", "grid_hz"), [(100.0, 100.0), (187.0, 187.0), (188.0, 94.0), (1000.0, 125.0)]
)
def test_fast_samples_come_on_a_grid_of_about_125_hertz(
    monkeypatch: pytest.MonkeyPatch, rate_hz: float, grid_hz: float
) -> None:
    """By a whole number of samples, 1.5 s at most."""
    seen = []

    def regression(grids: Any, rate: float) -> Any:
        seen.append((len(grids[0]), rate))
        return []

    monkeypatch.setattr(module, "regression_modes", regression)
    lone = (Channel("az", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.0, y_m=0.3),)
    n = int(4 * rate_hz)
    values = np.random.default_rng(0).standard_normal((n, 1))
    recording = Recording(ChannelGroup("g", lone), np.arange(n) / rate_hz, values)
    given = [Record("run", "baseline", 0.2, (recording,))]
    monkeypatch.setattr(module, "_mirrored_modes", lambda *_: None)
    sensed_modes(given, [record.decay(0.5) for record in given])
    ((length, rate),) = seen
    assert rate == pytest.approx(grid_hz)
    assert length == pytest.approx(1.5 * grid_hz, abs=1)


def test_of_no_poles_none_is_a_copy() -> None:
    kept = originals(np.zeros(0, dtype=complex), np.zeros((3, 0), dtype=complex))
    assert np.arange(3)[kept].tolist() == []


def test_the_start_is_sought_in_samples_with_noise_of_three_per_cent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of each channel's own size, so that errors of interpolation are not taken for modes."""
    seen: list[Any] = []

    def regression(grids: Any, rate: float) -> Any:
        seen.extend(grids)
        return []

    monkeypatch.setattr(module, "regression_modes", regression)
    monkeypatch.setattr(module, "_mirrored_modes", lambda *_: None)
    lone = tuple(
        Channel(name, Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.0, y_m=0.3) for name in "ab"
    )
    values = np.random.default_rng(0).standard_normal((400, 2)) * [1.0, 50.0]
    values[:20] = [[1e-9, 1e-9], [-1e-9, -1e-9]] * 10  # at rest before the motion
    recording = Recording(ChannelGroup("g", lone), np.arange(400) / 100.0, values)
    given = [Record("run", "baseline", 0.2, (recording,))]
    sensed_modes(given, [record.decay(0.5) for record in given])
    (grid,) = seen
    start = int(np.argmin(np.abs(values[:, 1] - grid[0, 1])))
    added = grid - values[start : start + len(grid)]
    assert np.std(added, axis=0) == pytest.approx([0.03, 1.5], rel=0.2)
