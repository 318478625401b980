"""Finds a faulty sensor (late, slow, upside down, in another unit) by fitting again.

A large error of a sensor distorts the whole fit, so that the score test at the fitted point shows
it only weakly.  Here the suspected channel gets another description or is left out, and the
improvement of the fit is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from daq.channels import Channel, Quantity

from ..fit.estimation import Estimation
from ..fit.generic_vehicles import generic_vehicles
from ..fit.likelihood import HOLD, residuals
from .refit import (
    RANKING_STEPS,
    Explanation,
    Refit,
    as_described,
    first_repeats,
    parameters_as_start,
    refit,
    shift_between,
)

_FEWEST = 3
"""Least number of channels of which one can be wrong."""
_SUSPECTED = 4
"""Number of suspected channels that are left out in turn."""
_CLEARS = 0.9
"""Share of the misfit that must disappear without a channel to call it wrong."""
_ALONE = 0.97
"""Share above which a wrong channel is not compared with lateness and low-pass; below, it may be
the slowest of several sensors."""
_LEAST, _MOST = 0.7, 1.4
"""Gains beyond which a unit is wrong rather than a calibration."""
_CHOICE = 1.5
_LATE_SIGMA_S = 0.03
_ALIKE = 0.2
"""Share of the largest difference below which a kind of sensors counts as early as the earliest."""
_COARSE_HZ = (15.0, 40.0)
_FINE_HZ = (8.0, 10.0, 20.0, 28.0, 56.0, 80.0)


def wrong_channel(estimation: Estimation) -> Explanation | None:
    """Return the channel whose unit or sign is wrong, None if there is no such channel.

    It distorts the whole fit, so that neither residuals nor scores point to it.  Therefore a
    generic car is fitted without each channel in turn.  Without the wrong one the model explains
    all others, and the prediction shows by how much that one is off.

    `estimation`: a fit that does not hold.
    """
    names = [c.name for group in estimation.box.groups for c in group.channels]
    if len(names) < _FEWEST:
        return None
    few = replace(estimation, decays=first_repeats(estimation.decays))
    start = estimation.box.unknowns(generic_vehicles()[0])
    tried = {
        name: refit(few, _leaving_out(name), start, hold=HOLD, steps=RANKING_STEPS)
        for name in names
    }
    name = min(names, key=lambda each: tried[each].excess)
    others = refit(estimation, _leaving_out(name), tried[name].fit.eta)
    if others.excess > estimation.chi2_limit - 1.0:
        return None
    before = refit(estimation, as_described, estimation.fit.eta)
    gain = _gain(estimation, before, others, name)
    if np.isnan(gain) or _LEAST < gain < _MOST:
        return None
    return _compared(before, others, name, gain)


def sensor_explanations(estimation: Estimation, suspected: Sequence[str]) -> list[Explanation]:
    """Return what a faulty sensor would explain, the best last.

    `estimation`: a fit that does not hold.  `suspected`: channels whose gain is suspected, the most
    suspected first.
    """
    before = refit(estimation, as_described, estimation.fit.eta)
    found = [*_wrong_channels(estimation, before, suspected[:_SUSPECTED])]
    if not found or found[0].explained < _ALONE:
        found += [*_late(estimation, before), *_slow(estimation, before)]
        # Lateness and a low-pass look alike; a low-pass, which has more to choose from, must
        # leave clearly less.
        found.sort(
            key=lambda e: -max(1.0 - e.explained, 0.0) * (_CHOICE if e.name == "low-pass" else 1.0)
        )
    return found


def gain_of(estimation: Estimation, name: str) -> Explanation:
    """Compare one channel with the prediction by all others."""
    before = refit(estimation, as_described, estimation.fit.eta)
    return _left_out(estimation, before, name)


def _wrong_channels(
    estimation: Estimation, before: Refit, names: Sequence[str]
) -> Iterator[Explanation]:
    for name in names:
        found = _left_out(estimation, before, name)
        if found.explained > _CLEARS:
            yield found
            return


def _left_out(estimation: Estimation, before: Refit, name: str) -> Explanation:
    others = refit(estimation, _leaving_out(name), before.fit.eta)
    return _compared(before, others, name, _gain(estimation, before, others, name))


def _leaving_out(name: str) -> Callable[[Channel], Channel | None]:
    return lambda c: None if c.name == name else c


def _gain(estimation: Estimation, before: Refit, others: Refit, name: str) -> float:
    """Return the motion that a channel shows, as a multiple of what all others predict."""
    eta = parameters_as_start(before.box, others.box, others.fit.eta)
    noise = {**estimation.noise, name: 1e3 * estimation.noise[name]}
    predicted, measured = 0.0, 0.0
    left = residuals(before.box, before.decays, noise, eta)
    for decay, rest in zip(before.decays, left, strict=True):
        for r in decay.recordings:
            for c, channel in enumerate(r.group.channels):
                if channel.name == name:
                    model = r.values[:, c] - rest.values[name]
                    model = model - model.mean()
                    predicted += float(model @ model)
                    measured += float(model @ r.values[:, c])
    return measured / predicted if predicted > 0.0 else float("nan")


def _compared(before: Refit, others: Refit, name: str, gain: float) -> Explanation:
    sizes = f"it shows {gain:.3g} times what the other channels predict"
    explained = 1.0 - others.excess / before.excess
    shift = shift_between(before, others)
    return Explanation(f"gain of {name}", sizes, gain_advice(gain), explained, *shift)


def gain_advice(gain: float) -> str:
    """Return the advice on a channel that shows `gain` times the motion."""
    if abs(gain + 1.0) < 0.2:
        return "it is upside down: turn its sign"
    if gain > 0.0 and not _LEAST < gain < _MOST:
        return "its unit or gain is wrong: check the unit in the DBC (g, mg, m/s2, deg/s, rad/s)"
    return "check its calibration, unit and sign"


def _late(estimation: Estimation, before: Refit) -> Iterator[Explanation]:
    kinds = {c.corner is not None for group in before.box.groups for c in group.channels}
    if len(kinds) < 2:
        return

    def loose(c: Channel) -> Channel:
        return replace(c, delay_sigma_s=_LATE_SIGMA_S) if c.corner is not None else c

    after = refit(estimation, loose, before.fit.eta)
    delays: dict[str, list[float]] = {}
    for delay, group in zip(
        after.box.delays_s(after.fit.eta).tolist(), after.box.groups, strict=True
    ):
        delays.setdefault(_kind(group.channels[0]), []).append(delay)
    late_ms = _late_ms({kind: 1e3 * float(np.mean(of)) for kind, of in delays.items()})
    yield Explanation(
        f"{' and '.join(late_ms)} late",
        ", ".join(f"{kind} {late:#.2g} ms" for kind, late in late_ms.items())
        if len(late_ms) > 1
        else f"{max(late_ms.values()):#.2g} ms",
        "state delay_s and delay_sigma_s of these channels, or correct their clock",
        1.0 - after.excess / before.excess,
        *shift_between(before, after),
    )


def _kind(channel: Channel) -> str:
    if channel.corner is None:
        return "body sensors"
    return "hub sensors" if channel.quantity is Quantity.HUB_ACCELERATION else "travel sensors"


def _late_ms(delays_ms: dict[str, float]) -> dict[str, float]:
    """Return which kinds of sensors are later than the earliest kind, and by how much, ms.

    The fit determines differences only, and no sensor shows a motion before it happens.
    """
    early = min(delays_ms.values())
    most = max(delays_ms.values()) - early
    return {k: ms - early for k, ms in delays_ms.items() if ms - early > _ALIKE * most}


def _slow(estimation: Estimation, before: Refit) -> Iterator[Explanation]:
    channels = [c for group in before.box.groups for c in group.channels]
    kinds = {
        "body sensors": {c.name for c in channels if c.corner is None},
        "sensors at the wheels": {c.name for c in channels if c.corner is not None},
        "all sensors": {c.name for c in channels},
    }
    few = replace(estimation, decays=first_repeats(estimation.decays))
    tried = {
        (kind, hz): refit(few, _filtered(kinds[kind], hz), before.fit.eta, steps=RANKING_STEPS)
        for kind in kinds
        if kinds[kind]
        for hz in _COARSE_HZ
    }
    kind, near_hz = min(tried, key=lambda key: tried[key].fit.cost)
    eta = tried[kind, near_hz].fit.eta
    for hz in _FINE_HZ:
        if 0.4 < hz / near_hz < 2.5:
            tried[kind, hz] = refit(few, _filtered(kinds[kind], hz), eta)
    kind, hz = min(tried, key=lambda key: tried[key].fit.cost)
    after = refit(estimation, _filtered(kinds[kind], hz), tried[kind, hz].fit.eta)
    yield Explanation(
        "low-pass",
        f"near {hz:.0f} Hz on {kind}",
        "state low_pass_hz of these channels from the data sheet, or switch the filter off",
        1.0 - after.excess / before.excess,
        *shift_between(before, after),
    )


def _filtered(names: set[str], cut_off_hz: float) -> Callable[[Channel], Channel]:
    return lambda c: replace(c, low_pass_hz=cut_off_hz) if c.name in names else c
