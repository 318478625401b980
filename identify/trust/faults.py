"""Faults of the bench that are found by fitting again, and the choice of the cause that is named.

Labels, channels, clocks: each is a table of trials; the best is fitted on all runs, and must
explain most of the misfit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq.channels import Channel, Quantity
from daq.check.signs import opposed_signs
from daq.loading import WEIGHT_SAG
from daq.runs import longest_gap_s
from daq.sessions import Session
from daq.vehicle import Corner, Fact, MassState
from dbc.words import Finding, counted

from ..decays.decay import FreeDecay, Record, decay_start_s, onset_s
from ..fit.estimation import Estimation, generic_vehicles
from ..fit.likelihood import HOLD, residuals
from ..model.matrices import SCALED
from .finding import MOST, Cause, listed
from .hypotheses import LATE_ADVICE, ROTATIONS, kind_of_sensor, rank_causes
from .refit import AS_STATED, Refit, Trial, compared, parameters_as_start, ranked, refit
from .residuals import moves_without, repeat_findings, some_runs_are_wrong
from .statements import (
    ONE_WEIGHT,
    contradicted_by_sag,
    contradictions,
    scale_facts,
    shift_without_scales,
    wrong_weight,
)

_AHEAD = 0.95
"""Share of a sensor's explanation that an effect of the vehicle must reach to be preferred."""
_LEAST_GAIN = 100.0
"""Fall of the squared residuals, in units of the noise, below which a swap is chance."""
_FEWEST = 3
"""Least number of channels of which one can be wrong."""
_SUSPECTED = 4
"""Number of suspected channels that are left out in turn."""
_CLEARS = 0.9
"""Share of the misfit that must disappear without a channel to call it wrong, and above which no
other cause is sought."""
_ALONE = 0.97
"""Share above which a wrong channel is not compared with lateness and low-pass; below, it may be
the slowest of several sensors."""
_LEAST, _MOST = 0.7, 1.4
"""Gains beyond which a unit is wrong rather than a calibration."""
_CHOICE = 1.5
"""Factor on what a low-pass leaves: it looks like lateness, and has more to choose from."""
_LATE_SIGMA_S = 0.03
_ALIKE = 0.2
"""Share of the largest difference below which a kind of sensors counts as early as the earliest."""
_COARSE_HZ = (15.0, 40.0)
_FINE_HZ = (8.0, 10.0, 20.0, 28.0, 56.0, 80.0)
_LEAST_S = 0.1
"""Least length of the samples of a group that are fitted alone, s."""
_BUMP_S = 0.2
"""Length of a bump that is not stated, s."""
_MARGIN_S, _FEWEST_AT_REST = 0.005, 20
"""Time before the onset that does not count as rest, s, and least number of samples at rest."""
_LB_KG = 0.45359237
_ALONE_STEPS = 30
_DRIFT_SIGMAS = 6.0
"""Size of a drift, in standard deviations by the noise and by the scatter of the runs, from which
it is none by chance."""

_FL, _FR, _RL, _RR = Corner
_EXCHANGES: dict[str, dict[Corner, Corner]] = {
    "front left and front right": {_FL: _FR, _FR: _FL},
    "rear left and rear right": {_RL: _RR, _RR: _RL},
    "front left and rear left": {_FL: _RL, _RL: _FL},
    "front right and rear right": {_FR: _RR, _RR: _FR},
    "left and right": {_FL: _FR, _FR: _FL, _RL: _RR, _RR: _RL},
    "front and rear": {_FL: _RL, _RL: _FL, _FR: _RR, _RR: _FR},
}


@dataclass(frozen=True, slots=True)
class Causes:
    """The named causes of a misfit, and all that were tried."""

    findings: tuple[Finding, ...] = ()
    """Findings on what is named."""
    tried: tuple[Cause, ...] = ()
    """Every cause that stands out of the noise."""

    @classmethod
    def of(cls, cause: Cause | None) -> Causes:
        """Return one cause that is named, or none."""
        return cls((cause.finding,), (cause,)) if cause else cls()


