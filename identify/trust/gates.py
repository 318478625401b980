"""Judges the fit itself: its parameters, the energy of its modes, and its residuals.

The intervals assume white noise.  If the noise is already coloured at rest, they are too narrow; if
it is white at rest and the residuals are not, the model leaves motion unexplained.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from daq.bumps import BUMPS
from dbc.words import Finding, Severity, counted

from ..decays.decay import coarse_steps, onset_s
from ..fit.estimation import Estimation, linearised_at
from ..fit.grey_box import SIGNED
from ..fit.likelihood import covariance_of, linearised
from ..fit.uncertainty import COVERAGE_95, estimates
from ..model.matrices import N_DOF, Full, Real, derived_quantities, whole_vehicle_indices
from ..numbers import half_width_percent
from .finding import listed
from .inputs import contradiction_findings

_PLAUSIBLE = {
    "total_mass": (200.0, 20_000.0),
    "front_ride_damping_ratio": (0.03, 1.2),
    "rear_ride_damping_ratio": (0.03, 1.2),
    "front_ride_frequency": (0.5, 5.0),
    "rear_ride_frequency": (0.5, 5.0),
    "front_wheel_hop_frequency": (5.0, 30.0),
    "rear_wheel_hop_frequency": (5.0, 30.0),
}
"""Limits far outside the values of road vehicles: beyond them, a scale or unit is wrong."""
_MEASURED = {"roll_gyration_over_track": (0.367, 0.512), "pitch_index": (0.816, 1.298)}
"""Least and largest value, whole vehicle, of 204 cars, vans and light trucks that were measured:
NHTSA Light Vehicle Inertial Parameter Database."""
BELOW_SIGMAS = 3.0
"""Standard deviations below zero beyond which tyre damping, or a bar, is negative."""


def with_widest_intervals(estimation: Estimation) -> Estimation:
    """Return a linear estimation whose intervals do not depend on where the estimate happens to be.

    Where the runs hardly determine a parameter (to 10 %), the information changes within its
    interval, and a low estimate may look certain: the widest covariance along that direction
    counts.  A nonlinear estimation is returned as it is.  Parameters that may be zero do not count.
    """
    names, covariance = estimation.box.parameters, estimation.fit.covariance
    std = np.sqrt(np.diag(covariance)[: len(names)])  # relative: unknowns are logarithms
    std[[name in SIGNED for name in names]] = 0.0
    std[~np.isfinite(std)] = 0.0
    weakest = int(np.argmax(std))
    if not std[weakest] > 0.1 or estimation.nonlinear is not None:
        return estimation
    step = np.where(np.isfinite(covariance[:, weakest]), covariance[:, weakest], 0.0) / std[weakest]
    step *= min(3.0, 1.0 / std[weakest])  # three standard deviations, at most a factor of e
    widest = estimation.fit
    for eta in (widest.eta - step, widest.eta + step):
        blocks = linearised(estimation.box, estimation.decays, estimation.noise, eta).blocks
        wider = covariance_of(np.sum([part.information for part in blocks.values()], axis=0))
        if wider[weakest, weakest] > widest.covariance[weakest, weakest]:
            widest = replace(widest, covariance=wider)
    return replace(estimation, fit=widest)


def undetermined(estimation: Estimation) -> tuple[str, ...]:
    """Return the parameters that the data must determine and do not.

    One that may be zero (a bar, tyre damping) must only have a finite variance.
    """
    return tuple(
        name
        for name, e in estimates(estimation.box, estimation.fit).items()
        if not e.determined and (name not in SIGNED or not np.isfinite(e.std))
    )


def parameter_findings(estimation: Estimation) -> Iterator[Finding]:
    """Yield findings on the estimates of the parameters."""
    known = estimates(estimation.box, estimation.fit)
    if unknown := undetermined(estimation):
        advice = (
            "record bounce, pitch and roll (warp helps most) in both mass states, with sensors on "
            "body and wheels"
        )
        if set(unknown) == {n for n, e in known.items() if n not in SIGNED and e.unit != "m"}:
            advice = (
                "their ratios are known, but the added weights are too light to fix their scale: "
                "add heavier ones, or weigh the vehicle (total and front axle) and state the loads "
                "as facts"
            )
        elif missing := missing_runs(estimation):
            advice = f"record {missing} runs in both mass states"
        text = f"these runs do not determine {', '.join(unknown)}: {advice}"
        yield Finding("undetermined", Severity.ERROR, text)
        return
    # A standard deviation of 2.5 % is an interval of 5 % to either side.  Of 2.2 % where elements
    # were chosen, too, 1.5 % are errors of the laws, and three deviations of the rest are 5 %.
    limit = 0.025 if estimation.nonlinear is None else 0.022
    stds = {name: e.std / abs(e.value) for name, e in known.items() if name not in SIGNED}
    if wide := {name: std for name, std in stds.items() if std > limit}:
        worst = max(wide, key=lambda name: wide[name])
        half = COVERAGE_95 * wide[worst]
        text = (
            f"wide intervals: {', '.join(wide)} (worst {worst} ± "
            f"{half_width_percent(1.0, 1.0 - half, 1.0 + half)}): add runs, a warp run first, "
            "heavier weights, or scales as facts"
        )
        yield Finding("wide", Severity.WARNING, text)
    if unusual := list(_implausible(estimation)):
        text = f"not a usual vehicle: {'; '.join(unusual)}: check weights, units and positions"
        yield Finding("implausible", Severity.WARNING, text)
    yield from contradiction_findings(estimation)


def missing_runs(estimation: Estimation) -> str:
    """Return "roll" or "pitch", the kind of runs that a campaign lacks; "" if it has both."""
    labels = [record.label for record in estimation.records]
    # Fraction of its height by which each kind of bump lifts each wheel.
    lifts = [b.height_ratios for kind, b in BUMPS.items() if any(f"_{kind}_" in n for n in labels)]
    if not any(fl != fr or rl != rr for fl, fr, rl, rr in lifts):
        return "roll"
    return "" if any(fl != rl or fr != rr for fl, fr, rl, rr in lifts) else "pitch"


def _implausible(estimation: Estimation) -> Iterator[str]:
    """Yield what no usual vehicle is like, with the usual values."""
    full = estimation.full.astype(complex)
    values = derived_quantities(full)
    for name, (low, high) in _PLAUSIBLE.items():
        quantity, unit = values[name]
        value, unit_text = float(quantity.real), "" if unit == "1" else f" {unit}"
        if not low < value < high:
            yield f"{name} {value:.3g}{unit_text} (usual {low:g} .. {high:,g})"
    whole = whole_vehicle_indices(full)
    for name, (low, high) in _MEASURED.items():
        value = float(whole[name].real)
        if not 0.9 * low < value < 1.1 * high:  # published data of small cars have 0.357 in roll
            yield f"{name} {value:.3g} (204 measured vehicles: {low:g} .. {high:g})"
    for name, e in estimates(estimation.box, estimation.fit).items():
        if name in SIGNED and e.value < -BELOW_SIGMAS * e.std:
            left_spring = Full.K_S + 2 * name.endswith("r")
            k_s = float(full[left_spring : left_spring + 2].real.mean())  # mean of the axle's two
            # The springs of a solid axle act on a shorter lever in roll: its bar is below zero.
            # In roll an axle has the stiffness of its springs and twice that of its bar.
            if name.startswith("k_a") and e.value < -0.5 * k_s:
                yield f"{name} {e.value:.3g} N/m leaves the axle no stiffness in roll"
            elif name.startswith("c_t"):
                yield f"{name} {e.value:.3g} {e.unit} below zero"


# How far each mode stands out of the noise --------------------------------------------------------

SNR_LIMIT_DB = 20.0
"""A decaying wave whose energy is E times the noise shows its frequency to ``2 zeta / sqrt(E)``.
At 20 dB and a damping ratio of 0.25 that is 5 %: as much as the added masses shift a frequency,
from which all inertias follow."""


def mode_snr_db(estimation: Estimation) -> dict[str, tuple[float, ...]]:
    """Return the energy of each mode in each run over the noise, dB.

    The energy is that of the matched filter: the squares of the mode's motion in every sample, in
    units of the noise, summed over all channels, as far as other modes cannot reproduce it.  A run
    that does not excite a mode has some 3 dB by the noise alone.  Modes are in the order of
    `identify.modes.modal_model.modes_of` for the run's mass state.
    """
    linearised = linearised_at(estimation)
    snr_db = {}
    for decay, linear in zip(estimation.decays, linearised.linear, strict=True):
        modes = linearised.points[decay.mass_state].modes
        initial_state = linear.solution[: 2 * N_DOF]
        covariance = linear.normal_inverse[: 2 * N_DOF, : 2 * N_DOF]
        oscillating = np.flatnonzero(modes.poles.imag > 0.0)
        by_frequency = oscillating[np.argsort(np.abs(modes.poles[oscillating]), kind="stable")]
        of_modes_db = []
        for k in by_frequency.tolist():
            rows = np.array([modes.W[k].real, modes.W[k].imag])  # from the state to the mode
            amplitude = rows @ initial_state
            inverse = np.linalg.pinv(rows @ covariance @ rows.T, hermitian=True)
            energy = max(float(amplitude @ inverse @ amplitude), 1e-3)  # -30 dB: it does not show
            of_modes_db.append(10.0 * float(np.log10(energy)))
        snr_db[decay.label] = tuple(of_modes_db)
    return snr_db


# Size and place of the misfit ---------------------------------------------------------------------

CHI2_LIMIT = 1.5
"""Beyond it a result is refused: every simulated fault that moves a parameter by a third is."""
Z_LIMIT = 4.5
"""Normal deviate of a correlation: one false alarm in 20,000 campaigns of seven channels."""
NARROW_LIMIT = 1.3
"""Factor by which intervals may be too narrow: they then cover 87 % instead of 95 %."""
EARLY_S = 0.3
"""Length of the early part, s, tested separately: errors of the wheels' motion end within it."""


