"""Names what a session lacks for a fit, and what of it cannot be used."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from daq.channels import Quantity
from daq.sessions import Session
from daq.vehicle import parameter_names, parameter_unit
from dbc.finding import Finding, Severity

from ..decays.decay import Record
from ..decays.usable import Usable
from ..model.facts import SCALED
from .finding import listed

_LEAST_RATE_HZ, _MOST_RATE_HZ = 20.0, 1e5
"""Rates, Hz, below which no sensor shows how the wheels swing, and above which none sends."""
_LARGEST = {"m": (0.5, "mm"), "rad/s": (6.0, "deg/s")}
"""Largest peak to peak of a quantity in a unit that a car on its wheels can reach, and the unit in
which more of it is likely to be."""


def shortcomings(
    records: Sequence[Record], session: Session, unused: Sequence[Finding] = ()
) -> tuple[Finding, ...]:
    """Return findings on what is missing for a fit, with advice.

    `unused`: what cannot be used (`unused_findings`), then the reason why something is missing.
    """
    names = [record.label for record in records]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        text = f"two accepted runs are named {listed(twice)}: number the repeats"
        return (Finding("run_names", Severity.ERROR, text),)
    if records:
        texts = [
            *(("channels", text) for text in _channels(records)),
            *(("rate", text) for text in _rates(records)),
            *(("units", text) for text in _units(records)),
            *(("mass_states", text) for text in _no_known_mass(records, session)),
        ]
    elif session.accepted:
        text = "no accepted run has a sample: check the sensors, or the map of the channels"
        texts = [("no_runs", text)]
    elif session.runs and not unused:
        first = session.runs[0]
        why = "; ".join(first.reasons) or "by hand"
        text = f"no accepted run; all {len(session.runs)} are rejected, {first.label}: {why}"
        texts = [("no_runs", text)]
    else:
        text = "no accepted run: record bounce, pitch and roll in both mass states"
        texts = [("no_runs", text)]
    lacking = (Finding(code, Severity.ERROR, text) for code, text in texts)
    return (*(replace(f, severity=Severity.ERROR) for f in unused), *lacking) if texts else ()


def _channels(records: Sequence[Record]) -> Iterator[str]:
    channels = [c for r in records for q in r.recordings for c in q.group.channels]
    names = {c.name for c in channels}
    if all(c.quantity is Quantity.UNUSED for c in channels):
        yield "no channel that the model knows: map the sensors to quantities"
    elif len(names) == 1:
        yield (
            f"one channel only ({names.pop()}): it cannot separate body from wheels; record an IMU "
            "on the body and an accelerometer on each hub"
        )


def _rates(records: Sequence[Record]) -> Iterator[str]:
    """Yield a text if no sensor is fast enough for the wheels: mostly a wrong unit of time."""
    times = [r.time_s for one in records for r in one.recordings if len(r.time_s) > 1]
    step_s = min((np.median(np.diff(time_s)) for time_s in times), default=0.0)
    if step_s * _LEAST_RATE_HZ > 1.0:
        advice = "sample at 50 Hz or more"
        for unit, factor in (("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3)):
            if factor * step_s * _LEAST_RATE_HZ <= 1.0 <= factor * step_s * _MOST_RATE_HZ:
                advice = f"are the times in {unit}? Give them in s"
        yield f"samples come at {1.0 / step_s:.2g} Hz, but wheels swing at 10 Hz: {advice}"


def _units(records: Sequence[Record]) -> Iterator[str]:
    """Yield a text for each unit in which several channels show more than a car can move."""
    peaks: dict[str, dict[str, float]] = {}
    for recording in (r for record in records for r in record.recordings):
        for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
            of_unit = peaks.setdefault(channel.unit, {})
            of_unit[channel.name] = max(of_unit.get(channel.name, 0.0), float(np.ptp(column)))
    for unit, (limit, likely) in _LARGEST.items():
        far = [name for name, peak in peaks.get(unit, {}).items() if peak > limit]
        if len(far) > 1:  # a single wrong one is found by the others, with its factor
            most = max(peaks[unit][name] for name in far)
            moves = f"{listed(far)} change by up to {most:.3g} {unit}, more than a car can move"
            yield f"{moves}: are they in {likely}? State the unit of the signals"


def _no_known_mass(records: Sequence[Record], session: Session) -> Iterator[str]:
    """Yield a text where nothing fixes the size of masses and forces.

    Free decays leave a common factor of them open.  It follows from a fact that has a mass or a
    force in it, or from runs both with added mass and without.
    """
    vehicle = session.vehicle
    names = parameter_names(vehicle.structure)
    fixing = {*SCALED, *(name for name in names if parameter_unit(name) != "m")}
    if any(fact.quantity in fixing for fact in vehicle.facts):
        return
    present = {record.mass_state for record in records}
    states = [state for state in session.mass_states if state.name in present]
    loaded = [s for s in states if s.added.weights or s.added.matrix.any()]
    if len(loaded) == len(states):
        yield (
            "no accepted baseline run: record the vehicle without added mass, or weigh it and "
            "state the loads as facts"
        )
    elif not loaded:
        yield (
            "no accepted run with added mass and no scales: free decays alone fix no absolute "
            "mass; add known masses and bump again, or weigh the vehicle (total and front axle) "
            "and state the loads as facts"
        )


def unused_findings(session: Session, used: Usable) -> Iterator[Finding]:
    """Name what `identify.decays.usable` left out of a session, with the reasons.

    `used`: what is usable of it.
    """
    units = session.units
    reasons: dict[str, list[str]] = {}
    for before, run in zip(session.runs, used.session.runs, strict=True):
        if run.status != before.status:
            reasons.setdefault("; ".join(run.reasons), []).append(run.label)
    channels = zip(session.channels, used.session.channels, strict=True)
    places = {
        "absurd_values": [
            f"{one.channel} in {one.run} ({one.count}: {one.value:g} {units[one.channel]})"
            for one in used.absurd
        ],
        "spikes": [
            f"{one.channel} in {one.run} at {one.time_s:.3f} s "
            f"({one.value:.4g} {units[one.channel]})"
            for one in used.spikes
        ],
        "left_out": [f"{listed(labels)}: {why}" for why, labels in reasons.items()],
        "dead_channels": [was.name for was, now in channels if was.quantity != now.quantity],
        "silent_channels": list(used.silent),
    }
    for code, (begin, end) in _UNUSED.items():
        if places[code]:
            which = "; ".join(places[code]) if code == "left_out" else listed(places[code])
            yield Finding(code, Severity.NOTE, f"{begin}: {which}; {end}")


_UNUSED = {
    "absurd_values": (
        "values that no sensor shows",
        "they are taken as missing: check byte order, scale and unit of the signal in the DBC, and "
        "the sensor",
    ),
    "spikes": (
        "samples that stand out from those on both sides",
        "they are taken as missing: check supply and plug of the sensor, and the frames at these "
        "times",
    ),
    "left_out": (
        "not used",
        "check plugs, clock and cut of the runs, and repeat them; where a sensor was off on "
        "purpose, set its channels to unused",
    ),
    "dead_channels": (
        "never moves in any run",
        "the runs are fitted by the other channels: repair the sensor or map it as unused",
    ),
    "silent_channels": (
        "silent for a part of most runs",
        "these runs are fitted by what came: check sensor and plug",
    ),
}
"""Begin and end of the finding on each kind of what is left out."""