def faults_of_bench(session: Session, records: Sequence[Record], estimation: Estimation) -> Causes:
    """Return the fault of the bench that explains a misfit, the surest first.

    Sag may contradict the weights of a fit that holds, too.  Where one run is odd, no fault of all
    runs is sought.
    """
    signs = () if estimation.holds else opposed_signs(session.accepted, session.channels)
    if stated_wrong := signs or contradicted_by_sag(session, records):
        return Causes(tuple(map(_as_cause, stated_wrong)))
    for search in (clock_jump, second_bump, drift, wrong_weight, wrong_channel):
        if estimation.holds or (search is wrong_weight and some_runs_are_wrong(estimation)):
            break
        if cause := search(estimation):
            return Causes.of(cause)
    return Causes()


def _as_cause(finding: Finding) -> Finding:
    fault = ONE_WEIGHT if finding.code == WEIGHT_SAG else "wrong signs"
    return replace(finding, text=f"likely cause: {fault}, {finding.text}: {finding.advice}")


def swapped_or_late(estimation: Estimation) -> Causes:
    """Return swapped labels, a lateness or a low-pass that explains nearly all of a misfit, if any.

    A bump that lasts longer than stated looks like a low-pass: ask only where no later start holds.
    Hubs of front and rear take up to 84 % of what the elements of a real car do, if exchanged.

    `estimation`: a fit that does not hold.
    """
    if some_runs_are_wrong(estimation):
        return Causes()
    swap = swapped_labels(estimation)
    cause = swap if swap and swap.explained > _CLEARS else wrong_sensors(estimation)[-1]
    return Causes.of(cause) if cause.explained > _CLEARS else Causes()


def likely_causes(estimation: Estimation) -> Causes:
    """Return what may cause a misfit, or an effect that matters although there is none.

    An outlying run comes first, because it imitates other causes; a dependence on amplitude last.
    """
    scored = rank_causes(estimation)
    repeats = repeat_findings(estimation, scored[0].strength)
    for odd in (finding for finding in repeats if finding.code == "odd_run"):
        share = 1.0 - (odd.value - 1.0) / max(estimation.chi2_per_n - 1.0, 1e-9)
        moved = moves_without(estimation, odd.subject.split(", "))
        return Causes(repeats, (Cause(f"run {odd.subject}", explained=share, moved=moved),))
    worst = next(iter(contradictions(estimation)), None) if estimation.holds else None
    if worst and worst.of_place:  # a gain, or a bar, would explain a part of it
        scored = tuple(s for s in scored if s.gain > worst.sigmas**2)
    named, tried = _likeliest(estimation, [cause for cause in scored if cause.strength > 1.0])
    findings = (named.finding,) if named else ()
    return Causes(findings if named and not named.nonlinear else (*findings, *repeats), tried)


def _likeliest(
    estimation: Estimation, scored: Sequence[Cause]
) -> tuple[Cause | None, tuple[Cause, ...]]:
    """Return the cause to be named, if any, and all that were tried.

    `scored`: causes beyond chance, the strongest first.
    """
    holds = estimation.holds
    best = [replace(c, explained=0.0) if holds else c for c in scored]
    tried = list(best)
    for cause in (c for c in best if c.kind == "weights"):  # or these are right, and the scales off
        moved = shift_without_scales(estimation)
        tried.append(replace(cause, name="scales off by a common factor", moved=moved))
    if not best:
        return None, ()
    if holds and (swap := swapped_labels(estimation)):  # else: `swapped_or_late`
        return swap, (*tried, swap)
    named = _with_advice(estimation, best[0])
    if not holds and named.explained < _CLEARS:
        sensors = wrong_sensors(estimation, [c.subject for c in best if c.kind == "gain"])
        tried += sensors
        ahead = [c for c in sensors if c.explained * _AHEAD > named.explained]
        named = ahead[-1] if ahead else named
    return (named if holds or named.explained > MOST else None), tuple(tried)


def _with_advice(estimation: Estimation, cause: Cause) -> Cause:
    """Return a scored cause with advice: a gain also with its sizes, weights with the larger shift.

    If the weights are right, the scales of the facts are wrong; either may be the cause.
    """
    if cause.kind == "gain":
        gain = gain_of(estimation, cause.subject)
        return replace(cause, sizes=gain.sizes, advice=gain.advice)
    if cause.kind == "weights":
        facts = " and ".join(scale_facts(estimation.box))
        advice = f"weigh them again, or {facts}: one of the two scales shows too much"
        of_scales = replace(cause, moved=shift_without_scales(estimation))
        return replace(max(cause, of_scales, key=lambda one: one.shift), advice=advice)
    return cause


# Labels -------------------------------------------------------------------------------------------