def chi2_by_run(estimation: Estimation) -> dict[str, dict[str, float]]:
    """Return chi2 per degree of freedom, by run and channel."""
    noise = estimation.noise
    return {
        of_run.label: {
            name: float(values @ values) / noise[name] ** 2 / of_run.freedom[name]
            for name, values in of_run.values.items()
        }
        for of_run in estimation.residuals
    }


def misfit_findings(estimation: Estimation) -> Iterator[Finding]:
    """Yield findings on convergence, chi2/n, the noise at rest, and where the decays start."""
    nonlinear = estimation.nonlinear is not None
    advice_to_forbid = "forbid in [vehicle.structure] the elements that the car does not have"
    if estimation.unreached:
        text = (
            f"the search ended for want of time, not finished: {listed(estimation.unreached)}; "
            f"its numbers may be away from the optimum: {advice_to_forbid}"
        )
        yield Finding("convergence", Severity.WARNING, text)
    elif not estimation.fit.converged:
        advice = "check units, signs and positions of the channels"
        if nonlinear:
            advice = f"its numbers may be away from the optimum; add runs, or {advice_to_forbid}"
        steps = counted(estimation.fit.iterations, "iteration")
        # The nonlinear fit ends near its optimum even if it has not converged.
        severity = Severity.WARNING if nonlinear else Severity.ERROR
        yield Finding("convergence", severity, f"the fit did not converge in {steps}: {advice}")
    if not estimation.holds:
        worst_chi2, channel, run = max(
            (chi2, name, label)
            for label, row in chi2_by_run(estimation).items()
            for name, chi2 in row.items()
        )
        # A chi2/n of NaN is refused, too.
        refused = not estimation.chi2_per_n <= max(CHI2_LIMIT, estimation.chi2_limit)
        model, intervals = "the linear 7-DOF model", "the intervals do not hold"
        if nonlinear:
            model = "the model with friction, damper curves, stops and mounts"
            if not refused:
                intervals = "the intervals are widened by the unexplained rest"
        text = (
            f"{model} does not explain the decays: chi2/n = {estimation.chi2_per_n:.3f} (limit "
            f"{estimation.chi2_limit:.3f}, refused above {CHI2_LIMIT}), worst {channel} in {run} "
            f"with {worst_chi2:.2f}: {intervals}"
        )
        yield Finding("chi2", Severity.ERROR if refused else Severity.WARNING, text)
    if not estimation.rest:
        text = "no quiet stretch before the bumps: the noise is taken from the residuals"
        yield Finding("noise", Severity.NOTE, text)
    elif coarse := coarse_steps(estimation.records):
        units = {c.name: c.unit for group in estimation.box.groups for c in group.channels}
        steps = listed(f"{name} ({step:.2g} {units[name]})" for name, step in coarse.items())
        text = (
            f"coarse sensors, whose steps hide the noise at rest: {steps}; their noise is taken as "
            "step/sqrt(12): a smaller range of the sensor narrows the intervals"
        )
        yield Finding("coarse_sensors", Severity.NOTE, text)
    late_s, run = 0.0, ""  # largest delay of a decay after the stated end of its bump
    for record, decay in zip(estimation.records, estimation.decays, strict=True):
        onset = onset_s(record)
        if onset is not None and np.isfinite(record.bump_s):
            late_s, run = max((late_s, run), (decay.start_s - onset - record.bump_s, record.label))
    if late_s > 0.015:  # onset and guard explain less
        text = (
            f"the model holds only from {late_s * 1e3:.0f} ms after the stated end of the bump "
            f"({run}): the bump lasts longer than bump_s says, or the first motion of the wheels "
            "does not fit; check bump_s, the hub sensors, and that no wheel lifted"
        )
        yield Finding("late_start", Severity.WARNING, text)


