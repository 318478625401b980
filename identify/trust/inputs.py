"""Judges what a fit is given: its samples, what the session lacks for one, and its statements.

Every sample is fitted at its own time, so uneven sampling is legal and a lost frame costs no more
than its information.  Harmful are a channel that looks alive but is not, and peaks beyond the range
of a sensor or its message; on the bump both are harmless, because only the free decay is fitted.

One wrong statement (a fact, place, delay, gain or weight) distorts the fit and makes others
disagree with it.  So the one that explains most is removed first, and only statements that still
disagree are named after it (data snooping, Baarda 1968).  A common factor of all weights counts as
a separate statement.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from daq.channels import Quantity
from daq.samples.converter import FROZEN_S, flat_tops
from daq.sessions import Session
from daq.vehicle import FactQuantity, MassState, parameter_names, parameter_unit
from dbc.words import Finding, Severity

from ..decays.decay import GUARD_S, Record, decay_start_s
from ..decays.usable import Usable, frozen
from ..fit.estimation import Estimation
from ..fit.grey_box import SIGNED, GreyBox
from ..fit.likelihood import covariance_of
from ..model.matrices import LOADS, Real
from .finding import listed

_LENGTHS = {
    FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK,
    "a", "b", "t_f", "t_r", "y_s",
}  # fmt: skip
"""Facts that do not depend on the scale."""
_LIMIT_SIGMAS = 4.0
"""Standard deviations beyond which a statement is contradicted."""


def sample_findings(session: Session, records: Sequence[Record]) -> Iterator[Finding]:
    """Yield findings on the samples of a session's accepted runs; `records`: as they are fitted."""
    missing = [
        f"{c.name} in {run.label}"
        for c in session.used_channels
        for run in session.accepted
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
    # The fit may move a start back, into the guard time.
    starts_s = {record.label: decay_start_s(record) - GUARD_S for record in records}
    tops = [  # number of equal samples, their value, and where
        (stop - start, f"{column[start]:.4g} {channel.unit}", f"{channel.name} in {record.label}")
        for record in records
        for r in record.recordings
        for channel, column in zip(r.group.channels, r.values.T, strict=True)
        for start, stop in flat_tops(column)
        if r.time_s[stop - 1] >= starts_s[record.label]
    ]
    if tops:
        tops.sort(key=lambda top: -top[0])
        text = (
            f"flat tops in the free decay, {tops[0][0]} equal samples at {tops[0][1]}, which is "
            f"not by chance: {listed(where for *_, where in tops)}; the sensor saturates and the "
            "true motion is larger: use a lower bump or a sensor with a wider range"
        )
        yield Finding("saturation", Severity.WARNING, text)


# What a session lacks for a fit, and what of it cannot be used ------------------------------------


def shortcomings(
    records: Sequence[Record], session: Session, unused: Sequence[Finding] = ()
) -> tuple[Finding, ...]:
    """Return findings on what is missing for a fit; none if nothing is.

    `unused`: what cannot be used (`unused_findings`); it comes first, as the reason.
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
            text = f"no accepted run of {len(session.runs)}; {first.label} is rejected: {why}"
        yield "no_runs", text
        return
    names = [record.label for record in records]
    if repeated := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        yield "run_names", f"two accepted runs are named {listed(repeated)}: number the repeats"
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
    times_s = [r.time_s for record in records for r in record.recordings if len(r.time_s) > 1]
    step_s = min((np.median(np.diff(time_s)) for time_s in times_s), default=0.0)
    if step_s > 1.0 / 20.0:  # mostly a wrong unit of time
        advice = "sample at 50 Hz or more"
        for unit, factor in (("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3)):
            if 1e-5 <= factor * step_s <= 1.0 / 20.0:  # no sensor sends more often
                advice = f"are the times in {unit}? Give them in s"
        yield "rate", f"samples come at {1.0 / step_s:.2g} Hz, but wheels swing at 10 Hz: {advice}"
    yield from (("units", text) for text in _wrong_units(records))
    yield from (("mass_states", text) for text in _no_known_mass(records, session))


def _wrong_units(records: Sequence[Record]) -> Iterator[str]:
    """Yield a text for each unit in which several channels show more than a car can move.

    A single wrong one is found by the others, with its factor.
    """
    # Largest peak to peak of a car on its wheels by unit, and the likely unit of what exceeds it.
    for unit, limit, likely_unit in (("m", 0.5, "mm"), ("rad/s", 6.0, "deg/s")):
        peaks: dict[str, float] = {}
        for recording in (r for record in records for r in record.recordings):
            for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
                if channel.unit == unit and np.ptp(column) > limit:
                    peaks[channel.name] = max(peaks.get(channel.name, 0.0), float(np.ptp(column)))
        if len(peaks) > 1:
            change = f"{listed(peaks)} change by up to {max(peaks.values()):.3g} {unit}"
            advice = f"are they in {likely_unit}? State the unit of the signals"
            yield f"{change}, more than a car can move: {advice}"


def _no_known_mass(records: Sequence[Record], session: Session) -> Iterator[str]:
    """Yield a text where nothing fixes the size of masses and forces.

    Free decays leave a common factor of them open.  It follows from a fact that has a mass or a
    force in it, or from runs both with added mass and without.
    """
    names = parameter_names(session.vehicle.structure)
    fixing = {*LOADS, *(name for name in names if parameter_unit(name) != "m")}
    if any(fact.quantity in fixing for fact in session.vehicle.facts):
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
    """Yield a finding on all that was left out of a session, with the reasons.

    `used`: what `identify.decays.usable` keeps of it.
    """
    units = session.units
    absurd = listed(
        f"{v.channel} in {v.run} ({v.count}: {v.value:g} {units[v.channel]})" for v in used.absurd
    )
    spikes = listed(
        f"{s.channel} in {s.run} at {s.time_s:.3f} s ({s.value:.4g} {units[s.channel]})"
        for s in used.spikes
    )
    labels_by_reason: dict[str, list[str]] = {}
    for recorded, run in zip(session.runs, used.session.runs, strict=True):
        if run.status != recorded.status:
            labels_by_reason.setdefault("; ".join(run.reasons), []).append(run.label)
    left_out = "; ".join(f"{listed(runs)}: {reason}" for reason, runs in labels_by_reason.items())
    channels = zip(session.channels, used.session.channels, strict=True)
    dead = listed(recorded.name for recorded, c in channels if recorded.quantity != c.quantity)
    for code, fault, places, advice in (
        ("absurd_values", "values that no sensor shows", absurd,
         "they are taken as missing: check byte order, scale and unit of the signal in the DBC, "
         "and the sensor"),
        ("spikes", "samples that stand out from those on both sides", spikes,
         "they are taken as missing: check supply and plug of the sensor, and the frames at these "
         "times"),
        ("left_out", "not used", left_out,
         "check plugs, clock and cut of the runs, and repeat them; where a sensor was off on "
         "purpose, set its channels to unused"),
        ("dead_channels", "never moves in any run", dead,
         "the runs are fitted by the other channels: repair the sensor or map it as unused"),
        ("silent_channels", "silent for a part of most runs", listed(used.silent),
         "these runs are fitted by what came: check sensor and plug"),
    ):  # fmt: skip
        if places:
            yield Finding(code, Severity.NOTE, f"{fault}: {places}; {advice}")


# Statements ---------------------------------------------------------------------------------------


def scale_facts(box: GreyBox) -> tuple[str, ...]:
    """Return the quantities of facts that fix the scale: loads, or a spring that was measured."""
    return tuple(fact.quantity for fact in box.facts if fact.quantity not in _LENGTHS)


def unseen_findings(box: GreyBox, mass_states: Sequence[MassState]) -> Iterator[Finding]:
    """Yield notes on what no residual shows: the scale of all masses, and what is taken as exact.

    Free decays determine ratios of masses only, and a motion that is shown too large looks like one
    that is larger.

    `box`: structure of a problem that the runs determine.  `mass_states`: as stated.
    """
    if not scale_facts(box):
        text = (
            "the scale rests on the added weights alone: if all of them are 10 % off, so are all "
            "masses, inertias, stiffnesses and dampers, and no fit shows it; weigh the car as a "
            "check"
        )
        yield Finding("scale", Severity.NOTE, text)
    exact = [c.name for group in box.groups for c in group.channels if not c.scale_sigma]
    if exact:
        text = (
            f"no gain_sigma is stated for {listed(exact)}: a sensor that shows 1 % too much can "
            "move half tracks and inertias by 1 to 2 %, more than their intervals, and no fit "
            "shows it; state it from data sheet or calibration"
        )
        yield Finding("gains", Severity.NOTE, text)
    unstated = [
        f"weight {i} of state {state.name}"
        for state in mass_states
        for i, weight in enumerate(state.added.weights, start=1)
        if weight != weight.weighed()
    ]
    if unstated:
        text = (
            f"{listed(unstated)}: stated with ± 0 kg or ± 0 m, but no scale or tape is exact: "
            "0.5 % and 10 mm are assumed; state sigma_kg of the scales and position_sigma_m of the "
            "tape measure"
        )
        yield Finding("exact_weights", Severity.NOTE, text)


class Contradiction(NamedTuple):
    """One statement that the runs contradict."""

    name: str
    """Name of the statement; others that the runs do not separate from it follow after "or"."""
    sigmas: float
    """Misfit in its own standard deviations, after the statements named before it were removed."""
    direction: Real
    """Error of each statement, in its sigmas, (n_stated,): 1 of this one, or each weight's mass."""


class _Stated:
    """Compares statements with a fit: facts, then the corrections of the grey box."""

    def __init__(self, estimation: Estimation) -> None:
        box, eta = estimation.box, estimation.fit.eta
        fact_misfits, fact_slopes = estimation.engine.fact_misfits(eta)
        n, deviations = len(box.parameters), box.deviations(eta)
        # P: elements may follow the unknowns of the grey box.
        deviation_slopes = np.zeros((len(deviations), len(eta)))
        k = np.arange(len(deviations))
        deviation_slopes[k, n + k] = 1.0 / box.prior_sigma[n + k]
        self.parameters = box.parameters
        self.rows = np.vstack([fact_slopes, deviation_slopes])
        """Slopes of what is stated by the unknowns, in its sigmas, (n_stated, P)."""
        self.misfits = np.concatenate([fact_misfits, -deviations])
        """Stated less fitted, in its sigmas, (n_stated,)."""
        # Not the covariance of the fit, which is wider for unstated scatter and laws: these do not
        # change by how much the fit follows the statements.
        covariance = covariance_of(np.sum(list(estimation.fit.information.values()), axis=0))
        self.covariance = np.where(np.isfinite(covariance), covariance, 0.0)
        """Covariance of the unknowns by noise and statements, zero for those not released."""
        # Errors of the laws of a real car move the fit, but show in no residual.
        laws = np.zeros_like(covariance) if estimation.laws is None else estimation.laws
        noise = np.eye(len(self.rows)) - self.rows @ self.covariance @ self.rows.T
        self.misfit_covariance = noise + self.rows @ laws @ self.rows.T
        """Of a right statement, in its sigmas, (n_stated, n_stated)."""

    def sizes(self, directions: Sequence[Real]) -> tuple[Real, dict[str, float]]:
        """Return by what multiple of each of k directions, (n_stated,), statements are off, (k,).

        Then the change of each parameter's unknown (`Cause.moved`) without these statements.
        """
        D = np.column_stack(directions)  # (n_stated, k)
        sizes = np.linalg.solve(D.T @ self.misfit_covariance @ D, D.T @ self.misfits)
        changes = -self.covariance @ (self.rows.T @ (D @ sizes))
        return sizes, dict(zip(self.parameters, changes.tolist(), strict=False))


def contradiction_findings(estimation: Estimation) -> Iterator[Finding]:
    """Yield a finding on the statements that the runs contradict."""
    wrong = contradictions(estimation)
    if not wrong:
        return
    sizes, changes = _Stated(estimation).sizes([direction for *_, direction in wrong])
    moved = max(abs(change) for name, change in changes.items() if name not in SIGNED)
    corrections = dict(zip(estimation.box.corrections, estimation.box.stated, strict=True))
    named = []
    for (name, sigmas, _), size in zip(wrong, sizes.tolist(), strict=True):
        statement = corrections.get(name)
        corrected = f", {statement.in_words(-size * statement.sigma)}" if statement else ""
        named.append(f"{name} by {sigmas:.1f} sigma{corrected}")
    text = (
        f"the runs contradict what is stated: {'; '.join(named)} (limit {_LIMIT_SIGMAS:g}; moves a "
        f"parameter by about {min(moved, 1.0) * 100:.1f} %): measure it again"
    )
    yield Finding("contradiction", Severity.ERROR if moved > 0.1 else Severity.WARNING, text)


def contradictions(estimation: Estimation) -> tuple[Contradiction, ...]:
    """Return the statements that the runs contradict, the worst first.

    Where the residuals exceed the noise, a misfit counts in units of the residuals.  Empty for a
    fit that did not converge, or a linear one that does not hold: it contradicts every statement.
    """
    holds = estimation.holds or estimation.nonlinear is not None
    if not (estimation.fit.converged and holds):
        return ()
    stated = _Stated(estimation)
    unit = 1.0 if estimation.holds else np.sqrt(max(1.0, estimation.chi2_per_n))
    # Covariance of the misfits, (n_stated, n_stated), and k suspected directions, (n_stated, k).
    misfits, Q = stated.misfits / unit, stated.misfit_covariance
    names, D = _suspects(estimation.box)
    first_variance = np.einsum("ik,ij,jk->k", D, Q, D)  # of the misfit in each direction
    squared_length = np.maximum(np.einsum("ik,ik->k", D, D), 1e-300)
    # Where the misfit has less of a statement's variance, the fit is not exact enough to test it.
    has_redundancy = first_variance > 1e-5 * squared_length
    wrong: list[Contradiction] = []
    while names:
        variance = np.einsum("ik,ij,jk->k", D, Q, D)
        # Of a direction that those taken out leave less, rounding decides.
        testable = has_redundancy & (variance > 1e-3 * first_variance)
        stds = np.sqrt(np.where(testable, variance, 1.0))
        sigmas = np.where(testable, (D.T @ misfits) / stds, 0.0)
        worst = int(np.argmax(np.abs(sigmas)))
        if not abs(sigmas[worst]) > _LIMIT_SIGMAS:
            break
        d = D[:, worst]
        variances = np.where(testable, variance, np.inf) * variance[worst]
        correlation = np.abs(D.T @ Q @ d) / np.sqrt(variances)
        # The runs do not show which of several statements is wrong whose tests are so alike.
        alike = [names[k] for k in np.flatnonzero(correlation > 0.95).tolist() if k != worst]
        name = " or ".join([names[worst], *alike])
        wrong.append(Contradiction(name, float(abs(sigmas[worst])), d))
        # The error in this direction is taken out of the misfits and their covariance.
        response = Q @ d / variance[worst]
        misfits = misfits - response * (d @ misfits)
        Q = Q - np.outer(response, Q @ d)
    return tuple(wrong)


def _suspects(box: GreyBox) -> tuple[tuple[str, ...], Real]:
    """Return k suspects, each statement and all weights: names, and directions, (n_stated, k).

    A direction is the error of each statement in its sigmas.  All weights together only if two or
    more are uncertain and a fact fixes the scale: runs alone hardly show a common factor.
    """
    facts = [f"{fact.quantity} = {fact.value:g} ± {fact.sigma:g}" for fact in box.facts]
    names = [*facts, *box.corrections]
    together = np.zeros(len(names))
    for state in box.mass_states:
        for i, weight in enumerate(state.added.weights, start=1):
            if weight.sigma_kg > 0.0:
                row = names.index(f"weight {i} of state {state.name}")
                together[row] = weight.mass_kg / weight.sigma_kg
    alone = np.eye(len(names))
    if np.count_nonzero(together) > 1 and scale_facts(box):
        return (*names, "all weights by a common factor"), np.column_stack([alone, together])
    return tuple(names), alone


def contradicted_shift(estimation: Estimation, wrong: Sequence[Contradiction]) -> dict[str, float]:
    """Return the change of each parameter's unknown without the contradicted statements."""
    return _Stated(estimation).sizes([direction for *_, direction in wrong])[1]


def shift_without_scales(estimation: Estimation) -> dict[str, float]:
    """Return the change of each parameter's unknown if loads and springs are off by one factor."""
    box, scaled = estimation.box, scale_facts(estimation.box)
    loads = [f.value / f.sigma if f.quantity in scaled else 0.0 for f in box.facts]
    direction = np.array([*loads, *np.zeros(len(box.corrections))])
    return _Stated(estimation).sizes([direction])[1]