def swapped_labels(estimation: Estimation) -> Cause | None:
    """Return the swapped labels that explain a misfit; None if there are none.

    No swap has more unknowns than the fit as stated, so the costs are compared directly.
    """
    tried = ranked(estimation, _swaps(estimation))
    if not tried:
        return None
    rough, swap = tried[0]
    before, after = refit(estimation), refit(estimation, swap, rough.fit.eta)
    code = "swapped_labels" if "swapped" in swap.name else "pounds"
    cause = compared(before, after, Cause(swap.name, swap.advice, certain=True, code=code))
    clear = cause.explained > MOST and before.fit.cost - after.fit.cost >= _LEAST_GAIN
    return cause if clear else None


def _swaps(estimation: Estimation) -> Iterator[Trial]:
    """Yield exchanges of mass states, corners and rates of the body, and weights in pounds."""
    channels = [c for group in estimation.box.groups for c in group.channels]
    present = sorted({decay.mass_state for decay in estimation.decays})
    if len(present) == 2:
        other = dict(zip(present, reversed(present), strict=True))
        advice = "runs labelled with the weights were made without them: label them the other way"
        yield Trial("mass states swapped", advice, mass_state=other.__getitem__)
    for quantity in dict.fromkeys(c.quantity for c in channels if c.corner is not None):
        at = {c.corner: c for c in channels if c.quantity is quantity}
        for where, exchange in _EXCHANGES.items():
            pairs = {at[a].name: at[b] for a, b in exchange.items() if a in at and b in at}
            if len(pairs) == len(exchange):
                yield _swapped(f"{quantity.replace('_', ' ')} of {where} swapped", pairs)
    rates = {c.quantity: c for c in channels if c.corner is None}
    for a, b in ((rates.get(pitch), rates.get(roll)) for pitch, roll in ROTATIONS):
        if a and b:
            yield _swapped(f"{a.name} and {b.name} swapped", {a.name: b, b.name: a})
    if any(fact.quantity in SCALED for fact in estimation.box.facts):

        def of_scales(fact: Fact) -> Fact:
            share = _LB_KG if fact.quantity in SCALED else 1.0
            return replace(fact, value=share * fact.value, sigma=share * fact.sigma)

        def of_weights(state: MassState) -> MassState:
            weights = (replace(w, mass_kg=_LB_KG * w.mass_kg) for w in state.added.weights)
            return replace(state, added=replace(state.added, weights=tuple(weights)))

        yield Trial("scales in lb", "state the loads of the car in kg", fact=of_scales)
        yield Trial("added weights in lb", "state the weights in kg", state=of_weights)


def _swapped(name: str, other: Mapping[str, Channel]) -> Trial:
    def carries(c: Channel) -> Channel:
        """Return a channel's samples described as those of the other; their clock stays."""
        if c.name not in other:
            return c
        return replace(
            other[c.name],
            delay_s=c.delay_s,
            delay_sigma_s=c.delay_sigma_s,
            low_pass_hz=c.low_pass_hz,
            low_pass_order=c.low_pass_order,
        )

    return Trial(name, "exchange their signals in bench.toml, or their plugs", carries)


# Channels -----------------------------------------------------------------------------------------


def wrong_channel(estimation: Estimation) -> Cause | None:
    """Return the channel whose unit or sign is wrong, None if there is no such channel.

    A generic car is fitted without each channel in turn.  Without the wrong one the model explains
    all others, and the prediction shows by how much that one is off.
    """
    names = [c.name for group in estimation.box.groups for c in group.channels]
    if len(names) < _FEWEST:
        return None
    rough, best = ranked(estimation, map(_without, names))[0]
    others = refit(estimation, best, rough.fit.eta)
    if others.excess > estimation.chi2_limit - 1.0:
        return None
    before = refit(estimation)
    gain = _gain(estimation, before, others, best.name)
    if np.isnan(gain) or _LEAST < gain < _MOST:
        return None
    return replace(_of_gain(before, others, best.name, gain), certain=True)


def _without(name: str) -> Trial:
    return Trial(name, channel=lambda c: None if c.name == name else c)


def gain_of(estimation: Estimation, name: str, before: Refit | None = None) -> Cause:
    """Return the gain of one channel by the prediction of all others."""
    before = before or refit(estimation)
    others = refit(estimation, _without(name), before.fit.eta)
    return _of_gain(before, others, name, _gain(estimation, before, others, name))