# Whiteness ----------------------------------------------------------------------------------------


class _Stretch(NamedTuple):
    """Residuals of one channel in one run, SI, and how many constants were fitted to them."""

    channel: str
    time_s: Real
    values: Real
    constants: float
    """No whole number where the stretch is a part of what they were fitted to."""


class _Correlation(NamedTuple):
    """Correlation of successive residuals, and the number of pairs that it rests on."""

    r: float
    n_pairs: float

    def z(self, other: _Correlation) -> float:
        """Return the excess over another correlation, the true one, in standard deviations."""
        variance = (1.0 - other.r**2) * (1.0 / self.n_pairs + 1.0 / other.n_pairs)
        return float((self.r - other.r) / np.sqrt(variance))


_WHITE = _Correlation(0.0, np.inf)


def whiteness_findings(estimation: Estimation) -> Iterator[Finding]:
    """Yield findings where residuals, or the noise at rest, correlate from sample to sample.

    The lag-1 autocorrelation of a channel's residuals is compared with that at rest, in the early
    part of the decays and in all of them.
    """
    noise = estimation.noise
    at_rest = _correlations(_noise_before_motion(estimation), noise)
    coloured = {name: c for name, c in at_rest.items() if c.z(_WHITE) > Z_LIMIT}
    if coloured:
        names = sorted(coloured, key=lambda name: -coloured[name].r)
        worst = coloured[names[0]]
        factor = float(np.sqrt((1.0 + worst.r) / (1.0 - worst.r)))
        yield Finding(
            "coloured_noise",
            Severity.WARNING if factor > NARROW_LIMIT else Severity.NOTE,
            f"the noise at rest is not white, worst {names[0]} with a correlation of {worst.r:.2f} "
            f"from sample to sample (z {worst.z(_WHITE):.0f}, limit {Z_LIMIT}): {listed(names)}; "
            f"intervals that rest on it are too narrow by up to {factor:.2f} (limit "
            f"{NARROW_LIMIT}): look for hum or a running engine, and state the sensor's low-pass "
            "if it has one",
        )
    excess: dict[str, tuple[float, float, str]] = {}  # largest z of a channel, its r, its window
    windows = {f"the first {EARLY_S:g} s of the decays": EARLY_S, "the decays": np.inf}
    for window, end_s in windows.items():
        correlations = _correlations(_residuals_until(estimation, end_s), noise)
        for name, correlation in correlations.items():
            z = correlation.z(at_rest.get(name, _WHITE))
            if z > max(Z_LIMIT, excess.get(name, (0.0,))[0]):
                excess[name] = (z, correlation.r, window)
    if excess:
        names = sorted(excess, key=lambda name: -excess[name][0])
        z, r, window = excess[names[0]]
        compared, meaning = "and there is no rest to compare with", ", or the noise is coloured"
        if names[0] in at_rest:
            compared, meaning = f"but {at_rest[names[0]].r:.2f} at rest", ""
        yield Finding(
            "whiteness",
            Severity.WARNING,
            f"the residuals are not white, worst {names[0]} in {window} with a correlation of "
            f"{r:.2f} from sample to sample {compared} (z {z:.1f}, limit {Z_LIMIT}): "
            f"{listed(names)}; the model leaves motion unexplained{meaning}, so errors may exceed "
            "the intervals: check delay, low-pass, gain and place of these sensors, friction and "
            "dampers",
        )


