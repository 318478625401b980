"""Saturation: tops cut flat because the sensor or its message ends there."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import Quantity
from daq.runs import Run, RunStatus
from daq.sessions import Session
from dbc.samples import Quality

from ..decays.decay import Record, record_of
from ..decays.onset import GUARD_S, decay_start_s
from .finding import Finding, Verdict
from .format import listed

FLAT_SAMPLES = 3
"""So many equal samples at the extreme of a run are a flat top."""
_STEEP = 4.5
"""Converter steps by which a signal must jump into a flat top and out of it: a parabola that
stays within one step for three samples leaves it by three steps, four with rounding."""


_CHANCE = 1e-6
"""Odds at which a top may be flat by chance, where a coarse converter often repeats a value."""


@dataclass(frozen=True, slots=True)
class _Top:
    """A flat top: where, how many samples, at which value, and whether within the decay."""

    channel: str
    run: str
    samples: int
    value: float
    unit: str
    in_decay: bool


def saturation_findings(session: Session) -> tuple[Finding, ...]:
    """Find flat tops and samples outside the range of their message.

    On the bump they are harmless, for only the free decay is fitted.

    Parameters
    ----------
    session : Session
        As recorded; rejected runs do not count.
    """
    runs = [run for run in session.runs if run.status is RunStatus.ACCEPTED]
    records = [record_of(run, session.channels) for run in runs]
    chance = _repeats(records)
    tops = [t for record in records if record.recordings for t in _tops(record, chance)]
    outside = [entry for run in runs for entry in _outside(run, session)]
    return (*_flat(tops), *_out_of_range(outside))


def _flat(tops: list[_Top]) -> Iterator[Finding]:
    decay = sorted((top for top in tops if top.in_decay), key=lambda top: -top.samples)
    if decay:
        worst = decay[0]
        yield Finding(
            "saturation",
            Verdict.DOUBTFUL,
            f"flat tops in the free decay, {worst.samples} equal samples at {worst.value:.4g} "
            f"{worst.unit} (limit {FLAT_SAMPLES - 1}): {_places(decay)}; the sensor saturates and "
            "the true motion is larger: use a lower bump or a sensor with a wider range",
        )
    elif tops:
        worst = max(tops, key=lambda top: top.samples)
        yield Finding(
            "saturation",
            Verdict.OK,
            f"flat tops on the bump only, {worst.samples} equal samples at {worst.value:.4g} "
            f"{worst.unit}: {_places(tops)}; harmless, for only the decay after it is fitted",
        )


def _places(tops: list[_Top]) -> str:
    return listed(f"{top.channel} in {top.run}" for top in tops)


def _repeats(records: Sequence[Record]) -> dict[str, float]:
    """Return how often a sample repeats the one before by chance, by channel."""
    equal: Counter[str] = Counter()
    total: Counter[str] = Counter()
    for recording in (q for record in records for q in record.recordings):
        for channel, column in zip(recording.clock.channels, recording.values.T, strict=True):
            within = (column > column.min()) & (column < column.max())
            same = np.diff(column) == 0.0
            equal[channel.name] += int(np.sum(same & within[1:]))
            total[channel.name] += int(np.sum(within[1:]))
    return {name: equal[name] / max(n, 1) for name, n in total.items()}


def _tops(record: Record, chance: Mapping[str, float]) -> Iterator[_Top]:
    start = decay_start_s(record) - GUARD_S
    for recording in record.recordings:
        for channel, column in zip(recording.clock.channels, recording.values.T, strict=True):
            for first, last in _flat_tops(column):
                samples = last - first + 1
                if samples * chance[channel.name] ** (samples - 1) < _CHANCE:
                    yield _Top(
                        channel.name,
                        record.label,
                        samples,
                        float(column[first]),
                        channel.unit,
                        bool(recording.time_s[last] >= start),
                    )


def _flat_tops(column: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return first and last sample of every flat top."""
    steps = np.diff(column)
    levels = np.diff(np.unique(column))
    if not len(levels):
        return []  # never moves: not this gate's affair
    change = np.flatnonzero(steps != 0.0)
    first, last = change[:-1] + 1, change[1:]  # plateaus with a step on either side
    at_end = (column[first] == column.max()) | (column[first] == column.min())
    into, out = np.abs(steps[first - 1]), np.abs(steps[last])
    steep = np.minimum(into, out) > _STEEP * levels.min()
    found = at_end & steep & (last - first + 1 >= FLAT_SAMPLES)
    return list(zip(first[found].tolist(), last[found].tolist(), strict=True))


def _outside(run: Run, session: Session) -> Iterator[tuple[str, int, bool]]:
    """Return message and run, samples out of range, and whether some lie within the decay."""
    record = record_of(run, session.channels)
    if not record.recordings:
        return
    start = decay_start_s(record) - GUARD_S
    used = {c.name for c in session.channels if c.quantity is not Quantity.UNUSED}
    for group in run.groups:
        flagged = (group.quality & Quality.OUT_OF_RANGE) != 0
        if used & set(group.values) and flagged.any():
            in_decay = bool((group.time_s[flagged] >= start).any())
            yield f"{group.name} in {run.label}", int(flagged.sum()), in_decay


def _out_of_range(outside: list[tuple[str, int, bool]]) -> Iterator[Finding]:
    decay = [(place, n) for place, n, in_decay in outside if in_decay]
    if decay:
        yield Finding(
            "out_of_range",
            Verdict.DOUBTFUL,
            f"{max(n for _, n in decay)} samples outside the range that the DBC states, in the "
            f"free decay: {listed(place for place, _ in decay)}; a saturated sensor or a wrong "
            "DBC: check scale and range of the message, use a lower bump",
        )
    elif outside:
        yield Finding(
            "out_of_range",
            Verdict.OK,
            f"{max(n for _, n, _ in outside)} samples outside the range that the DBC states, on "
            f"the bump only: {listed(place for place, _, _ in outside)}; harmless, for only the "
            "decay after it is fitted",
        )
