"""Parts of the gates on data made by hand: what is named first, exchanged, held or correlated."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.channels import Channel, Quantity
from daq.vehicle import RICHEST, Corner, VehicleGeometry
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.decays.stuck import _holds
from identify.fit.estimation import Estimation
from identify.fit.grey_box import GreyBox
from identify.model.matrices import full_matrices, travel_rows
from identify.trust import cause_texts, contradiction, nonlinear_effects, swaps
from identify.trust.consistency import _size
from identify.trust.contradiction import contradictions
from identify.trust.linear_effects import gains, lateness, structural
from identify.trust.nonlinear_effects import _speeds, suspension_forces
from identify.trust.refit import Explanation
from identify.trust.sampling import _by_arrival, _Stretch
from identify.trust.score_test import fitted_decays
from identify.trust.sensor_faults import gain_of
from identify.trust.swaps import _hypotheses
from identify.trust.whiteness import _even_pairs, _Pairs

from .campaigns import shortly_estimated

NAMES = ("a", "b", "c")
MEAN_KNOWN: NDArray[np.float64] = np.eye(3) - np.full((3, 3), 1.0 / 3.0)
"""Redundancy of three measurements of one length with equal sigmas: the fit is their mean."""


def contradicted(
    monkeypatch: pytest.MonkeyPatch, off: list[float], holds: bool = True, chi2_per_n: float = 4.0
) -> list[tuple[str, float]]:
    """Return what is named where three measurements of one length are off by so many sigmas."""
    left = MEAN_KNOWN @ np.array(off)
    monkeypatch.setattr(contradiction, "suspects", lambda _: (NAMES, np.eye(3)))
    monkeypatch.setattr(contradiction, "_stated", lambda _: (np.eye(3), left))
    monkeypatch.setattr(contradiction, "_redundancy", lambda *_: MEAN_KNOWN)
    one: Any = SimpleNamespace(box=None, holds=holds, chi2_per_n=chi2_per_n)
    return [(found.name, found.sigmas) for found in contradictions(one)]


def test_one_wrong_statement_does_not_make_the_others_wrong(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A length that is off by d is off by (2/3) d from the mean, whose sigma is sqrt(2/3)."""
    assert contradicted(monkeypatch, [4.8, 0.0, 0.0]) == []
    ((name, sigmas),) = contradicted(monkeypatch, [20.0, 0.0, 0.0])
    assert name == "a"
    assert sigmas == pytest.approx(20.0 * np.sqrt(2.0 / 3.0))