def _residuals_until(estimation: Estimation, end_s: float) -> Iterator[_Stretch]:
    """Yield the residuals of each channel before `end_s`, s since the decay's start.

    Initial state and offset are fitted to the whole decay.  By approximation each sample bears the
    same share of them, so the kept samples bear as many constants as their share of all samples.
    """
    for decay, residuals in zip(estimation.decays, estimation.residuals, strict=True):
        for recording in decay.recordings:
            kept = recording.time_s < end_s
            for name in (channel.name for channel in recording.group.channels):
                values = residuals.values[name]
                constants = (len(values) - residuals.freedom[name]) * float(np.mean(kept))
                yield _Stretch(name, recording.time_s[kept], values[kept], constants)


def _noise_before_motion(estimation: Estimation) -> Iterator[_Stretch]:
    """Yield the samples of each channel before the motion begins, less their mean."""
    for record in estimation.records:
        onset = onset_s(record)
        if onset is None:
            continue
        for recording in record.recordings:
            quiet = recording.time_s < onset - 0.005  # the onset is seen a little late
            values = recording.values[quiet]
            if len(values) > 2:  # two samples less their mean are always opposite
                columns = (values - values.mean(axis=0)).T
                for channel, column in zip(recording.group.channels, columns, strict=True):
                    # The one constant is the mean.
                    yield _Stretch(channel.name, recording.time_s[quiet], column, 1.0)


