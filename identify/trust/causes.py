"""Finds the fault of the bench that explains a misfit, and judges the fit with it.

One loop asks searches in turn, the surest first.  A search fits the decays again under another
description, or parts of them, and that must explain nearly all of the misfit.  All gates together
give the verdict, and what survives of the parameters.

Every cause whose size was estimated implies a change of each parameter.  A parameter survives if
none of the causes that may still be true moves it by more than its standard deviation: with noise
and cause together it then still lies within three of them.
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

from ..decays.decay import FreeDecay, Record, by_channel, decay_start_s, onset_s
from ..fit.estimation import Estimation, generic_vehicles
from ..fit.grey_box import SIGNED
from ..fit.likelihood import HOLD, LinearEngine
from ..fit.uncertainty import determined
from .finding import NAMED_SHARE, Cause, Judgement, Loss, Survival, listed
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
    TABLE,
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

_NEARLY_ALL = 0.9
"""Part of a misfit above which what explains it is its cause, and no other is sought."""
_LEAST_GAIN, _MOST_GAIN = 0.7, 1.4
"""Gains beyond which a unit is wrong rather than a calibration."""
_UNEXPLAINED_TEXT = (
    "the misfit is not explained: half of it or more is due to none of wrong signs, units and "
    "gains, swapped channels and mass states, lateness, low-passes, drifts, clocks that jump, "
    "second bumps, wrong weights, odd runs, a turned IMU, unequal sides, friction and dampers: "
    "look at the runs with the largest chi2/n"
)


@dataclass(frozen=True, slots=True)
class Causes:
    """The named causes of a misfit, and all that were tried."""

    findings: tuple[Finding, ...] = ()
    """Findings on what is named."""
    tried: tuple[Cause, ...] = ()
    """Every cause that stands out of the noise."""


def faults_of_bench(session: Session, estimation: Estimation) -> Causes:
    """Return the surest fault of the bench that explains a misfit; nothing for a fit that holds.

    The samples alone show wrong signs, without another fit; all else is sought after them.
    """
    signs = () if estimation.holds else opposed_signs(session.accepted, session.channels)
    if signs:
        prefix = "likely cause: wrong signs"
        return Causes(tuple(replace(f, text=f"{prefix}, {f.text}: {f.advice}") for f in signs))
    return first_cause(estimation, (clock_jump, second_bump, drift, wrong_weight, wrong_channel))


def swapped_or_late(estimation: Estimation) -> Causes:
    """Return swapped labels or wrong sensors that explain nearly all of a misfit, if any.

    None is sought where some runs are wrong.  A bump that lasts longer than stated looks like a
    low-pass: ask only where no later start holds.  Nearly all, because exchanged hubs of front and
    rear explain up to 84 % of what the elements of a real car do.
    """
    if some_runs_are_wrong(estimation):
        return Causes()
    searches = (swapped_labels, lambda estimation: wrong_sensors(estimation)[-1])
    return first_cause(estimation, searches, _NEARLY_ALL)


def first_cause(
    estimation: Estimation,
    searches: Sequence[Callable[[Estimation], Cause | None]],
    least_share: float = NAMED_SHARE,
) -> Causes:
    """Return the first cause that explains more than `least_share` of a misfit.

    Nothing for a fit that holds.  `searches`: asked in turn; where some runs are wrong, they end
    before `wrong_weight`, which is sought in all runs.
    """
    for search in () if estimation.holds else searches:
        if search is wrong_weight and some_runs_are_wrong(estimation):
            break
        cause = search(estimation)
        if cause and cause.explained > least_share:
            return Causes((cause.finding,), (cause,))
    return Causes()


def likely_causes(estimation: Estimation) -> Causes:
    """Return what may cause a misfit, or an effect that matters although there is none.

    An outlying run comes first, because it imitates other causes; a dependence on amplitude last,
    in a fit that holds second.  Else the surest hypothesis is named; in a fit with a misfit it must
    explain most of it, or a sensor that is fitted again takes its place.
    """
    holds, hypotheses = estimation.holds, rank_causes(estimation)
    if odd := odd_runs(estimation, hypotheses[0].strength):
        finding, cause = odd
        return Causes((finding,), (cause,))
    worst = next(iter(contradictions(estimation)), None) if holds else None
    # A wrong place is explained in part by a gain or a bar: these must explain more.
    if worst and worst.name.startswith(("x of ", "y of ")):
        hypotheses = tuple(c for c in hypotheses if c.gain > worst.sigmas**2)
    significant = [
        replace(c, explained=0.0) if holds else c for c in hypotheses if c.strength > 1.0
    ]
    tried = list(significant)
    for cause in significant:
        if cause.kind == "weights":  # or the scales are off instead
            moved = shift_without_scales(estimation)
            tried.append(replace(cause, name="scales off by a common factor", moved=moved))
    amplitude = tuple(amplitude_findings(estimation))
    if not significant or (holds and amplitude):  # no linear cause makes the small motion differ
        return Causes(amplitude, tuple(tried))
    named = significant[0]
    if named.kind == "gain" and not holds:  # it may be too large for the linear test
        gain = gain_of(estimation, named.subject)
        named = replace(named, sizes=gain.sizes, advice=gain.advice)
    elif named.kind == "weights":  # weights or scales: severity is that of what moves more
        facts = " and ".join(scale_facts(estimation.box))
        advice = f"weigh them again, or {facts}: one of the two scales shows too much"
        worse = max(named, tried[-1], key=lambda cause: cause.shift)
        named = replace(named, advice=advice, moved=worse.moved)
    if holds and (swapped := swapped_labels(estimation)):  # if not, `swapped_or_late` did
        named = swapped
        tried.append(swapped)
    elif not holds and named.explained < _NEARLY_ALL:
        sensors = wrong_sensors(estimation)
        tried += sensors
        named = sensors[-1] if sensors[-1].explained > _NEARLY_ALL else named
    is_named = holds or named.explained > NAMED_SHARE
    return Causes((named.finding,) if is_named else amplitude, tuple(tried))


# Verdict ------------------------------------------------------------------------------------------


def judge(
    session: Session,
    estimation: Estimation,
    unused: Sequence[Finding] = (),
    causes: Causes | None = None,
) -> Judgement:
    """Judge an estimation by all gates.

    For a nonlinear fit, no cause is sought: what a linear model lacks is in the fit.

    `unused`: what was left out (`unused_findings`).  `causes`: a fault of the bench that is known
    already; without one, causes are sought.
    """
    linear, holds = estimation.nonlinear is None, estimation.holds
    all_determined = not undetermined(estimation)
    causes = causes or Causes()
    if linear and not causes.findings and (all_determined or not holds):
        causes = likely_causes(estimation)
    # Where all weights are wrong, each load disagrees with the runs.
    weights_explain = "added_weights_off_by_a_common_factor" in {f.code for f in causes.findings}
    misfit = [f for f in misfit_findings(estimation) if all_determined or f.code != "convergence"]
    # What causes a misfit is as grave as the misfit, and comes first.
    of_misfit = max((f.severity for f in misfit if f.code == "chi2"), default=Severity.NOTE)
    named = [
        f if holds or f.code == "amplitude" else replace(f, severity=max(f.severity, of_misfit))
        for f in causes.findings
    ]
    if linear and not (holds or named):
        named.append(Finding("unexplained", Severity.WARNING, _UNEXPLAINED_TEXT))
    of_parameters = parameter_findings(estimation)
    findings = [
        *unused,
        *([] if holds else named),  # what to do before what is wrong
        *misfit,
        *(f for f in of_parameters if not (weights_explain and f.code == "contradiction")),
        *(unseen_findings(estimation.box, session.mass_states) if all_determined else ()),
        *sample_findings(session, estimation.records),
        *(named if holds else []),
        *(whiteness_findings(estimation) if all_determined and holds else ()),
    ]
    sized = list(causes.tried)
    contradicted = contradictions(estimation) if all_determined and not weights_explain else ()
    if contradicted:  # all together are one cause
        moved = contradicted_shift(estimation, contradicted)
        sized.append(Cause("; ".join(c.name for c in contradicted), moved=moved))
    return Judgement(
        findings=tuple(findings),
        chi2_per_n=estimation.chi2_per_n,
        chi2_by_run=chi2_by_run(estimation),
        snr_db=mode_snr_db(estimation),
        survival=survival(estimation, sized),
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
    determined_or_not = zip(names, determined(box, fit.covariance), strict=True)
    lost = {name: Loss("not determined") for name, is_known in determined_or_not if not is_known}
    if linear and not estimation.holds:
        likeliest = max(causes, key=lambda cause: cause.explained, default=Cause(""))
        unexplained = Loss("no cause that was tried explains the misfit")
        is_named = likeliest.explained > NAMED_SHARE
        all_lost = {n: _loss_to(likeliest, n) if is_named else unexplained for n in box.names}
        return Survival((), all_lost | lost)
    stds = np.sqrt(np.diag(fit.covariance)[: len(names)])
    for name, std in zip(names, stds.tolist(), strict=True):
        # Six digits, so that rounding does not choose between two names of one shift.
        largest = max(
            causes, key=lambda cause: float(f"{abs(cause.moved[name]):.6g}"), default=None
        )
        if name not in lost and largest is not None and abs(largest.moved[name]) > std:
            lost[name] = _loss_to(largest, name)
    return Survival(tuple(name for name in box.names if name not in lost), lost)


def _loss_to(cause: Cause, name: str) -> Loss:
    """Return the loss of a parameter; changes of its logarithm beyond 3 have no meaning."""
    if name in SIGNED or name not in cause.moved:
        return Loss(cause.name)
    return Loss(cause.name, float(np.expm1(np.clip(cause.moved[name], -3.0, 3.0))))


# Channels -----------------------------------------------------------------------------------------


def wrong_channel(estimation: Estimation) -> Cause | None:
    """Return the channel whose unit or sign is wrong, None if there is no such channel.

    A generic car is fitted without each channel in turn.  Without the wrong one the model explains
    all others, and the prediction shows by how much that one is off.  Of fewer than three channels
    none can be called wrong.
    """
    names = dict.fromkeys(c.name for group in estimation.box.groups for c in group.channels)
    if len(names) < 3:
        return None
    rough_fit, trial = ranked(estimation, map(_without, names))[0]
    fit_without = refit(estimation, trial, rough_fit.fit.eta)
    if fit_without.excess > estimation.chi2_limit - 1.0:
        return None
    gain, cause = _sized_gain(estimation, refit(estimation), fit_without, trial.name)
    if np.isnan(gain) or _LEAST_GAIN < gain < _MOST_GAIN:
        return None
    return replace(cause, certain=True)


def _without(name: str) -> Trial:
    """Return the trial that leaves a channel out."""
    return Trial(name, channel=lambda c: None if c.name == name else c)


def gain_of(estimation: Estimation, name: str, stated_fit: Refit | None = None) -> Cause:
    """Return the gain of one channel by the prediction of all others, as a cause."""
    stated_fit = stated_fit or refit(estimation)
    fit_without = refit(estimation, _without(name), stated_fit.fit.eta)
    return _sized_gain(estimation, stated_fit, fit_without, name)[1]


def _sized_gain(
    estimation: Estimation, stated_fit: Refit, fit_without: Refit, name: str
) -> tuple[float, Cause]:
    """Return the gain of a channel by the fits with and without it, and the cause that it is.

    The gain is the motion that the channel shows over what all others predict; NaN if that is none.
    """
    eta = parameters_as_start(stated_fit.box, fit_without.box, fit_without.fit.eta)
    # The channel must have residuals, but no influence on the initial states: a thousandfold noise.
    noise = {**estimation.noise, name: 1e3 * estimation.noise[name]}
    predicted_squared, measured_by_predicted = 0.0, 0.0
    residuals_by_run = LinearEngine(stated_fit.box).residuals(stated_fit.decays, noise, eta)
    for decay, of_run in zip(stated_fit.decays, residuals_by_run, strict=True):
        for values in by_channel(decay.recordings).get(name, ()):
            predicted = values - of_run.values[name]
            predicted = predicted - predicted.mean()
            predicted_squared += float(predicted @ predicted)
            measured_by_predicted += float(predicted @ values)
    gain = measured_by_predicted / predicted_squared if predicted_squared > 0.0 else nan
    advice = TABLE["gain"].advice
    if abs(gain + 1.0) < 0.2:
        advice = "it is upside down: turn its sign"
    elif gain > 0.0 and not _LEAST_GAIN < gain < _MOST_GAIN:
        advice = "its unit or gain is wrong: check the unit in the DBC (g, mg, m/s2, deg/s, rad/s)"
    sizes = f"it shows {gain:.3g} times what the other channels predict"
    return gain, compared(stated_fit, fit_without, Cause(f"gain of {name}", advice, sizes))


def wrong_sensors(estimation: Estimation) -> list[Cause]:
    """Return what faulty sensors would explain, as causes, the best last.

    They are the lateness of the sensors that are most likely late, a low-pass, and, unless one of
    these explains nearly all, the three surest gains.  `estimation`: a fit that does not hold.
    """
    hypotheses, stated_fit = rank_causes(estimation), refit(estimation)
    causes: list[Cause] = []
    groups = stated_fit.box.groups
    channels = [c for group in groups for c in group.channels]
    names_by_kind: dict[str, list[str]] = {}
    for c in channels:
        names_by_kind.setdefault(kind_of_sensor(c), []).append(c.name)
    # The subject of a lateness is a kind of sensors, or a group of channels with one clock.
    latest = next(cause.subject for cause in hypotheses if cause.kind == "late")
    of_group = [c.name for group in groups if group.name == latest for c in group.channels]
    suspects = names_by_kind.get(latest, of_group)
    if len(suspects) < len(channels):  # only differences of lateness show
        causes.append(_late(estimation, stated_fit, latest, suspects))
    all_names = [c.name for c in channels]
    causes.append(_low_pass(estimation, stated_fit, {**names_by_kind, "all sensors": all_names}))
    if all(cause.explained <= _NEARLY_ALL for cause in causes):  # a late one left out fits as well
        gains = [c.subject for c in hypotheses if c.kind == "gain" and c.strength > 1.0]
        causes += [gain_of(estimation, name, stated_fit) for name in gains[:3]]

    def unexplained(cause: Cause) -> float:
        # A low-pass looks like lateness, and has more to choose from.
        return max(1.0 - cause.explained, 0.0) * (1.5 if cause.name == "low-pass" else 1.0)

    return sorted(causes, key=unexplained, reverse=True)


def _late(estimation: Estimation, stated_fit: Refit, sensors: str, names: Collection[str]) -> Cause:
    """Return the lateness of some sensors, or of all others if these come too early.

    `sensors`: what they are called.  `names`: of their channels.
    """

    def of_unknown_delay(c: Channel) -> Channel:
        return replace(c, delay_sigma_s=0.03) if c.name in names else c

    fit_with_delay = refit(estimation, Trial("late", channel=of_unknown_delay), stated_fit.fit.eta)
    is_late = [group.channels[0].name in names for group in fit_with_delay.box.groups]
    late_ms = 1e3 * float(fit_with_delay.box.delays_s(fit_with_delay.fit.eta)[is_late].mean())
    # The fit determines differences only, and no sensor shows a motion before it happens.
    name = f"{sensors} late" if late_ms > 0.0 else f"all but {sensors} late"
    return compared(stated_fit, fit_with_delay, Cause(name, LATE_ADVICE, f"{abs(late_ms):.1f} ms"))


def _low_pass(
    estimation: Estimation, stated_fit: Refit, names_of: Mapping[str, Collection[str]]
) -> Cause:
    """Return the low-pass filter on some sensors that explains most of a misfit.

    `names_of`: names of the channels of each kind of sensors, which are tried in turn: with coarse
    cutoffs first, then with fine ones near the best.
    """

    def trial_of(sensors: str, hz: float) -> Trial:
        def with_low_pass(c: Channel) -> Channel:
            return replace(c, low_pass_hz=hz) if c.name in names_of[sensors] else c

        return Trial(f"near {hz:.0f} Hz on {sensors}", channel=with_low_pass)

    coarse = {trial_of(sensors, hz): (sensors, hz) for sensors in names_of for hz in (15.0, 40.0)}
    tried = ranked(estimation, coarse, stated_fit.fit.eta)
    rough_fit, best = tried[0]
    sensors, coarse_hz = coarse[best]
    fine_hz = (8.0, 10.0, 20.0, 28.0) if coarse_hz == 15.0 else (20.0, 28.0, 56.0, 80.0)
    fine = [trial_of(sensors, hz) for hz in fine_hz]
    tried += ranked(estimation, fine, rough_fit.fit.eta)
    rough_fit, best = min(tried, key=lambda pair: pair[0].fit.cost)
    fit_with_low_pass = refit(estimation, best, rough_fit.fit.eta)
    advice = "state low_pass_hz of these channels from the data sheet, or switch the filter off"
    return compared(stated_fit, fit_with_low_pass, Cause("low-pass", advice, best.name))


# Clocks, second bumps, drifts ---------------------------------------------------------------------


def clock_jump(estimation: Estimation) -> Cause | None:
    """Return the clocks that jump in most runs, None if there are none.

    A gap alone is harmless: the model knows when each sample was taken.  But where a clock jumped,
    the samples after it have wrong times, and no model explains both sides, or this group and the
    others.  Up to the jump the decays must fit.
    """
    # Time in each run up to which all clocks are right; amount of each jump, and whose clock it is.
    ends_s, jumps_s, jumping = [], [], []
    for record in estimation.records:
        end_s = np.inf
        for r in record.recordings:
            steps_s = np.diff(r.time_s)
            period_s = float(np.median(steps_s)) if len(steps_s) > 1 else np.inf
            if steps_s.max(initial=0.0) > longest_gap_s(period_s):
                before_gap = int(np.argmax(steps_s))
                end_s = min(end_s, float(r.time_s[before_gap]))
                jumps_s.append(float(steps_s[before_gap]) - period_s)
                jumping.append(r.group.name)
        ends_s.append(end_s)
    is_all = len(set(jumping)) == len(estimation.box.groups)
    clocks = "all sensors" if is_all else listed(jumping)
    n_jumping = np.count_nonzero(np.isfinite(ends_s))
    sizes = (
        f"{clocks} by about {np.median(jumps_s or [0.0]):.2g} s in "
        f"{n_jumping} of {counted(len(ends_s), 'run')}; up to there the decays fit"
    )
    advice = "correct the times of the samples after the gap, or record again"
    cause = Cause("clocks that jump", advice, sizes, certain=True)
    return _if_most_fit_before(estimation, ends_s, cause)


def second_bump(estimation: Estimation) -> Cause | None:
    """Return the second bump of most runs, None if there are none.

    Free wheels only decay: in each run, the bench's check for a second strike decides on each hub's
    acceleration.  Up to the second bump the decays must fit.
    """
    from daq.verdict.checks import STRIKE_GUARD_S, STRIKE_RATIO, STRIKE_S, second_strike
    from daq.verdict.window import Trace  # both with the bench, which is slow to import

    ends_s, struck, noise = [np.inf] * len(estimation.records), [], estimation.noise
    for i, record in enumerate(estimation.records):
        onset, strikes = onset_s(record), [(0.0, 0.0, "")]  # strength, time after the onset, hub
        if onset is None:
            continue
        bump_s = record.bump_s if np.isfinite(record.bump_s) else 0.2  # that of a usual bump
        for r in record.recordings:
            for channel, column in zip(r.group.channels, r.values.T, strict=True):
                if channel.quantity is Quantity.HUB_ACCELERATION:
                    value = column - column[r.time_s < onset].mean()
                    trace = Trace(channel, r.time_s - onset, value, noise[channel.name], 0.0)
                    strike = second_strike(trace, bump_s + STRIKE_GUARD_S)
                    strikes.append((*strike, channel.name))
        strength, strike_s, name = max(strikes)
        if strength > STRIKE_RATIO:
            ends_s[i] = onset + strike_s - STRIKE_S
            struck.append(f"{name} in {record.label} at +{strike_s:.2f} s")
    sizes = f"in {len(struck)} of {counted(len(ends_s), 'run')}: {listed(struck)}"
    advice = "drive over one bump, and let the car come to rest"
    cause = Cause("a second bump", advice, sizes, certain=True)
    return _if_most_fit_before(estimation, ends_s, cause)


def _if_most_fit_before(
    estimation: Estimation, ends_s: Sequence[float], cause: Cause
) -> Cause | None:
    """Return a cause, sized, if it spoils most runs and the decays fit up to there; else None.

    `ends_s`: time in each run, s, from which on it spoils the samples; inf where it does not.
    """
    if 2 * np.count_nonzero(np.isfinite(ends_s)) <= len(ends_s):
        return None
    decays = []
    for decay, end_s in zip(estimation.decays, ends_s, strict=True):
        length_s = end_s - decay.start_s
        if length_s >= 0.1:  # less shows nothing
            cut = tuple(r.between(0.0, length_s) for r in decay.recordings)
            decays.append(replace(decay, recordings=cut))
    return _if_explained_by(estimation, decays, cause)


def _if_explained_by(
    estimation: Estimation, decays: Sequence[FreeDecay], cause: Cause
) -> Cause | None:
    """Return a cause, sized, if the decays cut or corrected for it fit by themselves; else None.

    They fit if they leave no more than noise, or a tenth of the misfit of the whole decays.
    """
    if not decays:
        return None
    generic = estimation.box.unknowns(generic_vehicles()[0])
    changed = replace(estimation, decays=tuple(decays))
    fit_alone = refit(changed, AS_STATED, generic, HOLD, steps=30, length_s=np.inf)
    excess = estimation.chi2_per_n - 1.0
    if fit_alone.excess > max(estimation.chi2_limit - 1.0, (1.0 - _NEARLY_ALL) * excess):
        return None
    compared_cause = compared(refit(estimation, length_s=np.inf), fit_alone, cause)
    return replace(compared_cause, explained=1.0 - max(fit_alone.excess, 0.0) / excess)


def drift(estimation: Estimation) -> Cause | None:
    """Return the channels whose level drifts at rest if that explains a misfit; None if not."""
    records, drifts = estimation.records, dict[str, float]()  # SI a second
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
    """Return the mean slope before the bumps of each channel that drifts there, SI a second.

    A slope needs 20 samples at rest, and a drift a slope in three runs or more.
    """
    slopes_by_channel: dict[str, list[float]] = {}
    for record in records:
        onset = onset_s(record)
        if onset is None:
            continue
        for r in record.recordings:
            at_rest = r.time_s < onset - 0.005  # the onset is seen a little late
            if np.count_nonzero(at_rest) >= 20:
                slopes_of_run = np.polyfit(r.time_s[at_rest], r.values[at_rest], 1)[0].tolist()
                for channel, slope in zip(r.group.channels, slopes_of_run, strict=True):
                    slopes_by_channel.setdefault(channel.name, []).append(slope)
    return {
        name: float(np.mean(slopes))
        for name, slopes in slopes_by_channel.items()
        # Six standard deviations, by the scatter of the runs, are no chance.
        if len(slopes) > 2
        and abs(np.mean(slopes)) > 6.0 * np.std(slopes, ddof=1) / len(slopes) ** 0.5
    }


def _without_drifts(record: Record, drifts: Mapping[str, float]) -> Record:
    """Return a record less the drifts of its channels, SI a second."""
    recordings = []
    for r in record.recordings:
        slopes = np.array([drifts.get(channel.name, 0.0) for channel in r.group.channels])
        recordings.append(replace(r, values=r.values - np.outer(r.time_s, slopes)))
    return replace(record, recordings=tuple(recordings))