def _gain(estimation: Estimation, before: Refit, others: Refit, name: str) -> float:
    """Return the motion that a channel shows, as a multiple of what all others predict."""
    eta = parameters_as_start(before.box, others.box, others.fit.eta)
    noise = {**estimation.noise, name: 1e3 * estimation.noise[name]}
    each = residuals(before.box, before.decays, noise, eta)
    predicted, measured = 0.0, 0.0
    for decay, one in zip(before.decays, each, strict=True):
        for r in decay.recordings:
            for channel, values in zip(r.group.channels, r.values.T, strict=True):
                if channel.name == name:
                    model = values - one.values[name]
                    model = model - model.mean()
                    predicted += float(model @ model)
                    measured += float(model @ values)
    return measured / predicted if predicted > 0.0 else float("nan")


def _of_gain(before: Refit, others: Refit, name: str, gain: float) -> Cause:
    advice = "check its calibration, unit and sign"
    if abs(gain + 1.0) < 0.2:
        advice = "it is upside down: turn its sign"
    elif gain > 0.0 and not _LEAST < gain < _MOST:
        advice = "its unit or gain is wrong: check the unit in the DBC (g, mg, m/s2, deg/s, rad/s)"
    sizes = f"it shows {gain:.3g} times what the other channels predict"
    return compared(before, others, Cause(f"gain of {name}", advice, sizes))


def wrong_sensors(estimation: Estimation, suspected: Sequence[str] = ()) -> list[Cause]:
    """Return what a faulty sensor would explain, the best last.

    `estimation`: a fit that does not hold.  `suspected`: channels whose gain is suspected, the most
    suspected first.
    """
    before = refit(estimation)
    gains = (gain_of(estimation, name, before) for name in suspected[:_SUSPECTED])
    causes = [gain for gain in gains if gain.explained > _CLEARS][:1]
    if causes and causes[0].explained >= _ALONE:
        return causes
    kinds: dict[str, set[str]] = {}
    """Names of the channels of each kind of sensors."""
    for channel in (c for group in before.box.groups for c in group.channels):
        kinds.setdefault(kind_of_sensor(channel), set()).add(channel.name)
    every = set().union(*kinds.values())
    body = kinds.get("body sensors", set())
    if body and len(kinds) > 1:
        causes.append(_late(estimation, before, kinds, every - body))
    scored = next(cause for cause in rank_causes(estimation) if cause.kind == "late")
    suspect = {
        c.name
        for group in before.box.groups
        for c in group.channels
        if scored.subject in (group.name, kind_of_sensor(c))
    }
    if every - suspect:
        parts = {scored.subject: suspect, f"all but {scored.subject}": every - suspect}
        causes.append(_late(estimation, before, parts, suspect))
    causes.append(_low_pass(estimation, before, {**kinds, "all sensors": every}))

    def remaining(cause: Cause) -> float:
        factor = _CHOICE if cause.name == "low-pass" else 1.0
        return max(1.0 - cause.explained, 0.0) * factor

    return sorted(causes, key=remaining, reverse=True)


def _late(
    estimation: Estimation,
    before: Refit,
    parts: Mapping[str, Collection[str]],
    loose: Collection[str],
) -> Cause:
    """Return the lateness of parts of the channels against the earliest part.

    `loose`: the channels whose delays are unknown in the fit.
    """

    def of_unknown_delay(c: Channel) -> Channel:
        return replace(c, delay_sigma_s=_LATE_SIGMA_S) if c.name in loose else c

    after = refit(estimation, Trial("late", channel=of_unknown_delay), before.fit.eta)
    delays_s: dict[str, list[float]] = {}
    for delay_s, group in zip(
        after.box.delays_s(after.fit.eta).tolist(), after.box.groups, strict=True
    ):
        part = next(name for name, names in parts.items() if group.channels[0].name in names)
        delays_s.setdefault(part, []).append(delay_s)
    late_ms = {part: 1e3 * float(np.mean(of)) for part, of in delays_s.items()}
    # The fit determines differences only, and no sensor shows a motion before it happens.
    early = min(late_ms.values())
    most = max(late_ms.values()) - early
    late_ms = {part: ms - early for part, ms in late_ms.items() if ms - early >= _ALIKE * most}
    each = [f"{part} {late:#.2g} ms" for part, late in late_ms.items()]
    sizes = ", ".join(each) if len(each) > 1 else f"{most:#.2g} ms"
    return compared(before, after, Cause(f"{' and '.join(late_ms)} late", LATE_ADVICE, sizes))


