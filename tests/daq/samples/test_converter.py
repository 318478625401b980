"""Flat, stuck and too fine: closed-form records on either side of each limit, all callers alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import load_bench
from daq.channels import SI_UNITS, Channel, Quantity
from daq.runs import BASELINE, Excitation, Losses, Run, RunStatus, SampleGroup
from daq.samples.converter import flat_tops, is_fine, is_stuck, share_changed
from daq.sessions import Session
from daq.vehicle import Corner
from daq.verdict.traffic import overload
from daq.verdict.window import RunWindow, traces
from dbc.frames import FrameBatch
from identify.decays.usable import usable
from identify.trust.samples import sample_findings

RATE_HZ = 1000.0
STEP = 0.01
T_S = np.arange(-1000, 2600) / RATE_HZ
HUB = Channel("hub_acc_fl", Quantity.HUB_ACCELERATION, "m/s2", "HUB.a", corner=Corner.FRONT_LEFT)
Array = NDArray[np.float64]


def decay(amplitude: float = 40.0, noise: float = 0.0, seed: int = 1) -> Array:
    """Return a wheel's free decay at 12 Hz from 0 s on, in steps of the converter."""
    swing = amplitude * np.exp(-8.0 * T_S) * np.sin(2 * np.pi * 12.0 * T_S)
    value = np.where(T_S > 0.0, swing, 0.0)
    value = value + noise * np.random.default_rng(seed).standard_normal(len(T_S))
    return np.asarray(STEP * np.rint(value / STEP))


def topped(samples: int, jump_steps: float, noise: float = 0.02) -> Array:
    """Return a decay with one plateau above all, entered and left by a jump."""
    value = decay(noise=noise)
    top = float(value.max()) + 1.0
    at = 1300
    value[at : at + samples] = top
    value[[at - 1, at + samples]] = top - jump_steps * STEP
    return value


def test_a_plateau_is_given_by_its_first_sample_and_the_one_behind_its_last() -> None:
    assert flat_tops(topped(12, 50.0)) == ((1300, 1312),)
    assert flat_tops(-topped(12, 50.0)) == ((1300, 1312),)


@pytest.mark.parametrize(
    ("noise", "samples", "flat"),
    [(50.0, 2, False), (50.0, 3, True), (0.5, 3, False), (0.5, 4, True), (0.02, 5, False),
     (0.02, 12, True)],
)  # fmt: skip
def test_how_many_equal_samples_are_no_chance(noise: float, samples: int, flat: bool) -> None:
    """Noise of s steps repeats a value with odds 0.28 / s: at most one in a million for a top."""
    assert bool(flat_tops(topped(samples, 5000.0, noise))) is flat


@pytest.mark.parametrize(("jump", "flat"), [(4.0, False), (5.0, True)])
def test_a_flat_top_has_steep_sides(jump: float, flat: bool) -> None:
    assert bool(flat_tops(topped(12, jump))) is flat
    for side in (1299, 1312):
        one_sided = topped(12, 50.0)
        one_sided[side] = one_sided[1300] - jump * STEP
        assert bool(flat_tops(one_sided)) is flat


def test_a_plateau_within_the_range_is_no_top() -> None:
    value = topped(5, 50.0)
    value[1500] = value.max() + 1.0
    assert flat_tops(value) == ()


@pytest.mark.parametrize("noise_steps", [0.0, 0.3, 1.0, 5.0, 20.0])
@pytest.mark.parametrize("seed", range(10))
def test_no_decay_has_a_top_by_chance(noise_steps: float, seed: int) -> None:
    assert flat_tops(decay(noise=noise_steps * STEP, seed=seed)) == ()


@pytest.mark.parametrize("noise_steps", [0.0, 0.3, 1.0, 5.0, 20.0])
def test_a_decay_cut_at_half_its_height_is_found_at_any_noise(noise_steps: float) -> None:
    tops = flat_tops(np.minimum(decay(noise=noise_steps * STEP), 15.0))
    assert tops
    assert all(1000 < first < stop for first, stop in tops)


