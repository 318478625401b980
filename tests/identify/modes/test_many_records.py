"""A structure that is struck many times: close modes are held apart, copies of one are merged."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity, paper_channels
from daq.vehicle import Corner
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.modes import vehicle_modes as module
from identify.modes.modal_likelihood import System
from identify.modes.modal_model import ModalModel, originals
from identify.modes.mode_selection import identify_modes
from identify.modes.vehicle_modes import SensedModes, mirror_of, sensed_modes

from ..structures import CLOSE_PAIR_HZ, oscillators, struck_frame

RATE_HZ = 512.0


def test_modes_that_nearly_coincide_are_told_apart_and_none_else_is_found() -> None:
    records, poles = struck_frame(8, 16, 3)
    found = identify_modes(records, RATE_HZ)
    truth = np.sort(np.abs(poles)) / (2.0 * np.pi)
    assert len(found) == 8
    assert np.max(np.abs(found.frequencies_hz / truth - 1.0)) < 3e-5
    assert np.max(np.abs(found.frequencies_hz - truth) / found.frequency_std_hz) < 4.0
    pair = found.frequencies_hz[(found.frequencies_hz > 125.0) & (found.frequencies_hz < 126.0)]
    assert pair == pytest.approx(CLOSE_PAIR_HZ, abs=0.005)


def test_a_mode_whose_frequency_drifts_is_one_mode() -> None:
    """One in a thousand from record to record, five times what noise leaves open in all."""
    records, poles = struck_frame(6, 16, 4, drift=1e-3)
    found = identify_modes(records, RATE_HZ)
    assert no_copies(found, poles)
    truth = np.sort(np.abs(poles)) / (2.0 * np.pi)
    for frequency_hz in truth:
        assert np.min(np.abs(found.frequencies_hz / frequency_hz - 1.0)) < 1e-3
    assert len(found) <= len(poles) + 2


def test_poles_that_follow_a_drift_do_not_multiply_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A ground-vibration test: some thirty poles stand out from the noise, and eight are modes.

    A step of the fit takes runs times poles squared.  Thirty steps of thirty poles in all 74 runs
    would be 2 million; a fit of all poles to the end took 23 million.
    """
    step, work = System.step, []

    def counted_step(system: System, damping: float) -> Any:
        n_runs, n_numbers = system.by_runs.shape
        work.append(n_runs * (n_numbers // 2) ** 2)
        return step(system, damping)

    monkeypatch.setattr(System, "step", counted_step)
    struck, poles = struck_frame(8, 74, 4, drift=1e-3)
    found = identify_modes(struck, RATE_HZ)
    assert sum(work) < 2_000_000
    assert no_copies(found, poles)
    for frequency_hz in np.abs(poles) / (2.0 * np.pi):
        assert np.min(np.abs(found.frequencies_hz / frequency_hz - 1.0)) < 2e-3


def no_copies(found: ModalModel, poles: NDArray[np.complex128]) -> bool:
    """Return whether no true mode but the close pair is near to two that were found."""
    truth = np.abs(poles) / (2.0 * np.pi)
    near = np.abs(found.frequencies_hz[:, None] / truth - 1.0) < 0.005
    alone = np.abs(truth - np.mean(CLOSE_PAIR_HZ)) > 1.0
    return bool(np.all(near.sum(axis=0)[alone] <= 1) and np.all(near.sum(axis=0)[~alone] <= 2))


SHAPE = np.array([1.0, 1.0, 1.0], dtype=complex)


def turned(mac_value: float) -> NDArray[np.complex128]:
    """Return a shape of given MAC with SHAPE."""
    across = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    shape = np.sqrt(mac_value) * SHAPE / np.sqrt(3.0) + np.sqrt(1.0 - mac_value) * across
    return np.asarray(shape, dtype=np.complex128)


@pytest.mark.parametrize(
    ("apart", "alike", "left"),
    [(0.019, 0.981, 1), (0.021, 0.981, 2), (0.019, 0.979, 2)],
)
def test_a_copy_is_near_and_of_the_same_shape(apart: float, alike: float, left: int) -> None:
    poles = np.array([100j - 1.0, (100j - 1.0) * (1.0 + apart)])
    shapes = np.column_stack([SHAPE, turned(alike)])
    assert len(originals(poles, shapes)) == left
    assert len(originals(poles, shapes[:1])) == 2  # one channel shows no shape


def test_real_poles_are_no_copies() -> None:
    poles = np.array([-1.0, -1.001], dtype=complex)
    assert len(originals(poles, np.column_stack([SHAPE, SHAPE]))) == 2


def test_without_amplitudes_the_copy_of_the_lowest_damping_stays() -> None:
    shapes = np.column_stack([SHAPE, SHAPE])
    assert originals(np.array([100j - 1.0, 100.1j - 2.0]), shapes).tolist() == [0]
    assert originals(np.array([100j - 2.0, 100.1j - 1.0]), shapes).tolist() == [1]
    assert originals(np.array([100j - 1.0, 100.1j]), shapes).tolist() == [1]


@pytest.mark.parametrize(
    ("size", "runs", "damping", "strongest"),
    [
        ((1.0, 1.0), ((3.0, 2.0), (0.0, 2.0)), (1.0, 1.0), 0),  # 9 over 8
        ((1.0, 1.0), ((2.5, 2.0), (0.0, 2.0)), (1.0, 1.0), 1),  # 6.25 under 8
        ((2.0, 1.0), ((1.0, 1.9),), (1.0, 1.0), 0),  # 4 over 3.6
        ((2.0, 1.0), ((1.0, 2.1),), (1.0, 1.0), 1),
        ((1.0, 1.0), ((2.0, 1.0),), (0.39, 0.1), 0),  # energy is amplitude squared over damping
        ((1.0, 1.0), ((2.0, 1.0),), (0.41, 0.1), 1),
    ],
)
def test_the_strongest_copy_has_the_most_energy_in_all_runs_together(
    size: tuple[float, float],
    runs: tuple[tuple[float, float], ...],
    damping: tuple[float, float],
    strongest: int,
) -> None:
    poles = np.array([100j - damping[0], 100.1j - damping[1]])
    shapes = np.column_stack([SHAPE, SHAPE]) * np.array(size, dtype=complex)
    assert originals(poles, shapes, np.array(runs, dtype=complex)).tolist() == [strongest]


def test_what_is_near_a_copy_only_is_none() -> None:
    """Of three poles 1.5 % apart the outer two are not near each other: the middle one goes."""
    poles = np.array([101.5j - 2.0, 103j - 1.0, 100j - 1.0])
    assert originals(poles, np.column_stack([SHAPE] * 3)).tolist() == [1, 2]


def test_nearness_counts_from_the_larger_of_two_poles() -> None:
    """2.02 % of the smaller one are 1.98 % of the larger one."""
    poles = np.array([100j - 1.0, 102.02j - 1.0])
    for order in ([0, 1], [1, 0]):
        assert len(originals(poles[order], np.column_stack([SHAPE, SHAPE]))) == 1


# When modes are sought as symmetric and antisymmetric ones, and when they are left free -----------

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


@pytest.mark.parametrize(("n", "mirrored"), [(7, True), (8, False)])
def test_a_vehicle_has_seven_modes_of_both_kinds(
    monkeypatch: pytest.MonkeyPatch, n: int, mirrored: bool
) -> None:
    """An eighth is a mode of neither kind, found in both."""
    found, _ = sensed(monkeypatch, modes(n, 100.0, 3), 0.0)
    assert found.mirrored is mirrored
    assert len(found.model) == (7 if mirrored else 1)


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


# Mirror images of sensors -------------------------------------------------------------------------


def body(name: str, x_m: float, y_m: float) -> Channel:
    return Channel(name, Quantity.BODY_ACCELERATION, "m/s2", x_m=x_m, y_m=y_m)


def test_the_papers_channels_pair_up() -> None:
    mirror = mirror_of(paper_channels())
    assert list(mirror.image) == [0, 1, 2, 4, 3, 6, 5]
    assert list(mirror.sign) == [1, 1, -1, 1, 1, 1, 1]
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        mirror.combinations(-1.0),
        [[0, 0, 1, 0, 0, 0, 0], [0, 0, 0, half, -half, 0, 0], [0, 0, 0, 0, 0, half, -half]],
    )
    assert len(mirror.combinations(1.0)) == 4
    ties = mirror.ties(np.array([1.0, -1.0]))
    np.testing.assert_array_equal(
        ties.sign, [[1, 0], [1, 0], [0, 1], [1, 1], [1, -1], [1, 1], [1, -1]]
    )
    assert list(ties.owner) == [0, 1, 2, 3, 3, 4, 4]


def test_body_sensors_pair_by_place_and_a_lone_one_is_free() -> None:
    channels = (
        body("left", -1.0, 0.5),
        body("right", -1.0, -0.5),
        body("middle", -2.0, 0.0),
        body("lone", -2.0, 0.4),
        Channel("fl", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT),
        Channel("fr", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.FRONT_RIGHT),
    )
    mirror = mirror_of(channels)
    assert list(mirror.image) == [1, 0, 2, -1, -1, -1]
    np.testing.assert_array_equal(mirror.ties(np.array([-1.0])).sign.ravel(), [1, -1, 0, 1, 1, 1])


def test_the_image_of_a_sensor_at_the_cg_is_at_the_cg() -> None:
    """The place of the CG is unknown: a sensor at the stated origin is not beside it."""
    at_cg = Channel("cg", Quantity.BODY_ACCELERATION, "m/s2", at_cg=True)
    assert list(mirror_of((at_cg,)).image) == [0]
    assert list(mirror_of((at_cg, body("origin", 0.0, 0.0))).image) == [0, 1]


def test_two_sensors_at_one_place_have_no_certain_image() -> None:
    mirror = mirror_of((body("one", -1.0, 0.5), body("two", -1.0, 0.5), body("right", -1.0, -0.5)))
    assert list(mirror.image) == [-1, -1, -1]


@pytest.mark.parametrize(("apart_m", "image"), [(0.0049, [1, 0]), (0.0051, [-1, -1])])
def test_a_mirror_image_is_at_its_place_to_five_millimetres(
    apart_m: float, image: list[int]
) -> None:
    mirror = mirror_of((body("left", -1.0, 0.5), body("right", -1.0 - apart_m, -0.5)))
    assert list(mirror.image) == image