def _low_pass(
    estimation: Estimation, before: Refit, places: Mapping[str, Collection[str]]
) -> Cause:
    """Return the low-pass filter on the channels of one place that explains most of a misfit.

    `places`: names of the channels of each place.
    """

    def filtered(place: str, hz: float) -> Trial:
        def slow(c: Channel) -> Channel:
            return replace(c, low_pass_hz=hz) if c.name in places[place] else c

        return Trial(f"near {hz:.0f} Hz on {place}", channel=slow)

    coarse = {filtered(place, hz): (place, hz) for place in places for hz in _COARSE_HZ}
    tried = ranked(estimation, coarse, before.fit.eta)
    rough, near = tried[0]
    place, near_hz = coarse[near]
    fine = [filtered(place, hz) for hz in _FINE_HZ if 0.4 < hz / near_hz < 2.5]
    tried += ranked(estimation, fine, rough.fit.eta)
    rough, best = min(tried, key=lambda one: one[0].fit.cost)
    after = refit(estimation, best, rough.fit.eta)
    advice = "state low_pass_hz of these channels from the data sheet, or switch the filter off"
    return compared(before, after, Cause("low-pass", advice, best.name))


# Clocks, second bumps, drifts ---------------------------------------------------------------------


def clock_jump(estimation: Estimation) -> Cause | None:
    """Return the clocks that jump in most runs, None if there are none.

    A gap alone is harmless: the model knows when each sample was taken.  But where a clock jumped,
    the samples after it have wrong times, and no model explains both sides, or this group and the
    others.  Up to the jump the decays must fit.
    """
    gaps: list[dict[str, tuple[float, float]]] = []
    """Of each run: begin in the run and length, s, of the largest gap of each group with one."""
    for record in estimation.records:
        of_run = {}
        for r in (r for r in record.recordings if len(r.time_s) > 2):
            steps = np.diff(r.time_s)
            worst, period_s = int(np.argmax(steps)), float(np.median(steps))
            if steps[worst] > longest_gap_s(period_s):
                of_run[r.group.name] = float(r.time_s[worst]), float(steps[worst]) - period_s
        gaps.append(of_run)
    jumping = sum(map(bool, gaps))
    if 2 * jumping <= len(gaps):
        return None
    names = dict.fromkeys(name for of_run in gaps for name in of_run)
    everywhere = len(names) == len(estimation.box.groups)
    length_s = float(np.median([length for of_run in gaps for _, length in of_run.values()]))
    sizes = (
        f"{'all sensors' if everywhere else listed(names)} by about {length_s:.2g} s in "
        f"{jumping} of {counted(len(gaps), 'run')}; up to there the decays fit"
    )
    advice = "correct the times of the samples after the gap, or record again"
    begins_s = [{name: begin_s for name, (begin_s, _) in of_run.items()} for of_run in gaps]
    cause = Cause("clocks that jump", advice, sizes, certain=True)
    return _if_explained_by(estimation, _cut(estimation, begins_s), cause)


def second_bump(estimation: Estimation) -> Cause | None:
    """Return the second bump of most runs, None if there are none, by the rule of the bench.

    Free wheels only decay.  Up to the second bump the decays must fit.
    """
    from daq.verdict.motion import STRUCK_GUARD_S, STRUCK_S, STRUCK_SHARE, second_strike
    from daq.verdict.window import Trace  # both with the bench, which is slow to import

    begins_s: list[dict[str, float]] = []
    names: list[str] = []
    for record in estimation.records:
        onset, of_run = onset_s(record), {}
        guard_s = (record.bump_s if np.isfinite(record.bump_s) else _BUMP_S) + STRUCK_GUARD_S
        strikes = [(0.0, 0.0, "")]
        for r in record.recordings:
            for channel, column in zip(r.group.channels, r.values.T, strict=True):
                if onset is not None and channel.quantity is Quantity.HUB_ACCELERATION:
                    value, noise = column - column[r.time_s < onset].mean(), estimation.noise
                    trace = Trace(channel, r.time_s - onset, value, noise[channel.name], 0.0, 0.0)
                    strikes.append((*second_strike(trace, guard_s), channel.name))
        share, after_s, name = max(strikes)
        if share > STRUCK_SHARE and onset is not None:
            of_run = {r.group.name: onset + after_s - STRUCK_S for r in record.recordings}
            names.append(f"{name} in {record.label} at +{after_s:.2f} s")
        begins_s.append(of_run)
    if 2 * len(names) <= len(begins_s):
        return None
    sizes = f"in {len(names)} of {counted(len(begins_s), 'run')}: {listed(names)}"
    advice = "drive over one bump, and let the car come to rest"
    cause = Cause("a second bump", advice, sizes, certain=True)
    return _if_explained_by(estimation, _cut(estimation, begins_s), cause)