def test_a_few_equal_samples_prove_nothing_where_values_repeat() -> None:
    """A coarse sensor stays on its value in one sample of three, so four in a row are chance."""
    value = np.tile([0.0, 6.0, 6.0, 0.0, 7.0, 0.0, 6.0, 6.0, 12.0, 6.0, 0.0], 100) * STEP
    value[500:504] = 20 * STEP
    value[[499, 504]] = 0.0
    assert flat_tops(value) == ()
    value[500:540] = 20 * STEP
    value[540] = 0.0
    assert flat_tops(value) == ((500, 540),)


def test_what_never_moves_has_no_top() -> None:
    assert flat_tops(np.full(100, 9.81)) == ()
    assert flat_tops(np.array([1.0])) == ()


@pytest.mark.parametrize(
    ("held", "changes", "stuck"),
    [(19, 1.0, False), (20, 1.0, True), (39, 0.5, False), (40, 0.5, True), (500, np.nan, False)],
)
def test_a_value_is_stuck_after_twenty_changes_that_did_not_come(
    held: int, changes: float, stuck: bool
) -> None:
    assert is_stuck(held, changes) is stuck


def test_the_share_of_changes_needs_twenty_samples() -> None:
    assert np.isnan(share_changed(np.zeros(19)))
    assert share_changed(np.zeros(20)) == 0.0
    assert share_changed(np.repeat(np.arange(20.0), 2)) == pytest.approx(19 / 39)


@pytest.mark.parametrize(
    ("quantity", "coarse", "fine"),
    [
        (Quantity.HUB_ACCELERATION, 0.051, 0.049),
        (Quantity.BODY_ACCELERATION, 0.051, 0.049),
        (Quantity.PITCH_RATE, 0.011, 0.009),
        (Quantity.ROLL_ACCELERATION, 0.051, 0.049),
    ],
)
def test_steps_below_the_noise_are_fine(quantity: Quantity, coarse: float, fine: float) -> None:
    assert is_fine(quantity, SI_UNITS[quantity], fine)
    assert not is_fine(quantity, SI_UNITS[quantity], coarse)


def test_a_displacement_is_never_fine() -> None:
    assert not is_fine(Quantity.SUSPENSION_TRAVEL, "m", 1e-9)


@pytest.mark.parametrize("samples", range(2, 14))
@pytest.mark.parametrize("noise_steps", [0.0, 2.0, 50.0])
@pytest.mark.parametrize("jump", [4.0, 5.0, 50.0])
def test_bench_and_desk_agree(samples: int, noise_steps: float, jump: float) -> None:
    value = 9.81 + topped(samples, jump, noise_steps * STEP)
    bench = replace(load_bench(None), channels=(HUB,))
    bump_ns = 1_800_000_000_000_000_000
    t_ns = bump_ns + np.rint(T_S * 1e9).astype(np.int64)
    window = RunWindow(bump_ns, {HUB.name: (t_ns, value)})
    (at_once,) = overload(bench, window, traces(bench.channels, window))
    assert at_once.passed is (at_desk(value, t_ns) == ())


def at_desk(value: Array, t_ns: NDArray[np.int64]) -> tuple[object, ...]:
    """Return what the desk finds in a session of one run."""
    good = np.zeros(len(t_ns), np.uint8)
    group = SampleGroup("HUB", T_S + 1.0, t_ns, {HUB.name: value}, good)
    run = Run(
        mass_state=BASELINE,
        excitation=Excitation.BOUNCE,
        repeat=1,
        t0_ns=int(t_ns[0]),
        bump_s=0.2,
        groups=(group,),
        status=RunStatus.ACCEPTED,
        reasons=(),
        losses=Losses(),
        events=(),
        frames=FrameBatch.empty(),
    )
    bench = load_bench(None)
    session = Session(bench.vehicle, (HUB,), bench.mass_states, (run,), {})
    found = sample_findings(session, usable(session).records)
    return tuple(one for one in found if one.code == "saturation")
