"""A sensor's low-pass and its lateness, stated in the channel, cost next to nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.sessions import Session
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate
from identify.fit.generic_vehicles import generic_vehicles
from identify.fit.uncertainty import estimates
from identify.model.low_pass import low_pass_of
from identify.pipeline import grey_box
from identify.trust.finding import Verdict
from identify.trust.judge import judge

from ..stress import BODY, HUBS, stress_session, true_value
from ..trust.campaigns import doubtful


def _filtered(order: int) -> Channel:
    return Channel("a", Quantity.BODY_ACCELERATION, "m/s2", low_pass_hz=20.0, low_pass_order=order)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_it_is_butterworths(order: int) -> None:
    from scipy import signal  # a second to import, in every process that collects

    low_pass = low_pass_of(_filtered(order))
    zeros, poles, _ = signal.butter(order, 2.0 * np.pi * 20.0, analog=True, output="zpk")
    assert len(zeros) == 0
    distance = np.abs(low_pass.poles[:, None] - poles)
    assert np.max(distance.min(axis=1)) < 1e-9 * 2.0 * np.pi * 20.0
    assert len(low_pass.poles) == order
    omega = 2.0 * np.pi * np.geomspace(0.1, 500.0, 40)
    expected = signal.freqs(*signal.butter(order, 2.0 * np.pi * 20.0, analog=True), worN=omega)[1]
    left = low_pass.gain((1j * omega).astype(complex)) / expected - 1.0
    assert np.max(np.abs(left)) < 1e-9
    assert abs(low_pass.gain(np.array(2j * np.pi * 20.0))) == pytest.approx(np.sqrt(0.5))
    assert low_pass.gain(np.array(0j)) == pytest.approx(1.0)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_slope_is_that_of_the_gain(order: int) -> None:
    low_pass = low_pass_of(_filtered(order))
    s, step = np.array([-17.0 + 65.0j, -1.8 + 6.0j]), 1e-4
    up, down = (low_pass.gain((s + h).astype(complex)) for h in (step, -step))
    by_difference = (up - down) / (2.0 * step)
    assert np.max(np.abs(low_pass.gain_slope(s) / by_difference - 1.0)) < 1e-6


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_decay_through_it_is_gain_times_decay_and_transients(order: int) -> None:
    from scipy import signal

    # Switched on at t = 0 before a filter at rest, the output is what scipy simulates.
    pole = np.array([-3.0 + 25.0j])
    time = np.linspace(0.0, 0.6, 1201)
    low_pass = low_pass_of(_filtered(order))
    wave = np.exp(np.multiply.outer(time, pole[0])).real
    system = signal.butter(order, 2.0 * np.pi * 20.0, analog=True)
    out = signal.lsim(system, wave, time)[1]
    steady = (np.multiply.outer(np.exp(np.multiply.outer(time, pole[0])), low_pass.gain(pole))).real
    own = low_pass.transients(time)
    assert own.shape == (len(time), order)
    left = out - steady[:, 0]
    found = np.linalg.lstsq(own, left, rcond=None)[0]
    assert np.max(np.abs(left)) > 0.05
    np.testing.assert_allclose(own @ found, left, atol=2e-5)


def test_without_a_cut_off_there_is_none() -> None:
    none = low_pass_of(replace(_filtered(2), low_pass_hz=0.0))
    assert none.gain(np.array([3j])) == 1.0
    assert none.transients(np.zeros(5)).shape == (5, 0)


def _stated(name: str, change: Callable[[Channel], Channel]) -> tuple[Session, Estimation]:
    session = stress_session(name, 1)
    session = replace(session, channels=tuple(change(c) for c in session.channels))
    records = usable(session).records
    return session, estimate(grey_box(session, records), records, generic_vehicles())


def _is_right(session: Session, result: Estimation, name: str) -> None:
    quality = judge(session, result)
    assert quality.verdict is Verdict.OK
    assert not doubtful(quality.findings)
    for parameter, e in estimates(result.box, result.fit).items():
        assert abs(e.value - true_value(name, parameter)) < 4.0 * e.std, parameter
        assert e.std < 0.02 * e.value, parameter


@pytest.mark.parametrize(("name", "channels"), [("body_low_pass", BODY), ("low_pass", BODY + HUBS)])
def test_a_stated_low_pass_is_corrected(name: str, channels: tuple[str, ...]) -> None:
    session, result = _stated(
        name, lambda c: replace(c, low_pass_hz=20.0) if c.name in channels else c
    )
    _is_right(session, result, name)


def test_a_lateness_of_stated_uncertainty_is_found() -> None:
    name = "hubs_late_5ms"
    session, result = _stated(
        name, lambda c: replace(c, delay_sigma_s=0.005) if c.name in HUBS else c
    )
    _is_right(session, result, name)
    std = np.sqrt(np.diag(result.fit.covariance))
    delays = result.box.delays_s(result.fit.eta)
    late = [i for i in range(len(delays)) if result.box.delay_index(i) is not None]
    assert len(late) == 2  # front and rear
    for i in late:
        spread = float(std[result.box.delay_index(i)])
        assert spread < 0.0002
        assert delays[i] == pytest.approx(0.005, abs=4.0 * spread)
