"""Leaves out runs that cannot be used: the bench rejects them, an import does not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq.channels import Channel, Quantity
from daq.runs import Run, RunStatus
from daq.samples.converter import FROZEN_S, Hold, longest_hold
from daq.sessions import Session
from daq.silence import Silence, longest_silence

from .bad_values import BadValue, without_bad_values
from .decay import Record, record_of
from .onset import decay_start_s, is_still, onset_s

_LEAST_S = 0.2
"""Least length of a decay, s: two periods of the wheels.  Shorter ones of a car with friction are
fitted by no model, after a long search."""
_Silences = Mapping[str, Silence]
"""The longest silence of each channel that shows a run, and the longest of all together."""
_ALL = ""
"""Stands for all channels together: then the clock jumped, or a piece was lost."""


@dataclass(frozen=True, slots=True)
class ChannelHold:
    """Longest hold of one value by one channel in one run."""

    channel: str
    run: str
    kind: str
    """`channel`, `run`, `kind`: name, label, and the label without the number of the repeat."""
    longest: Hold


@dataclass(frozen=True, slots=True)
class Usable:
    """The part of a session that can be used."""

    session: Session
    """The session; runs that cannot be used are rejected, with reasons, channels are unused."""
    records: tuple[Record, ...]
    """Record of each run that can be used and has samples."""
    silent: tuple[str, ...]
    """Channels that are silent for too long in most of these runs."""
    absurd: tuple[BadValue, ...]
    """Values of accepted runs that no sensor shows."""
    spikes: tuple[BadValue, ...]
    """Samples of accepted runs that stand out from those on both sides."""


def usable_session(session: Session) -> Session:
    """Return a session with only what can be used; see `usable`."""
    return usable(session).session


def usable(session: Session) -> Usable:
    """Find what can be used of a session.

    Values that no motion shows are missing (`without_bad_values`).

    A channel with one value in all runs is unused: the fit would take a dead sensor for a part that
    stands still.

    A run is left out if a channel that shows a part of it is silent for longer than the bench
    allows (`daq.silence`), or holds its value while the vehicle moves: its plug is loose, and what
    it sent before is not sure.  A channel with this fault in most of its runs was recorded so, and
    these runs are used as they are.  Also left out are runs in which times go back, all sensors are
    silent together (the clock jumped), nothing moves, or the free decay is missing.
    """
    session, absurd, spikes = without_bad_values(session)
    session = replace(session, channels=_living(session))
    used = {c.name for c in session.used_channels}
    silences = [_silences(run, used) if run.is_accepted else {} for run in session.runs]
    records = [
        record_of(run, session.channels) if run.is_accepted else None for run in session.runs
    ]
    held: dict[str, list[ChannelHold]] = {}
    for hold in frozen([record for record in records if record and record.recordings]):
        held.setdefault(hold.run, []).append(hold)
    shown = [name for own in silences for name in own]
    often_silent = _silent_in_most(silences)
    often_held = _most([hold.channel for own in held.values() for hold in own], shown)

    def judged(run: Run, own: _Silences, record: Record | None) -> Run:
        if record is None:
            return run
        reasons = (
            tuple(_back(run, used))
            or tuple(_silent(own, often_silent))
            or tuple(_held(held.get(run.label, ()), often_held))
            or tuple(_without_decay(record))
        )
        rejected = replace(run, status=RunStatus.REJECTED, reasons=(*run.reasons, *reasons))
        return rejected if reasons else run

    runs = tuple(map(judged, session.runs, silences, records))
    kept = [
        (record, own)
        for run, own, record in zip(runs, silences, records, strict=True)
        if record is not None and run.is_accepted
    ]
    return Usable(
        replace(session, runs=runs),
        tuple(record for record, _ in kept if record.recordings),
        _silent_in_most([own for _, own in kept]),
        absurd,
        spikes,
    )


def _living(session: Session) -> tuple[Channel, ...]:
    """Return the channels; those that never change, although they have values, are unused."""
    moves: dict[str, bool] = {}
    for group in (g for run in session.accepted for g in run.groups):
        for name, values in group.values.items():
            finite = values[np.isfinite(values)]
            if len(finite):
                moves[name] = moves.get(name, False) or bool((finite != finite[0]).any())
    return tuple(
        c if moves.get(c.name, True) else replace(c, quantity=Quantity.UNUSED, corner=None)
        for c in session.channels
    )


def _silent_in_most(silences: Sequence[_Silences]) -> tuple[str, ...]:
    """Return the channels that are silent for too long in most of the runs that they show."""
    whole = [own for own in silences if own and not own[_ALL].is_stale]
    shown = [name for own in whole for name in own]
    stale = [name for own in whole for name, silence in own.items() if silence.is_stale]
    return _most(stale, shown)


def _most(faulty: Sequence[str], shown: Sequence[str]) -> tuple[str, ...]:
    """Return the channels with a fault in most of the runs that they show."""
    return tuple(n for n in dict.fromkeys(faulty) if 2 * faulty.count(n) > shown.count(n))


def _silences(run: Run, used: set[str]) -> _Silences:
    """Return the longest silences in a run."""
    times = {
        name: group.time_s[np.isfinite(values) & np.isfinite(group.time_s)]
        for group in run.groups
        for name, values in group.values.items()
        if name in used
    }
    clock = {name: time_s.tobytes() for name, time_s in times.items() if len(time_s)}
    if not clock:
        return {}
    # Most channels of a group share their times, so each clock is looked at once.
    clocks = {key: times[name] for name, key in clock.items()}
    together = np.sort(np.concatenate(list(clocks.values())), kind="stable")
    clock[_ALL] = b""
    clocks[b""] = together[np.diff(together, prepend=-np.inf) > 0.0]
    begin_s, end_s = float(together[0]), float(together[-1])
    silence = {key: longest_silence(time_s, begin_s, end_s) for key, time_s in clocks.items()}
    return {name: silence[key] for name, key in clock.items()}


def _back(run: Run, used: set[str]) -> Iterator[str]:
    """Yield a line for each clock of used channels that goes back."""
    for group in run.groups:
        back = np.flatnonzero(np.diff(group.time_s) < 0.0)
        if used & group.values.keys() and len(back):
            yield f"the times of {group.name} go back after {group.time_s[back[0]]:.2f} s"


def _silent(silences: _Silences, usual: Sequence[str]) -> Iterator[str]:
    """Yield a line for each time in which channels were silent together."""
    together: dict[str, list[str]] = {}
    for name, silence in silences.items():
        if silence.is_stale and name not in usual:
            begin_s = max(silence.begin_s, 0.0)  # the first sample may come before 0
            span = f"from {begin_s:.2f} to {silence.end_s:.2f} s (limit {silence.limit_s:.2f} s)"
            together.setdefault(span, []).append(name)
    if silences and silences[_ALL].is_stale:
        together = {span: ["all sensors"] for span, names in together.items() if _ALL in names}
    for span, names in together.items():
        yield f"{', '.join(names)} sent nothing {span}"


def _held(holds: Sequence[ChannelHold], usual: Sequence[str]) -> Iterator[str]:
    """Yield a line for each time for which channels held their values."""
    together: dict[str, list[str]] = {}
    for hold in holds:
        if hold.channel not in usual:
            together.setdefault(f"{hold.longest.length_s:.2f} s", []).append(hold.channel)
    for length, names in together.items():
        yield f"{', '.join(names)} held one value for {length} (limit {FROZEN_S:.2f} s)"


def _without_decay(record: Record) -> Iterator[str]:
    """Yield the reason why a run with samples shows no free decay."""
    if not record.recordings:
        return
    length_s = record.end_s - decay_start_s(record)
    if is_still(record):
        yield "nothing moves in it"
    elif length_s < _LEAST_S:
        least = f"record longer (at least {_LEAST_S:.2f} s)"
        yield f"it ends {max(length_s, 0.0):.2f} s after the bump: {least}"


def frozen(records: Sequence[Record]) -> tuple[ChannelHold, ...]:
    """Return the values that were held while the vehicle moved, the longest first.

    A channel may be silent by symmetry (roll in a bounce run), and a coarse one may stay at one
    step of its converter.  So a held value counts only where the channel changes often enough at
    rest before the bump, or, if it is constant there too, in a repeat of the run.
    """
    holds = []
    for record, (rest_s, start_s) in zip(records, _starts_s(records), strict=True):
        kind = record.label.rpartition("_")[0]
        for recording in record.recordings:
            for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
                longest = longest_hold(recording.time_s, column, rest_s, start_s)
                holds.append(ChannelHold(channel.name, record.label, kind, longest))
    found = [one for one in holds if one.longest.length_s >= FROZEN_S and _is_frozen(one, holds)]
    return tuple(sorted(found, key=lambda one: -one.longest.length_s))


def _is_frozen(one: ChannelHold, holds: Sequence[ChannelHold]) -> bool:
    rate = one.longest.rest_rate
    if one.longest.constant or np.isnan(rate):
        repeats = [
            other.longest.decay_rate
            for other in holds
            if other.kind == one.kind and other.channel == one.channel and other.run != one.run
        ]
        rate = float(np.mean(repeats)) if repeats else np.nan
    return one.longest.is_frozen(rate)


def _starts_s(records: Sequence[Record]) -> list[tuple[float, float]]:
    """Return the end of the rest and the start of the decay of each record, s.

    Where a stuck channel hides them, the start is that of the other runs, and ends the rest.
    """
    onsets = [onset_s(record) for record in records]
    starts = [
        decay_start_s(record) if onset is not None else np.nan
        for record, onset in zip(records, onsets, strict=True)
    ]
    known = [start for start in starts if np.isfinite(start)]
    usual = np.median(known) if known else -np.inf
    return [
        (start, start) if onset is None else (onset, start)
        for record, onset, given in zip(records, onsets, starts, strict=True)
        for start in [given if np.isfinite(given) else max(usual, record.start_s)]
    ]
