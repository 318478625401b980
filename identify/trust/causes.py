"""Finds the fault of the bench that explains a misfit, and judges the fit with it.

One loop asks the searches of a table in turn, the surest first.  A search fits the decays again
under another description, or parts of them, and that must explain nearly all of the misfit.  All
gates together give the verdict, and what survives of the parameters.

Every cause whose size was estimated implies a change of each parameter.  A parameter survives if
none of the causes that may still be true moves it by more than its standard deviation: with noise
and cause together it then still lies within three of them.  (With half of the 95 % interval as the
limit, survivors of the stress list had errors of four standard deviations.)
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np

from daq.channels import Channel, Quantity
from daq.check.signs import opposed_signs
from daq.runs import longest_gap_s
from daq.sessions import Session
from dbc.words import Finding, Severity, counted

from ..decays.decay import FreeDecay, Record, decay_start_s, onset_s
from ..fit.estimation import Estimation, generic_vehicles
from ..fit.grey_box import SIGNED
from ..fit.likelihood import HOLD, residuals
from ..fit.uncertainty import determined
from .finding import MOST, Cause, Judgement, Loss, Survival, listed
from .gates import (
    chi2_by_run,
    misfit_findings,
    mode_snr_db,
    parameter_findings,
    undetermined,
    whiteness_findings,
)
from .hypotheses import (
    LATE_ADVICE,
    amplitude_findings,
    kind_of_sensor,
    odd_runs,
    rank_causes,
    some_runs_are_wrong,
)
from .inputs import (
    contradicted_shift,
    contradictions,
    sample_findings,
    scale_facts,
    shift_without_scales,
    unseen_findings,
)
from .trials import (
    AS_STATED,
    Refit,
    Trial,
    compared,
    parameters_as_start,
    ranked,
    refit,
    swapped_labels,
    wrong_weight,
)

_FEWEST = 3
"""Least number of channels of which one can be wrong."""
_SUSPECTED = 3
"""Number of channels whose gain is suspected that are left out in turn."""
_CLEARS = 0.9
"""Share of the misfit that must disappear without a channel to call it wrong, and above which no
other cause is sought."""
_LEAST, _MOST = 0.7, 1.4
"""Gains beyond which a unit is wrong rather than a calibration."""
_CHOICE = 1.5
"""Factor on what a low-pass leaves: it looks like lateness, and has more to choose from."""
_LATE_SIGMA_S = 0.03
_COARSE_HZ = (15.0, 40.0)
_FINE_HZ = (8.0, 10.0, 20.0, 28.0, 56.0, 80.0)
_LEAST_S = 0.1
"""Least length of the samples of a group that are fitted alone, s."""
_BUMP_S = 0.2
"""Length of a bump that is not stated, s."""
_MARGIN_S, _FEWEST_AT_REST = 0.005, 20
"""Time before the onset that does not count as rest, s, and least number of samples at rest."""
_ALONE_STEPS = 30
_DRIFT_SIGMAS = 6.0
"""Size of a drift, in standard deviations by the scatter of the runs, from which it is none by
chance."""

_UNEXPLAINED_TEXT = (
    "the misfit is not explained: half of it or more is due to none of wrong signs, units and "
    "gains, swapped channels and mass states, lateness, low-passes, drifts, clocks that jump, "
    "second bumps, wrong weights, odd runs, a turned IMU, unequal sides, friction and dampers: "
    "look at the runs with the largest chi2/n"
)
_LARGEST_LOG = 3.0
"""Change of a logarithm beyond which its size has no meaning: a factor of twenty."""


@dataclass(frozen=True, slots=True)
class Causes:
    """The named causes of a misfit, and all that were tried."""

    findings: tuple[Finding, ...] = ()
    """Findings on what is named."""
    tried: tuple[Cause, ...] = ()
    """Every cause that stands out of the noise."""


def faults_of_bench(session: Session, estimation: Estimation) -> Causes:
    """Return the fault of the bench that explains a misfit, the surest first."""
    signs = () if estimation.holds else opposed_signs(session.accepted, session.channels)
    if signs:
        texts = [f"likely cause: wrong signs, {f.text}: {f.advice}" for f in signs]
        return Causes(tuple(replace(f, text=t) for f, t in zip(signs, texts, strict=True)))
    return first_cause(estimation, (clock_jump, second_bump, drift, wrong_weight, wrong_channel))


def swapped_or_late(estimation: Estimation) -> Causes:
    """Return swapped labels, a lateness or a low-pass that explains nearly all of a misfit, if any.

    A bump that lasts longer than stated looks like a low-pass: ask only where no later start holds.
    Hubs of front and rear take up to 84 % of what the elements of a real car do, if exchanged.
    """

    def best_sensor(estimation: Estimation) -> Cause | None:
        return wrong_sensors(estimation)[-1]

    if some_runs_are_wrong(estimation):
        return Causes()
    return first_cause(estimation, (swapped_labels, best_sensor), _CLEARS)


def first_cause(
    estimation: Estimation,
    searches: Sequence[Callable[[Estimation], Cause | None]],
    least: float = MOST,
) -> Causes:
    """Return the first cause of a table of searches that explains enough of a misfit.

    Where one run is odd, no weight that is wrong in all runs is sought.

    `least`: share of the misfit that it must explain.
    """
    for search in () if estimation.holds else searches:
        if search is wrong_weight and some_runs_are_wrong(estimation):
            break
        cause = search(estimation)
        if cause and cause.explained > least:
            return Causes((cause.finding,), (cause,))
    return Causes()


def likely_causes(estimation: Estimation) -> Causes:
    """Return what may cause a misfit, or an effect that matters although there is none.

    An outlying run comes first, because it imitates other causes; a dependence on amplitude last.
    """
    holds, scored = estimation.holds, rank_causes(estimation)
    if odd := odd_runs(estimation, scored[0].strength):
        finding, cause = odd
        return Causes((finding,), (cause,))
    worst = next(iter(contradictions(estimation)), None) if holds else None
    if worst and worst.name.startswith(("x of ", "y of ")):  # a gain, or a bar, explains some of it
        scored = tuple(s for s in scored if s.gain > worst.sigmas**2)
    best = [replace(c, explained=0.0) if holds else c for c in scored if c.strength > 1.0]
    tried = list(best)
    for cause in (c for c in best if c.kind == "weights"):  # or these are right, and the scales off
        moved = shift_without_scales(estimation)
        tried.append(replace(cause, name="scales off by a common factor", moved=moved))
    amplitude = tuple(amplitude_findings(estimation))
    if not best or (holds and amplitude):  # no linear cause makes the small motion differ
        return Causes(amplitude, tuple(tried))
    named = best[0]
    if named.kind == "gain":
        gain = gain_of(estimation, named.subject)
        named = replace(named, sizes=gain.sizes, advice=gain.advice)
    elif named.kind == "weights":  # either may be wrong: that which moves more is held against it
        facts = " and ".join(scale_facts(estimation.box))
        advice = f"weigh them again, or {facts}: one of the two scales shows too much"
        heavier = max(named, tried[-1], key=lambda one: one.shift)
        named = replace(named, advice=advice, moved=heavier.moved)
    if holds and (swap := swapped_labels(estimation)):  # else: `swapped_or_late`
        named = swap
        tried.append(swap)
    elif not holds and named.explained < _CLEARS:
        sensors = wrong_sensors(estimation)
        tried += sensors
        named = sensors[-1] if sensors[-1].explained > _CLEARS else named
    is_named = holds or named.explained > MOST
    return Causes((named.finding,) if is_named else amplitude, tuple(tried))


# Verdict ------------------------------------------------------------------------------------------


def judge(
    session: Session,
    estimation: Estimation,
    unused: Sequence[Finding] = (),
    causes: Causes | None = None,
) -> Judgement:
    """Judge an estimation by all gates.

    For a nonlinear fit, no cause is sought that only a linear model lacks: its elements are in the
    fit.

    `unused`: what was left out (`unused_findings`).  `causes`: the fault of the bench that was
    found before, if any.
    """
    linear, holds = estimation.nonlinear is None, estimation.holds
    sure = not undetermined(estimation)
    snr_db = mode_snr_db(estimation)
    causes = causes or Causes()
    if linear and not causes.findings and (sure or not holds):
        causes = likely_causes(estimation)
    # Where all weights are wrong, each load disagrees with the runs.
    explained = "added_weights_off_by_a_common_factor" in {f.code for f in causes.findings}
    misfit = tuple(f for f in misfit_findings(estimation) if sure or f.code != "convergence")
    # What causes a misfit is as grave as the misfit, and comes first.
    grave = max((f.severity for f in misfit if f.code == "chi2"), default=Severity.NOTE)
    named = [
        f if holds or f.code == "amplitude" else replace(f, severity=max(f.severity, grave))
        for f in causes.findings
    ]
    if linear and not (holds or named):
        named.append(Finding("unexplained", Severity.WARNING, _UNEXPLAINED_TEXT))
    of_parameters = parameter_findings(estimation)
    findings = [
        *unused,
        *([] if holds else named),  # what to do before what is wrong
        *misfit,
        *(f for f in of_parameters if not (explained and f.code == "contradiction")),
        *(unseen_findings(estimation.box, session.mass_states) if sure else ()),
        *sample_findings(session, estimation.records),
        *(named if holds else []),
        *(whiteness_findings(estimation) if sure and holds else ()),
    ]
    rivals = list(causes.tried)
    contradicted = contradictions(estimation) if sure and not explained else ()
    if contradicted:  # one cause
        name = "; ".join(one.name for one in contradicted)
        moved = contradicted_shift(estimation, contradicted)
        rivals.append(Cause(name, moved=moved))
    return Judgement(
        tuple(findings),
        estimation.chi2_per_n,
        chi2_by_run(estimation),
        snr_db,
        survival(estimation, rivals),
    )


def survival(estimation: Estimation, causes: Sequence[Cause]) -> Survival:
    """Divide the parameters into those that survive and those that are lost.

    The intervals of a nonlinear fit that converged include the little that it leaves unexplained.
    In a linear fit with a misfit none survives.

    `causes`: all that were refitted or sized, and that stand out of the noise.
    """
    box, fit = estimation.box, estimation.fit
    names, linear = box.parameters, estimation.nonlinear is None
    if not fit.converged and (linear or not estimation.holds):
        return Survival((), dict.fromkeys(box.names, Loss("the fit did not converge")))
    known = zip(names, determined(box, fit.covariance), strict=True)
    lost = {name: Loss("not determined") for name, is_known in known if not is_known}
    if linear and not estimation.holds:
        best = max(causes, key=lambda cause: cause.explained, default=Cause(""))
        unexplained = Loss("no cause that was tried explains the misfit")
        is_named = best.explained > MOST
        every = {name: _loss_to(best, name) if is_named else unexplained for name in box.names}
        return Survival((), every | lost)
    std = np.sqrt(np.diag(fit.covariance)[: len(names)])
    for name, within in zip(names, std.tolist(), strict=True):
        # Two causes may be one shift in two words: rounding must not choose which of them is named.
        worst = max(causes, key=lambda h: float(f"{abs(h.moved[name]):.6g}"), default=None)
        if name not in lost and worst is not None and abs(worst.moved[name]) > within:
            lost[name] = _loss_to(worst, name)
    return Survival(tuple(name for name in box.names if name not in lost), lost)


def _loss_to(cause: Cause, name: str) -> Loss:
    if name in SIGNED or name not in cause.moved:
        return Loss(cause.name)
    moved = np.clip(cause.moved[name], -_LARGEST_LOG, _LARGEST_LOG)
    return Loss(cause.name, float(np.expm1(moved)))


# Channels -----------------------------------------------------------------------------------------


def wrong_channel(estimation: Estimation) -> Cause | None:
    """Return the channel whose unit or sign is wrong, None if there is no such channel.

    A generic car is fitted without each channel in turn.  Without the wrong one the model explains
    all others, and the prediction shows by how much that one is off.
    """
    names = [c.name for group in estimation.box.groups for c in group.channels]
    if len(names) < _FEWEST:
        return None
    rough, without = ranked(estimation, map(_without, names))[0]
    others = refit(estimation, without, rough.fit.eta)
    if others.excess > estimation.chi2_limit - 1.0:
        return None
    before = refit(estimation)
    gain = _gain(estimation, before, others, without.name)
    if np.isnan(gain) or _LEAST < gain < _MOST:
        return None
    return replace(_of_gain(before, others, without.name, gain), certain=True)


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
    predicted, measured = 0.0, 0.0
    each = residuals(before.box, before.decays, noise, eta)
    for decay, one in zip(before.decays, each, strict=True):
        for r in decay.recordings:
            for channel, values in zip(r.group.channels, r.values.T, strict=True):
                if channel.name == name:
                    model = values - one.values[name]
                    model = model - model.mean()
                    predicted += float(model @ model)
                    measured += float(model @ values)
    return measured / predicted if predicted > 0.0 else nan


def _of_gain(before: Refit, others: Refit, name: str, gain: float) -> Cause:
    advice = "check its calibration, unit and sign"
    if abs(gain + 1.0) < 0.2:
        advice = "it is upside down: turn its sign"
    elif gain > 0.0 and not _LEAST < gain < _MOST:
        advice = "its unit or gain is wrong: check the unit in the DBC (g, mg, m/s2, deg/s, rad/s)"
    sizes = f"it shows {gain:.3g} times what the other channels predict"
    return compared(before, others, Cause(f"gain of {name}", advice, sizes))


def wrong_sensors(estimation: Estimation) -> list[Cause]:
    """Return what a faulty sensor would explain, the best last.

    `estimation`: a fit that does not hold.
    """
    scored, before = rank_causes(estimation), refit(estimation)
    causes: list[Cause] = []
    channels = [c for group in before.box.groups for c in group.channels]
    places = {kind: [c.name for c in channels if kind_of_sensor(c) == kind]
              for kind in dict.fromkeys(map(kind_of_sensor, channels))}  # fmt: skip
    latest = next(cause.subject for cause in scored if cause.kind == "late")
    suspects = places.get(latest) or [
        c.name for group in before.box.groups if group.name == latest for c in group.channels
    ]
    if len(suspects) < len(channels):
        causes.append(_late(estimation, before, latest, suspects))
    every = [c.name for c in channels]
    causes.append(_low_pass(estimation, before, {**places, "all sensors": every}))
    if all(cause.explained <= _CLEARS for cause in causes):  # a late one is no worse left out
        gains = [c.subject for c in scored if c.kind == "gain" and c.strength > 1.0]
        causes += [gain_of(estimation, name, before) for name in gains[:_SUSPECTED]]

    def remaining(cause: Cause) -> float:
        factor = _CHOICE if cause.name == "low-pass" else 1.0
        return max(1.0 - cause.explained, 0.0) * factor

    return sorted(causes, key=remaining, reverse=True)


def _late(estimation: Estimation, before: Refit, place: str, suspects: Collection[str]) -> Cause:
    """Return the lateness of the channels of one place against all others, or of these."""

    def of_unknown_delay(c: Channel) -> Channel:
        return replace(c, delay_sigma_s=_LATE_SIGMA_S) if c.name in suspects else c

    after = refit(estimation, Trial("late", channel=of_unknown_delay), before.fit.eta)
    delays_s = after.box.delays_s(after.fit.eta).tolist()
    late_s = [
        delay_s
        for delay_s, group in zip(delays_s, after.box.groups, strict=True)
        if group.channels[0].name in suspects
    ]
    late_ms = 1e3 * float(np.mean(late_s))
    # The fit determines differences only, and no sensor shows a motion before it happens.
    name = f"{place} late" if late_ms > 0.0 else f"all but {place} late"
    return compared(before, after, Cause(name, LATE_ADVICE, f"{abs(late_ms):#.2g} ms"))


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
    ends_s, lengths_s, names = [], [], []
    for record in estimation.records:
        end_s = np.inf
        for r in record.recordings:
            steps = np.diff(r.time_s)
            period_s = float(np.median(steps)) if len(steps) > 1 else np.inf
            if steps.max(initial=0.0) > longest_gap_s(period_s):
                worst = int(np.argmax(steps))
                end_s = min(end_s, float(r.time_s[worst]))
                lengths_s.append(float(steps[worst]) - period_s)
                names.append(r.group.name)
        ends_s.append(end_s)
    everywhere = len(set(names)) == len(estimation.box.groups)
    jumping = np.count_nonzero(np.isfinite(ends_s))
    median_s = float(np.median(lengths_s)) if lengths_s else 0.0
    sizes = (
        f"{'all sensors' if everywhere else listed(names)} by about {median_s:.2g} s in {jumping} "
        f"of {counted(len(ends_s), 'run')}; up to there the decays fit"
    )
    advice = "correct the times of the samples after the gap, or record again"
    cause = Cause("clocks that jump", advice, sizes, certain=True)
    return _if_most_fit_before(estimation, ends_s, cause)


def second_bump(estimation: Estimation) -> Cause | None:
    """Return the second bump of most runs, None if there are none, by the rule of the bench.

    Free wheels only decay.  Up to the second bump the decays must fit.
    """
    from daq.verdict.checks import STRUCK_GUARD_S, STRUCK_S, STRUCK_SHARE, second_strike
    from daq.verdict.window import Trace  # both with the bench, which is slow to import

    ends_s, places, noise = [], [], estimation.noise
    for record in estimation.records:
        onset, end_s = onset_s(record), np.inf
        if onset is None:
            ends_s.append(end_s)
            continue
        guard_s = (record.bump_s if np.isfinite(record.bump_s) else _BUMP_S) + STRUCK_GUARD_S
        strikes = [(0.0, 0.0, "")]
        for r in record.recordings:
            for channel, column in zip(r.group.channels, r.values.T, strict=True):
                if channel.quantity is Quantity.HUB_ACCELERATION:
                    value = column - column[r.time_s < onset].mean()
                    trace = Trace(channel, r.time_s - onset, value, noise[channel.name], 0.0)
                    strikes.append((*second_strike(trace, guard_s), channel.name))
        share, after_s, name = max(strikes)
        if share > STRUCK_SHARE:
            end_s = onset + after_s - STRUCK_S
            places.append(f"{name} in {record.label} at +{after_s:.2f} s")
        ends_s.append(end_s)
    sizes = f"in {len(places)} of {counted(len(ends_s), 'run')}: {listed(places)}"
    advice = "drive over one bump, and let the car come to rest"
    cause = Cause("a second bump", advice, sizes, certain=True)
    return _if_most_fit_before(estimation, ends_s, cause)


def _if_most_fit_before(
    estimation: Estimation, ends_s: Sequence[float], cause: Cause
) -> Cause | None:
    """Return a cause that ends the decays of most runs, s in the run, if they fit until then."""
    if 2 * np.count_nonzero(np.isfinite(ends_s)) <= len(ends_s):
        return None
    decays = []
    for decay, end_s in zip(estimation.decays, ends_s, strict=True):
        length_s = end_s - decay.start_s
        if length_s >= _LEAST_S:
            cut = tuple(r.between(0.0, length_s) for r in decay.recordings)
            decays.append(replace(decay, recordings=cut))
    return _if_explained_by(estimation, decays, cause)


def _if_explained_by(
    estimation: Estimation, decays: Sequence[FreeDecay], cause: Cause
) -> Cause | None:
    """Return a cause if other decays, or parts of them, fit by themselves; None if not."""
    if not decays:
        return None
    generic = estimation.box.unknowns(generic_vehicles()[0])
    part = replace(estimation, decays=tuple(decays))
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
    slopes: dict[str, list[float]] = {}
    for record in records:
        onset = onset_s(record)
        if onset is None:
            continue
        for r in record.recordings:
            quiet = r.time_s < onset - _MARGIN_S
            if np.count_nonzero(quiet) >= _FEWEST_AT_REST:
                of_run = np.polyfit(r.time_s[quiet], r.values[quiet], 1)[0].tolist()
                for channel, slope in zip(r.group.channels, of_run, strict=True):
                    slopes.setdefault(channel.name, []).append(slope)
    return {
        name: float(np.mean(of_runs))
        for name, of_runs in slopes.items()
        if len(of_runs) > 2
        and abs(np.mean(of_runs)) > _DRIFT_SIGMAS * np.std(of_runs, ddof=1) / len(of_runs) ** 0.5
    }


def _without_drifts(record: Record, drifts: Mapping[str, float]) -> Record:
    recordings = []
    for r in record.recordings:
        slopes = np.array([drifts.get(channel.name, 0.0) for channel in r.group.channels])
        recordings.append(replace(r, values=r.values - np.multiply.outer(r.time_s, slopes)))
    return replace(record, recordings=tuple(recordings))