def _correlations(
    stretches: Iterator[_Stretch], noise: Mapping[str, float]
) -> dict[str, _Correlation]:
    """Return the correlation of the channels that have samples and noise enough to be judged.

    That is 100 pairs, values above rounding, and more than four of them.  The stretches of one
    channel are pooled; a gap in the sampling makes no pair.
    """
    sums: dict[str, Real] = {}  # products, squares, pairs and constants of each channel
    shows_noise = set()
    for channel, time_s, values, constants in stretches:
        if len(time_s) < 2:
            continue
        interval_s = np.diff(time_s)
        period_s = np.median(interval_s)
        is_pair = np.abs(interval_s - period_s) < 0.5 * period_s  # no sample is missing
        earlier, later = values[:-1][is_pair], values[1:][is_pair]
        squares = (earlier @ earlier + later @ later) / 2.0
        of_stretch = np.array([earlier @ later, squares, is_pair.sum(), constants])
        sums[channel] = sums.get(channel, 0.0) + of_stretch
        if len(np.unique(values)) > 4:  # a coarser converter shows its steps, not the noise
            shows_noise.add(channel)
    result = {}
    for channel, of_channel in sums.items():
        products, squares, n_pairs, constants = of_channel.tolist()
        is_above_rounding = squares > 0.01 * noise[channel] ** 2 * n_pairs
        if n_pairs >= 100 and is_above_rounding and channel in shows_noise:  # 100 show r to 0.1
            # Each fitted constant takes a smooth part, of correlation 1, out of the residuals:
            # one pair's worth, which is added again.
            r = products / squares + constants / n_pairs
            result[channel] = _Correlation(min(max(r, -0.99), 0.99), n_pairs)  # at 1, z is inf
    return result