def _cut(estimation: Estimation, ends_s: Sequence[Mapping[str, float]]) -> list[FreeDecay]:
    """Return the decays up to a time, s in the run, of each group that has one."""
    cut = []
    for decay, of_run in zip(estimation.decays, ends_s, strict=True):
        kept = []
        for r in decay.recordings:
            length_s = of_run.get(r.group.name, np.inf) - decay.start_s
            if length_s >= _LEAST_S:
                kept.append(r.between(0.0, length_s) if np.isfinite(length_s) else r)
        cut.append(replace(decay, recordings=tuple(kept)))
    return cut


def _if_explained_by(
    estimation: Estimation, decays: Sequence[FreeDecay], cause: Cause
) -> Cause | None:
    """Return a cause if other decays, or parts of them, fit by themselves; None if not."""
    part = replace(estimation, decays=tuple(decay for decay in decays if decay.recordings))
    if not part.decays:
        return None
    generic = estimation.box.unknowns(generic_vehicles()[0])
    alone = refit(part, AS_STATED, generic, HOLD, _ALONE_STEPS, np.inf)
    excess = estimation.chi2_per_n - 1.0
    if alone.excess > max(estimation.chi2_limit - 1.0, (1.0 - _CLEARS) * excess):
        return None
    moved = compared(refit(estimation, length_s=np.inf), alone, cause)
    return replace(moved, explained=1.0 - max(alone.excess, 0.0) / excess)


def drift(estimation: Estimation) -> Cause | None:
    """Return the channels whose level drifts at rest if that explains a misfit; None if not."""
    records, drifts = estimation.records, dict[str, float]()
    for _ in range(2):  # in the first round, a drift is taken for the onset of motion
        for name, slope in _slopes_at_rest(records).items():
            drifts[name] = drifts.get(name, 0.0) + slope
        records = tuple(_without_drifts(record, drifts) for record in estimation.records)
    if not drifts:
        return None
    units = {c.name: c.unit for group in estimation.box.groups for c in group.channels}
    sizes = listed(f"{name} {slope:+.2g} {units[name]} a second" for name, slope in drifts.items())
    advice = "let the sensors warm up, or take the drift out of these channels"
    decays = [record.decay(decay_start_s(record)) for record in records]
    return _if_explained_by(estimation, decays, Cause("drift", advice, sizes, certain=True))


def _slopes_at_rest(records: Sequence[Record]) -> dict[str, float]:
    """Return the slope before the bumps of each channel that drifts there, SI a second."""
    slopes: dict[str, list[tuple[float, float]]] = {}
    """Of each channel: slope and its variance by the noise, in each run."""
    for record in records:
        onset = onset_s(record)
        if onset is None:
            continue
        for r in record.recordings:
            quiet = r.time_s < onset - _MARGIN_S
            if np.count_nonzero(quiet) < _FEWEST_AT_REST:
                continue
            t = r.time_s[quiet] - r.time_s[quiet].mean()
            for channel, column in zip(r.group.channels, r.values[quiet].T, strict=True):
                slope = float(t @ column) / float(t @ t)
                scatter = column - column.mean() - slope * t
                variance = float(scatter @ scatter) / (len(t) - 2) / float(t @ t)
                slopes.setdefault(channel.name, []).append((slope, variance))
    drifts = {}
    for name, of_runs in slopes.items():
        slope, variance = np.array(of_runs).T
        sigma = np.sqrt(max(float(np.var(slope)), float(np.mean(variance))) / len(slope))
        if abs(slope.mean()) > _DRIFT_SIGMAS * sigma:
            drifts[name] = float(slope.mean())
    return drifts


def _without_drifts(record: Record, drifts: Mapping[str, float]) -> Record:
    recordings = []
    for r in record.recordings:
        slopes = np.array([drifts.get(channel.name, 0.0) for channel in r.group.channels])
        recordings.append(replace(r, values=r.values - np.multiply.outer(r.time_s, slopes)))
    return replace(record, recordings=tuple(recordings))
