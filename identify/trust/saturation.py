"""Saturation: peaks that are cut flat because the range of the sensor or its message ends there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from daq.runs import SampleGroup
from daq.samples.converter import flat_tops
from daq.sessions import Session
from dbc.finding import Finding, Severity
from dbc.samples import Quality
from dbc.words import counted

from ..decays.decay import Record
from ..decays.onset import GUARD_S, decay_start_s
from .format import listed


@dataclass(frozen=True, slots=True)
class _Top:
    """A flat top: its place, number of samples, value, and whether it lies within the decay."""

    channel: str
    run: str
    samples: int
    value: float
    unit: str
    in_decay: bool


def saturation_findings(session: Session, records: Sequence[Record]) -> tuple[Finding, ...]:
    """Find flat tops and samples outside the range of their message.

    On the bump they are harmless, because only the free decay is fitted.

    `session`: as recorded; rejected runs do not count.  `records`: those of its runs, as they are
    fitted.
    """
    used = {c.name for c in session.used_channels}
    groups = {
        run.label: [group for group in run.groups if used & set(group.values)]
        for run in session.accepted
    }
    tops = [top for record in records for top in _tops(record)]
    outside = [one for record in records for one in _outside(record, groups[record.label])]
    return (*_flat(tops), *_out_of_range(outside))


def _flat(tops: list[_Top]) -> Iterator[Finding]:
    decay = sorted((top for top in tops if top.in_decay), key=lambda top: -top.samples)
    if decay:
        worst = decay[0]
        yield Finding(
            "saturation",
            Severity.WARNING,
            f"flat tops in the free decay, {worst.samples} equal samples at {worst.value:.4g} "
            f"{worst.unit}, which is not by chance: {_places(decay)}; the sensor saturates and the "
            "true motion is larger: use a lower bump or a sensor with a wider range",
        )
    elif tops:
        worst = max(tops, key=lambda top: top.samples)
        yield Finding(
            "saturation",
            Severity.NOTE,
            f"flat tops on the bump only, {worst.samples} equal samples at {worst.value:.4g} "
            f"{worst.unit}: {_places(tops)}; harmless, for only the decay after it is fitted",
        )


def _places(tops: list[_Top]) -> str:
    return listed(f"{top.channel} in {top.run}" for top in tops)


def _tops(record: Record) -> Iterator[_Top]:
    start = decay_start_s(record) - GUARD_S
    for recording in record.recordings:
        for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
            for first, stop in flat_tops(column):
                yield _Top(
                    channel.name,
                    record.label,
                    stop - first,
                    float(column[first]),
                    channel.unit,
                    bool(recording.time_s[stop - 1] >= start),
                )


def _outside(record: Record, groups: Sequence[SampleGroup]) -> Iterator[tuple[str, int, bool]]:
    """Return message and run, samples out of range, and whether any is within the decay."""
    start = decay_start_s(record) - GUARD_S
    for group in groups:
        flagged = (group.quality & Quality.OUT_OF_RANGE) != 0
        if flagged.any():
            in_decay = bool((group.time_s[flagged] >= start).any())
            yield f"{group.name} in {record.label}", int(flagged.sum()), in_decay


def _out_of_range(outside: list[tuple[str, int, bool]]) -> Iterator[Finding]:
    decay = [(place, n) for place, n, in_decay in outside if in_decay]
    if decay:
        yield Finding(
            "out_of_range",
            Severity.WARNING,
            f"{counted(max(n for _, n in decay), 'sample')} outside the range that the DBC states, "
            f"in the free decay: {listed(place for place, _ in decay)}; a saturated sensor or a "
            "wrong DBC: check scale and range of the message, use a lower bump",
        )
    elif outside:
        yield Finding(
            "out_of_range",
            Severity.NOTE,
            f"{counted(max(n for _, n, _ in outside), 'sample')} outside the range that the DBC "
            f"states, on the bump only: {listed(place for place, _, _ in outside)}; harmless, for "
            "only the decay after it is fitted",
        )