def test_after_the_worst_two_that_differ_cannot_be_told_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the two that are left one is off by 9: their difference is, in units of sqrt(2)."""
    (first, _), (second, sigmas) = contradicted(monkeypatch, [30.0, 9.0, 0.0])
    assert (first, second) == ("a", "b or c")
    assert sigmas == pytest.approx(9.0 / np.sqrt(2.0))


@pytest.mark.parametrize(
    ("holds", "chi2_per_n", "share"), [(True, 4.0, 1.0), (False, 4.0, 0.5), (False, 0.25, 1.0)]
)
def test_where_the_model_fails_a_misfit_counts_in_units_of_what_it_leaves(
    monkeypatch: pytest.MonkeyPatch, holds: bool, chi2_per_n: float, share: float
) -> None:
    ((_, sigmas),) = contradicted(monkeypatch, [30.0, 0.0, 0.0], holds, chi2_per_n)
    assert sigmas == pytest.approx(share * 30.0 * np.sqrt(2.0 / 3.0))


def test_only_what_is_there_can_be_exchanged() -> None:
    at = {"fl": Corner.FRONT_LEFT, "rl": Corner.REAR_LEFT, "rr": Corner.REAR_RIGHT}
    hubs = tuple(
        Channel(name, Quantity.HUB_ACCELERATION, "m/s2", corner=corner)
        for name, corner in at.items()
    )
    groups = (SimpleNamespace(channels=hubs),)
    decays = tuple(SimpleNamespace(mass_state="baseline") for _ in range(2))
    one = cast(Estimation, SimpleNamespace(box=SimpleNamespace(groups=groups), decays=decays))
    assert [found.name for found in _hypotheses(one)] == [
        "hub acceleration of rear left and rear right swapped",
        "hub acceleration of front left and rear left swapped",
    ]


def test_a_sound_channel_shows_what_the_others_predict() -> None:
    found = gain_of(shortly_estimated("linear", 1), "hub_acc_fl")
    words = found.sizes.split()
    assert words[:2] == ["it", "shows"]
    assert float(words[2]) == pytest.approx(1.0, abs=0.05)


def test_pairs_of_equal_samples_are_alike_and_of_opposite_ones_are_not() -> None:
    time_s = np.arange(100.0) / 100.0
    for sign, correlation in ((1.0, 0.99), (-1.0, -0.99)):
        pairs = _Pairs()
        pairs.add(_even_pairs(time_s), np.array([sign**n for n in range(100)]), 0.0)
        pairs.add(_even_pairs(time_s[:1]), np.ones(1), 5.0)  # makes no pair
        assert (pairs.n, pairs.fitted, pairs.correlation) == (99, 0.0, correlation)


@pytest.mark.parametrize(
    ("frames", "late_s", "by_arrival"), [(9, 0.0, True), (9, 0.001, False), (0, 0.0, False)]
)
def test_times_are_arrivals_where_most_are_those_of_frames(
    frames: int, late_s: float, by_arrival: bool
) -> None:
    t0_ns, t_ns = 5 * 10**9, 5 * 10**9 + np.arange(10) * 10**7
    group: Any = SimpleNamespace(t_ns=t_ns, time_s=(t_ns - t0_ns) * 1e-9 + late_s)
    run: Any = SimpleNamespace(t0_ns=t0_ns, frames=range(frames))
    assert _by_arrival(run, group) is by_arrival


@pytest.mark.parametrize(("on_arrival", "by_arrival"), [(4, False), (5, False), (6, True)])
def test_more_than_half_of_the_samples_are_stamped_on_arrival(
    on_arrival: int, by_arrival: bool
) -> None:
    t0_ns, t_ns = 5 * 10**9, 5 * 10**9 + np.arange(10) * 10**7
    time_s = (t_ns - t0_ns) * 1e-9 + np.where(np.arange(10) < on_arrival, 0.0, 0.001)
    group: Any = SimpleNamespace(t_ns=t_ns, time_s=time_s)
    run: Any = SimpleNamespace(t0_ns=t0_ns, frames=range(1))
    assert _by_arrival(run, group) is by_arrival


def test_a_hold_counts_its_samples_from_the_first_of_them() -> None:
    """Ten samples of one value at the start of a decay of 100 samples a second, then motion."""
    channel = Channel("travel", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.FRONT_LEFT)
    values = np.concatenate([np.arange(10.0), np.full(10, 20.0), np.arange(30.0, 60.0)])
    recording = Recording(ChannelGroup("g", (channel,)), np.arange(50) / 100.0, values[:, None])
    (hold,) = _holds(Record("baseline_bounce_1", "baseline", 0.2, (recording,)), 0.05, 0.1)
    assert (hold.channel, hold.run, hold.kind) == ("travel", "baseline_bounce_1", "baseline_bounce")
    assert (hold.longest.last - hold.longest.first, hold.longest.constant) == (9, False)
    assert hold.longest.held_s == pytest.approx(0.09)
    level = Recording(recording.group, recording.time_s, np.full((50, 1), 3.0))
    (hold,) = _holds(Record("baseline_bounce_1", "baseline", 0.2, (level,)), 0.05, 0.1)
    assert (hold.longest.last - hold.longest.first, hold.longest.constant) == (49, True)


@pytest.mark.parametrize(
    ("costs", "misfit_left", "named"),
    [
        ((300.0, 201.0), 0.0, False),  # a swap that chance explains
        ((300.0, 199.0), 0.0, True),
        ((300.0, 100.0), 0.45, False),  # something else is wrong, too
        ((300.0, 100.0), 0.35, True),
    ],
)
def test_a_swap_is_named_where_it_clears_most_of_a_misfit_beyond_chance(
    monkeypatch: pytest.MonkeyPatch,
    costs: tuple[float, float],
    misfit_left: float,
    named: bool,
) -> None:
    """Costs before and after the swap, and the share of the excess that stays."""

    def described(_: Any, __: Any, ___: Any, *mass_states: Any) -> Any:
        swapped = bool(mass_states)
        fit = SimpleNamespace(cost=costs[swapped], eta=np.zeros(1))
        box = SimpleNamespace(parameters=("m_s",), mass_states=())
        return SimpleNamespace(fit=fit, excess=misfit_left if swapped else 1.0, box=box)

    monkeypatch.setattr(swaps, "refit", described)
    monkeypatch.setattr(swaps, "_runs_away", lambda _: False)
    monkeypatch.setattr(swaps, "first_repeats", lambda decays: decays)
    monkeypatch.setattr(swaps, "replace", lambda one, **_: one)
    one: Any = SimpleNamespace(
        box=SimpleNamespace(groups=(), unknowns=lambda _: np.zeros(1)),
        decays=tuple(SimpleNamespace(mass_state=name) for name in ("baseline", "added")),
        fit=SimpleNamespace(eta=np.zeros(1)),
    )
    found = swaps.swap_explanation(one)
    assert (found.name if found else None) == ("mass states swapped" if named else None)


@pytest.mark.parametrize(("explained", "cause"), [(0.62, "bars"), (0.65, "a sensor")])
def test_a_sensor_is_named_in_place_of_the_vehicle_where_it_explains_clearly_more(
    monkeypatch: pytest.MonkeyPatch, explained: float, cause: str
) -> None:
    """Bars explain 0.6 of the misfit."""

    def of(name: str, share: float) -> Explanation:
        return Explanation(name, "", "", share, 0.5, "k_sf", {})

    suspect: Any = SimpleNamespace(strength=2.0, cause="bars", effects=())
    monkeypatch.setattr(cause_texts, "swap_explanation", lambda _: None)
    monkeypatch.setattr(cause_texts, "_preferred", lambda ranked: ranked[0])
    monkeypatch.setattr(cause_texts, "_in_words", lambda *_: of("bars", 0.6))
    monkeypatch.setattr(cause_texts, "_explanation", lambda *_: of("bars", 0.6))
    others = [of("a sensor", explained)]
    monkeypatch.setattr(cause_texts, "sensor_explanations", lambda *_: others)
    one: Any = SimpleNamespace(holds=False)
    found = cause_texts.causes_of(one, [suspect])
    assert [f"likely cause: {cause}" in finding.text for finding in found.findings] == [True]
    assert [one.name for one in found.tried] == ["bars", "a sensor"]


def test_the_trace_of_an_effect_is_that_of_the_vehicle_with_a_little_of_it() -> None:
    """Bars and damped tyres, in a car whose weights were corrected, by the matrix exponential."""
    known = shortly_estimated("linear", 1)
    states = tuple(
        replace(
            state,
            added=replace(
                state.added,
                weights=tuple(replace(weight, sigma_kg=1.0) for weight in state.added.weights),
            ),
        )
        for state in known.box.mass_states
    )
    box = GreyBox(known.box.groups, states, None)
    n = len(box.parameters)
    eta = np.concatenate([known.fit.eta[:n], np.full(len(box.corrections), 9.0)])
    assert len(eta) > n
    (decay,) = (d for d in known.decays if d.label == "added_roll_1")
    corrected = replace(known, box=box, fit=replace(known.fit, eta=eta), decays=(decay,))
    (one,) = fitted_decays(corrected, 50.0)
    effects = structural(corrected, (one,))
    labels = [effect.label for effect in effects.effects]
    rich = GreyBox(box.groups, states, None, RICHEST)

    def outputs(recording: Recording, **added: float) -> NDArray[np.float64]:
        point = rich.unknowns_of(box.full(eta.astype(complex)).real)
        point[len(rich.parameters) :] = eta[n:]
        for name, size in added.items():
            point[rich.parameters.index(name)] += size
        system = rich.system(point, decay.mass_state)
        rows = np.array([system.rows[c.name] for c in recording.group.channels])
        start = one.linear.solution[: len(system.A)]
        motion = [expm(system.A * t) @ start for t in one.at.time_s(recording)]
        return np.asarray(np.array(motion) @ rows.T)

    for recording, trace in zip(one.decay.recordings, effects.trace_of(one), strict=True):
        h, basis = 1e-4, one.at.basis(recording)
        for name, parts in {
            "k_af": {"k_af": h},
            "c_tr": {"c_tr": h},
            "y_s": {"y_s": h},
            "k_sf": {"k_sfl": h, "k_sfr": -h},
        }.items():
            less = {part: -size for part, size in parts.items()}
            slope = (outputs(recording, **parts) - outputs(recording, **less)) / (2 * h)
            predicted = basis[:, :28] @ trace[:, :, labels.index(name)].T
            np.testing.assert_allclose(predicted, slope, atol=1e-4 * np.abs(slope).max())


def test_speeds_of_a_car_that_creeps_back_are_those_of_the_matrix_exponential() -> None:
    """Five times the damping: some motions do not oscillate, and their poles come alone."""
    known = shortly_estimated("linear", 1)
    eta = known.fit.eta.copy()
    for name in ("c_sf", "c_sr"):
        eta[known.box.parameters.index(name)] += np.log(5.0)
    decay = known.decays[0]
    damped = replace(known, fit=replace(known.fit, eta=eta), decays=(decay,))
    (one,) = fitted_decays(damped, 50.0)
    assert (one.at.modes.poles.imag == 0.0).any()
    A = known.box.system(eta, decay.mass_state).A
    start = one.linear.solution[:14]
    time_s = np.array([0.0, 0.01, 0.1, 0.7])
    expected = [(expm(A * t) @ start)[7:] for t in time_s]
    np.testing.assert_allclose(_speeds(one, time_s), expected, atol=1e-9 * np.abs(start).max())


def test_friction_has_three_quarters_of_its_force_at_5_mm_s(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """That is tanh 1; rebound damping that is in excess has the force of its speed."""
    known = shortly_estimated("linear", 1)
    (one,) = fitted_decays(replace(known, decays=known.decays[:1]), 50.0)
    seen: list[NDArray[np.float64]] = []
    pushes: list[NDArray[np.float64]] = []
    drives = nonlinear_effects._drives

    def note(at: Any, force: NDArray[np.float64], push: NDArray[np.float64]) -> Any:
        seen.append(force)
        pushes.append(push)
        return drives(at, force, push)

    monkeypatch.setattr(nonlinear_effects, "_drives", note)
    suspension_forces(known).trace_of(one)
    ((*friction, front, rear),) = seen
    full = known.box.full(known.fit.eta.astype(complex))
    speed = _speeds(one, np.arange(len(front), dtype=np.float64) * 1e-3) @ travel_rows(full).real.T
    assert np.tanh(1.0) == pytest.approx(0.76, abs=0.002)
    np.testing.assert_allclose(np.hstack(friction), np.tanh(speed / 0.005), atol=1e-9)
    np.testing.assert_allclose(np.hstack([front, rear]), -np.abs(speed), atol=1e-12)
    by_travel = travel_rows(full).real.T  # a force against a travel does work on it alone
    opposed = [-by_travel[:, :2], -by_travel[:, 2:]] * 2
    np.testing.assert_allclose(full_matrices(full)[0].real @ pushes[0], opposed, atol=1e-9)


def test_samples_of_a_swapped_channel_keep_their_own_clock() -> None:
    here = Channel(
        "here",
        Quantity.HUB_ACCELERATION,
        "m/s2",
        corner=Corner.FRONT_LEFT,
        delay_s=0.003,
        delay_sigma_s=0.001,
        low_pass_hz=60.0,
        low_pass_order=2,
    )
    there = replace(
        here,
        name="there",
        corner=Corner.FRONT_RIGHT,
        delay_s=0.0,
        delay_sigma_s=0.0,
        low_pass_hz=90.0,
        low_pass_order=4,
    )
    carries = swaps._swapped("swapped", {"here": there}).channel
    assert carries(there) is there
    assert carries(here) == replace(here, name="there", corner=Corner.FRONT_RIGHT)


@pytest.mark.parametrize(("square", "usable"), [(0.9, False), (1.1, True)])
def test_silence_is_a_hundredth_of_the_power_of_the_noise(square: float, usable: bool) -> None:
    assert _Pairs(squares=square * 100.0, n=100, levels=5).usable(noise=10.0) is usable


@pytest.mark.parametrize(("n", "levels", "usable"), [(99, 5, 0), (100, 5, 1), (100, 4, 0)])
def test_a_correlation_needs_a_hundred_pairs_and_five_levels(
    n: int, levels: int, usable: int
) -> None:
    assert _Pairs(squares=1e6, n=n, levels=levels).usable(noise=1.0) is bool(usable)


def test_a_stretch_that_begins_late_has_no_early_gap() -> None:
    assert _Stretch("g", np.array([5.0, 5.1, 5.9]), 0.1).longest_early_s == 0.0
    assert _Stretch("g", np.array([0.0, 0.02, 0.03, 0.9]), 0.01).longest_early_s == pytest.approx(
        0.87
    )


def test_the_size_of_a_decay_is_that_of_its_motion_about_its_level() -> None:
    group = ChannelGroup("g", (Channel("a", Quantity.BODY_ACCELERATION, "m/s2"),) * 2)
    values = np.array([[1.0, 50.0], [3.0, 50.0]])
    recording: Any = SimpleNamespace(group=group, values=values)
    decay: Any = SimpleNamespace(recordings=(recording, recording))
    assert _size(decay) == pytest.approx(np.sqrt(0.5))


def test_a_length_can_be_wrong_only_where_it_is_stated() -> None:
    known = shortly_estimated("linear", 1)
    lengths = VehicleGeometry(1.3, 1.4, 0.7, 0.7)
    for stated in (None, lengths):
        box = replace(known.box, geometry=stated)
        n = len(box.parameters)
        fit = replace(known.fit, eta=known.fit.eta[:n])
        effects = structural(replace(known, box=box, fit=fit), ()).effects
        wrong = [e for e in effects if e.cause == "a length is wrong"]
        assert [e.label for e in wrong] == (["a", "b", "t_f", "t_r"] if stated else [])
        assert {(e.factor, e.unit) for e in wrong} == ({(100.0, "%")} if stated else set())


def test_each_effect_is_sized_in_a_unit_that_says_how_much() -> None:
    """A unit of a trace is a neper or, of what may be zero, a usual size.

    A neper more on the left and less on the right is a difference of 200 %, to first order.
    """
    known = shortly_estimated("linear", 1)
    sizes = {
        (effect.cause, effect.label): (effect.factor, effect.unit)
        for kind in (
            structural(known, ()),
            lateness(known),
            gains(known),
            suspension_forces(known),
        )
        for effect in kind.effects
    }
    for axle in "fr":
        assert sizes["anti-roll bars", f"k_a{axle}"] == (1e4, "N/m")
        assert sizes["tyre damping", f"c_t{axle}"] == (100.0, "N s/m")
        for name in ("m_u", "k_s", "k_t", "c_s"):
            of_side = sizes["left and right differ", f"{name}{axle}"]
            assert of_side == (200.0, "% more left than right")
    assert sizes["CG off the middle", "y_s"] == (0.1, "m")
    for axle in ("front", "rear"):
        assert sizes["friction in the suspension", axle] == (1.0, "N")
        rebound = "dampers stronger in rebound than in compression"
        assert sizes[rebound, axle] == (2.0, "N s/m")
    groups = {group.name for group in known.box.groups}
    channels = {c.name for group in known.box.groups for c in group.channels}
    for group in groups:
        assert sizes[f"{group} late", group] == (1.0, "ms")
    for channel in channels:
        assert sizes[f"gain of {channel}", channel] == (100.0, "%")
