"""Names the runs and channels of a session that are not used because they cannot be."""

from __future__ import annotations

from collections.abc import Iterator

from daq.sessions import Session
from dbc.finding import Finding, Severity

from ..decays.absurd import absurd
from ..decays.usable import Usable
from .format import listed


def unused_findings(session: Session, used: Usable) -> Iterator[Finding]:
    """Name what `identify.decays.usable` left out of a session, with the reasons.

    `used`: what is left.
    """
    units = session.units
    wrong = list(absurd(session))
    if wrong:
        places = [
            f"{one.channel} in {one.run} ({one.count}: {one.value:g} {units[one.channel]})"
            for one in wrong
        ]
        yield Finding(
            "absurd_values",
            Severity.NOTE,
            f"values that no sensor shows: {listed(places)}; they are taken as missing: check "
            "byte order, scale and unit of the signal in the DBC, and the sensor",
        )
    if used.spikes:
        places = [
            f"{one.channel} in {one.run} at {one.time_s:.3f} s "
            f"({one.value:.4g} {units[one.channel]})"
            for one in used.spikes
        ]
        yield Finding(
            "spikes",
            Severity.NOTE,
            f"samples that stand out from those on both sides: {listed(places)}; they are taken as "
            "missing: check supply and plug of the sensor, and the frames at these times",
        )
    reasons: dict[str, list[str]] = {}
    for before, run in zip(session.runs, used.session.runs, strict=True):
        if run.status != before.status:
            reasons.setdefault("; ".join(run.reasons), []).append(run.label)
    if reasons:
        runs = "; ".join(f"{listed(labels)}: {why}" for why, labels in reasons.items())
        yield Finding(
            "left_out",
            Severity.NOTE,
            f"not used: {runs}; check plugs, clock and cut of the runs, and repeat them; "
            "where a sensor was off on purpose, set its channels to unused",
        )
    pairs = zip(session.channels, used.session.channels, strict=True)
    dead = [channel.name for channel, now in pairs if channel.quantity != now.quantity]
    if dead:
        yield Finding(
            "dead_channels",
            Severity.NOTE,
            f"never moves in any run: {listed(dead)}; the runs are fitted by the other channels: "
            "repair the sensor or map it as unused",
        )
    if used.silent:
        yield Finding(
            "silent_channels",
            Severity.NOTE,
            f"silent for a part of most runs: {listed(used.silent)}; these runs are fitted by what "
            "came: check sensor and plug",
        )
