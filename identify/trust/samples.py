"""Samples that are missing, held or cut flat while the vehicle moves, and what a session lacks.

Every sample is fitted at its own time, so uneven sampling is legal and a lost frame costs no more
than its information: the intervals show it.  The harmful faults are a channel that looks alive but
is not, and peaks beyond the range of a sensor or its message.  On the bump both are harmless: only
the free decay is fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from daq.channels import Quantity
from daq.samples.converter import FROZEN_S, flat_tops
from daq.sessions import Session
from daq.vehicle import parameter_names, parameter_unit
from dbc.words import Finding, Severity

from ..decays.decay import GUARD_S, Record, decay_start_s
from ..decays.usable import Usable, frozen
from ..model.matrices import SCALED
from .finding import listed


def sample_findings(session: Session, records: Sequence[Record]) -> Iterator[Finding]:
    """Yield findings on the samples of the accepted runs.

    `session`: as recorded; rejected runs do not count.  `records`: those of its runs, as they are
    fitted.
    """
    runs, used = session.accepted, session.used_channels
    starts_s = {record.label: decay_start_s(record) - GUARD_S for record in records}
    missing = [
        f"{c.name} in {run.label}"
        for c in used
        for run in runs
        if not any(np.isfinite(g.values[c.name]).any() for g in run.groups if c.name in g.values)
    ]
    if missing:
        text = (
            f"channels without a sample: {listed(missing)}; these runs are fitted by the others: "
            "check sensor and plug"
        )
        yield Finding("missing_channels", Severity.NOTE, text)
    if stuck := frozen(records):
        text = (
            f"holds one value for {stuck[0].longest.length_s:.2f} s (limit {FROZEN_S:g}) while the "
            f"vehicle moves: {listed(f'{hold.channel} in {hold.run}' for hold in stuck)}; these "
            "samples are not measured and bias the result: check the sensor and repeat the run"
        )
        yield Finding("stuck_channels", Severity.WARNING, text)
    tops = [
        (stop - first, f"{column[first]:.4g} {channel.unit}", f"{channel.name} in {record.label}")
        for record in records
        for r in record.recordings
        for channel, column in zip(r.group.channels, r.values.T, strict=True)
        for first, stop in flat_tops(column)
        if r.time_s[stop - 1] >= starts_s[record.label]
    ]
    if tops:
        tops.sort(key=lambda top: -top[0])
        text = (
            f"flat tops in the free decay, {tops[0][0]} equal samples at {tops[0][1]}, which is "
            f"not by chance: {listed(place for *_, place in tops)}; the sensor saturates and the "
            "true motion is larger: use a lower bump or a sensor with a wider range"
        )
        yield Finding("saturation", Severity.WARNING, text)


# Names what a session lacks for a fit, and what of it cannot be used ------------------------------

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
    lacking = [Finding(code, Severity.ERROR, text) for code, text in _lacking(records, session)]
    reasons = [replace(finding, severity=Severity.ERROR) for finding in unused]
    return (*reasons, *lacking) if lacking else ()


def _lacking(records: Sequence[Record], session: Session) -> Iterator[tuple[str, str]]:
    """Yield code and text of what is missing for a fit."""
    if not records:
        text = "no accepted run: record bounce, pitch and roll in both mass states"
        if session.accepted:
            text = "no accepted run has a sample: check the sensors, or the map of the channels"
        elif session.runs:
            first = session.runs[0]
            why = "; ".join(first.reasons) or "by hand"
            text = f"no accepted run; all {len(session.runs)} are rejected, {first.label}: {why}"
        yield "no_runs", text
        return
    names = [record.label for record in records]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        yield "run_names", f"two accepted runs are named {listed(twice)}: number the repeats"
        return
    channels = {c for record in records for r in record.recordings for c in r.group.channels}
    if all(c.quantity is Quantity.UNUSED for c in channels):
        yield "channels", "no channel that the model knows: map the sensors to quantities"
    elif len({c.name for c in channels}) == 1:
        yield (
            "channels",
            f"one channel only ({channels.pop().name}): it cannot separate body from wheels; "
            "record an IMU on the body and an accelerometer on each hub",
        )
    yield from (("rate", text) for text in _rates(records))
    yield from (("units", text) for text in _units(records))
    yield from (("mass_states", text) for text in _no_known_mass(records, session))


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
    left_out = "; ".join(f"{listed(labels)}: {why}" for why, labels in reasons.items())
    channels = zip(session.channels, used.session.channels, strict=True)
    table = (
        (
            "absurd_values",
            "values that no sensor shows",
            listed(
                f"{one.channel} in {one.run} ({one.count}: {one.value:g} {units[one.channel]})"
                for one in used.absurd
            ),
            "they are taken as missing: check byte order, scale and unit of the signal in the DBC, "
            "and the sensor",
        ),
        (
            "spikes",
            "samples that stand out from those on both sides",
            listed(
                f"{one.channel} in {one.run} at {one.time_s:.3f} s "
                f"({one.value:.4g} {units[one.channel]})"
                for one in used.spikes
            ),
            "they are taken as missing: check supply and plug of the sensor, and the frames at "
            "these times",
        ),
        (
            "left_out",
            "not used",
            left_out,
            "check plugs, clock and cut of the runs, and repeat them; where a sensor was off on "
            "purpose, set its channels to unused",
        ),
        (
            "dead_channels",
            "never moves in any run",
            listed(was.name for was, now in channels if was.quantity != now.quantity),
            "the runs are fitted by the other channels: repair the sensor or map it as unused",
        ),
        (
            "silent_channels",
            "silent for a part of most runs",
            listed(used.silent),
            "these runs are fitted by what came: check sensor and plug",
        ),
    )
    for code, fault, places, advice in table:
        if places:
            yield Finding(code, Severity.NOTE, f"{fault}: {places}; {advice}")
