"""Finds parameters that are undetermined, or impossible for a usual vehicle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.bumps import BUMPS
from daq.runs import Excitation
from daq.vehicle import Corner, VehicleGeometry, parameter_unit
from dbc.units import G_M_S2
from dbc.words import Finding, Severity

from ..decays.decay import FreeDecay, onset_s
from ..fit.estimation import Estimation, linearised_at
from ..fit.grey_box import SIGNED
from ..fit.likelihood import covariance_of, normal_blocks
from ..fit.uncertainty import COVERAGE_95, estimates
from ..fit.varpro import Evaluated, LinearPart, over_two, pseudo_inverse
from ..model.facts import derived_quantities, whole_vehicle_indices
from ..model.matrices import N_DOF, Full, PhysicalModel, loaded_model
from ..modes.modal_model import mode_names, modes_of
from ..numbers import half_width_percent
from .finding import listed
from .statements import contradiction_findings

_WIDE_SHARE = 0.025
"""Relative standard deviation above which the 95 % interval is wider than 5 % to either side."""
_WIDE_SHARE_NONLINEAR = 0.05 / 3.0
"""The same limit where elements were chosen, too: three standard deviations are then 5 %.  If two
standard deviations of each of 13 parameters might be 5 %, one car in four would be off by more."""
_PLAUSIBLE = {
    "total_mass": (200.0, 20_000.0),
    "front_ride_damping_ratio": (0.03, 1.2),
    "rear_ride_damping_ratio": (0.03, 1.2),
    "front_ride_frequency": (0.5, 5.0),
    "rear_ride_frequency": (0.5, 5.0),
    "front_wheel_hop_frequency": (5.0, 30.0),
    "rear_wheel_hop_frequency": (5.0, 30.0),
}
"""Limits far outside the values of road vehicles; a result beyond them has a wrong scale or
unit."""
_MEASURED = {"roll_gyration_over_track": (0.367, 0.512), "pitch_index": (0.816, 1.298)}
"""Least and largest value, whole vehicle, of 204 cars, vans and light trucks that were measured:
NHTSA Light Vehicle Inertial Parameter Database."""
_MARGIN = 0.1
"""Share by which a vehicle may exceed the range of measured ones: published data of small cars have
0.357 in roll."""
_WEAK = 0.1
"""Standard deviation of a parameter, as a share of it, above which its intervals are looked at
again."""
_REACH_SIGMAS, _REACH = 3.0, 1.0
"""Distance along the worst direction, in standard deviations and as a change of the logarithm."""
BELOW_SIGMAS = 3.0
"""Standard deviations below zero beyond which tyre damping, or a bar, is negative."""


def with_widest_intervals(estimation: Estimation) -> Estimation:
    """Return a linear estimation whose intervals do not depend on where the estimate happens to be.

    Where the runs hardly determine a parameter, the information changes within its interval, and
    a low estimate may look certain: the widest covariance along that direction counts.
    """
    names, covariance = estimation.box.parameters, estimation.fit.covariance
    std = np.sqrt(np.diag(covariance)[: len(names)])
    std[[name in SIGNED for name in names]] = 0.0
    std[~np.isfinite(std)] = 0.0
    worst = int(np.argmax(std))
    if not std[worst] > _WEAK or estimation.nonlinear is not None:
        return estimation
    step = np.where(np.isfinite(covariance[:, worst]), covariance[:, worst], 0.0) / std[worst]
    step *= min(_REACH_SIGMAS, _REACH / std[worst])
    best = estimation.fit
    for eta in (best.eta - step, best.eta + step):
        blocks = normal_blocks(estimation.box, estimation.decays, estimation.noise, eta)
        wider = covariance_of(np.sum([part.information for part in blocks.values()], axis=0))
        if wider[worst, worst] > best.covariance[worst, worst]:
            best = replace(best, covariance=wider)
    return replace(estimation, fit=best)


def undetermined(estimation: Estimation) -> tuple[str, ...]:
    """Return the parameters that the data must determine and do not.

    A parameter that may be zero (a bar, tyre damping) may stay undetermined, as long as its
    variance is finite: it is printed as not determined, and the others hold.
    """
    return tuple(
        name
        for name, e in estimates(estimation.box, estimation.fit).items()
        if not e.determined and (name not in SIGNED or not np.isfinite(e.std))
    )


def parameter_findings(estimation: Estimation) -> Iterator[Finding]:
    """Judge the estimates of the parameters."""
    vague = undetermined(estimation)
    if vague:
        text = f"these runs do not determine {', '.join(vague)}: {_advice(vague, estimation)}"
        yield Finding("undetermined", Severity.ERROR, text)
        return
    share = _WIDE_SHARE if estimation.nonlinear is None else _WIDE_SHARE_NONLINEAR
    known = estimates(estimation.box, estimation.fit)
    relative = {name: e.std / abs(e.value) for name, e in known.items() if name not in SIGNED}
    wide = {name: std for name, std in relative.items() if std > share}
    if wide:
        worst = max(wide, key=lambda name: wide[name])
        half = COVERAGE_95 * wide[worst]
        text = (
            f"wide intervals: {', '.join(wide)} (worst {worst} ± "
            f"{half_width_percent(1.0, 1.0 - half, 1.0 + half)}): add runs, a warp run first, "
            "heavier weights, or scales as facts"
        )
        yield Finding("wide", Severity.WARNING, text)
    yield from _implausible(estimation)
    yield from contradiction_findings(estimation)


def _advice(vague: tuple[str, ...], estimation: Estimation) -> str:
    """Return what to do; where nothing but the common scale is open, the weights were too light."""
    scaled = {n for n in estimation.box.parameters if n not in SIGNED and parameter_unit(n) != "m"}
    if set(vague) == scaled:
        return (
            "their ratios are known, but the added weights are too light to fix their scale: add "
            "heavier ones, or weigh the vehicle (total and front axle) and state the loads as facts"
        )
    if missing := missing_runs(estimation):
        return f"record {missing} runs in both mass states"
    return (
        "record bounce, pitch and roll (warp helps most) in both mass states, with sensors on body "
        "and wheels"
    )


def missing_runs(estimation: Estimation) -> str:
    """Return the kind of runs without which a campaign shows no car; nothing if it has them."""
    labels = [record.label for record in estimation.records]
    shares = [bump.shares for kind, bump in BUMPS.items() if any(f"_{kind}_" in n for n in labels)]
    if not any(fl != fr or rl != rr for fl, fr, rl, rr in shares):
        return "roll"
    return "" if any(fl != rl or fr != rr for fl, fr, rl, rr in shares) else "pitch"


def _implausible(estimation: Estimation) -> Iterator[Finding]:
    full = estimation.full.astype(complex)
    values = derived_quantities(full)
    odd = []
    for name, (low, high) in _PLAUSIBLE.items():
        quantity, unit = values[name]
        value, of = float(quantity.real), "" if unit == "1" else f" {unit}"
        if not low < value < high:
            odd.append(f"{name} {value:.3g}{of} (usual {low:g} .. {high:,g})")
    whole = whole_vehicle_indices(full)
    for name, (low, high) in _MEASURED.items():
        value = float(whole[name].real)
        if not low * (1.0 - _MARGIN) < value < high * (1.0 + _MARGIN):
            odd.append(f"{name} {value:.3g} (204 measured vehicles: {low:g} .. {high:g})")
    negative = {
        name: e
        for name, e in estimates(estimation.box, estimation.fit).items()
        if name in SIGNED and e.value < -BELOW_SIGMAS * e.std
    }
    solid = []
    for name, e in negative.items():
        axle = 2 * name.endswith("r")
        if name.startswith("c_t"):
            odd.append(f"{name} {e.value:.3g} {e.unit} below zero")
        # In roll an axle has the stiffness of its springs and twice that of its bar.
        elif name.startswith("k_a") and e.value < -0.5 * float(
            full[7 + axle : 9 + axle].real.mean()
        ):
            odd.append(f"{name} {e.value:.3g} N/m leaves the axle no stiffness in roll")
        elif name.startswith("k_a"):
            solid.append(f"{name} {e.value:,.0f} N/m")
    if odd:
        text = f"not a usual vehicle: {'; '.join(odd)}: check weights, units and positions"
        yield Finding("implausible", Severity.WARNING, text)
    if solid:
        text = (
            f"{', '.join(solid)} below zero: the springs act on a shorter lever in roll than in "
            "heave, as on a solid axle; this is not a fault"
        )
        yield Finding("solid_axle", Severity.NOTE, text)


# The fitted motion: how far each mode stands out of the noise, and wheels in the air --------------

SNR_LIMIT_DB = 20.0
"""A decaying wave whose energy is E times the noise shows its frequency to ``2 zeta / sqrt(E)``.
At 20 dB and a damping ratio of 0.25 that is 5 %: as much as the added masses shift a frequency,
from which all inertias follow."""
_AS_GOOD = 0.5  # of the strongest drive of a mode (6 dB); the more familiar run is preferred
_FLOOR = 1e-3  # of the noise; -30 dB stands for nothing
PULL_LIMIT = 0.1
"""Share of the static load that a tyre may seem to pull.  The start of the decay lies up to one
sample before the first that is fitted, and in that time a landing tyre gains as much."""
LANDING_LIMIT = 0.2
"""Share of the static load below which a tyre has just landed, for the same reason."""
LATE_S = 0.005
"""Delay after the stated end of the bump, s, above which a decay was not free before its start."""
_SURE = 3.0  # standard deviations
_STEP_S = 1e-3  # in which tyre loads are looked at
_LONGEST_S = 1.0  # wheels that have not lifted by then will not
_TYRES = slice(Full.K_T, Full.K_T + 4)  # their stiffnesses among the full parameters


def mode_snr_db(estimation: Estimation) -> dict[str, tuple[float, ...]]:
    """Return the energy of each mode in each run over the noise.

    The energy is that of the matched filter: the squares of the mode's share in every sample, in
    units of the noise, summed over all channels, as far as other modes cannot reproduce it.  A run
    that does not excite a mode has some 3 dB by the noise alone.

    Returns dB, in the order of `identify.modes.modal_model.modes_of` for the run's mass state.
    """
    model = linearised_at(estimation)
    return {
        decay.label: _snr_db_of_run(model.points[decay.mass_state], decay, linear)
        for decay, linear in zip(estimation.decays, model.linear, strict=True)
    }


def _snr_db_of_run(point: Evaluated, decay: FreeDecay, linear: LinearPart) -> tuple[float, ...]:
    """Return the energy of each mode in one run over the noise, dB, by frequency."""
    size = len(linear.solution)
    normal = np.zeros((size, size))
    for recording, product, stack in zip(
        decay.recordings, linear.products, linear.coefficients, strict=True
    ):
        weighted = stack * point.weights(recording.group)[:, None, None]
        normal += over_two(weighted, product.gram @ stack)
    modes = point.modes
    upper = np.flatnonzero(modes.poles.imag > 0.0)
    upper = upper[np.argsort(np.abs(modes.poles[upper]), kind="stable")]
    # To real and imaginary parts of the modal state; the channels' own unknowns stay as they are.
    T = np.eye(size)
    T[: 2 * N_DOF, : 2 * N_DOF] = modes.V.real
    T[: 2 * N_DOF, upper] = 2.0 * modes.V[:, upper].real
    T[: 2 * N_DOF, upper + 1] = -2.0 * modes.V[:, upper].imag
    normal = T.T @ normal @ T
    modal_state = modes.W @ linear.solution[: 2 * N_DOF]
    snr_db = []
    for k in upper.tolist():
        others = np.delete(np.arange(size), [k, k + 1])
        mixed = normal[k : k + 2, others]
        inverse = pseudo_inverse(normal[np.ix_(others, others)])
        alone = normal[k : k + 2, k : k + 2] - mixed @ inverse @ mixed.T
        parts = np.array([modal_state[k].real, modal_state[k].imag])
        snr_db.append(10.0 * float(np.log10(max(parts @ alone @ parts, _FLOOR))))
    return tuple(snr_db)


def excitation_findings(
    estimation: Estimation, snr_db: Mapping[str, tuple[float, ...]]
) -> Iterator[Finding]:
    """Name the modes that the runs of a mass state do not excite.

    The energies of its runs add up, as their information does.
    """
    full = estimation.full
    geometry = VehicleGeometry(*(float(length) for length in full[Full.A : Full.T_R + 1]))
    for state in estimation.box.mass_states:
        rows = [snr_db[d.label] for d in estimation.decays if d.mass_state == state.name]
        if not rows:
            continue
        total_db = 10.0 * np.log10(np.sum(10.0 ** (np.array(rows) / 10.0), axis=0))
        model = loaded_model(full, state.added)
        modes = modes_of(model.A)
        names = mode_names(modes, geometry)
        advised: dict[Excitation, list[str]] = {}
        for k in np.flatnonzero(total_db < SNR_LIMIT_DB).tolist():
            frequency = abs(modes.poles[k]) / (2.0 * np.pi)
            text = f"mode {k + 1} ({names[k]}, {frequency:.2f} Hz) with {total_db[k]:.0f} dB"
            advised.setdefault(best_run(model, modes.poles[k], full[_TYRES]), []).append(text)
        for run, texts in advised.items():
            text = (
                f"hardly excited in state {state.name}: {', '.join(texts)} in all its runs "
                f"together (limit {SNR_LIMIT_DB:.0f} dB); what depends on them is not known: "
                f"record a {run.words} run in state {state.name}, or one with a higher bump"
            )
            yield Finding("excitation", Severity.WARNING, text)


def best_run(model: PhysicalModel, pole: complex, tyre_n_m: NDArray[np.float64]) -> Excitation:
    """Return the kind of run that drives a mode, by the road's force on its left eigenvector.

    The first kind that drives it at least `_AS_GOOD` as much as the best.  `pole`, rad/s: of the
    mode.  `tyre_n_m`, (4,): stiffness of each tyre.
    """
    poles, right = np.linalg.eig(model.A)
    left_vector = np.linalg.inv(right)[int(np.argmin(np.abs(poles - pole)))]
    drive = {}
    for run, bump in BUMPS.items():
        force = np.concatenate([np.zeros(3), tyre_n_m * np.array(bump.shares)])
        drive[run] = abs(left_vector[N_DOF:] @ np.linalg.solve(model.M, force))
    strongest = max(drive.values())
    return next(run for run in Excitation if drive[run] >= _AS_GOOD * strongest)


def lift_off_findings(estimation: Estimation) -> Iterator[Finding]:
    """Yield a finding on the wheels that leave the road over the bump and land during the decay.

    A tyre would have to pull, or has only the load of a late landing.

    `estimation`: the fit; tyre loads follow from its parameters and the fitted initial state of
    each run.
    """
    full, model = estimation.full, linearised_at(estimation)
    tyres, states = full[_TYRES], {state.name: state for state in estimation.box.mass_states}
    # Least load, load at rest, N, delay of the decay's start after the bump, s, wheel and run.
    flying: list[tuple[float, float, float, str]] = []
    for record, decay, linear in zip(
        estimation.records, estimation.decays, model.linear, strict=True
    ):
        static = static_loads_n(loaded_model(full, states[decay.mass_state].added), tyres)
        least, sigma = least_loads_n(model.points[decay.mass_state], decay, linear, static, tyres)
        onset = onset_s(record)
        delay_s = np.nan if onset is None else decay.start_s - (onset + record.bump_s)
        limit = (LANDING_LIMIT if delay_s > LATE_S else -PULL_LIMIT) * static
        flying += [
            (float(least[i]), float(static[i]), delay_s, f"wheel {corner} in {decay.label}")
            for i, corner in enumerate(Corner)
            if least[i] < limit[i] - _SURE * sigma[i]
        ]
    if not flying:
        return
    load_n, static_n, *_ = min(flying)
    longest_s = float(np.nanmax([delay_s for *_, delay_s, _ in flying] + [0.0]))
    waited = ""
    if longest_s > LATE_S:
        waited = f", {longest_s * 1e3:.0f} ms after the bump at the latest"
    places = listed(place for *_, place in sorted(flying))
    text = (
        f"wheels lift off the road: least tyre load in the fitted decay {load_n:.0f} N (at rest "
        f"{static_n:.0f} N): {places}; the linear model holds only once they are down{waited}, "
        "when their motion has died away in part: use a lower bump"
    )
    yield Finding("lift_off", Severity.WARNING, text)


def static_loads_n(model: PhysicalModel, tyre_n_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the load under each wheel at rest on a flat road, (4,) N.

    Gravity acts as if everything were accelerated upwards by g, so its forces are a column of the
    mass matrix, added weights included; the springs distribute them.
    """
    heave = np.concatenate([[1.0, 0.0, 0.0], np.ones(4)])
    sag = np.linalg.solve(model.K, G_M_S2 * (model.M @ heave))
    return np.asarray(tyre_n_m * sag[3:])


def least_loads_n(
    point: Evaluated,
    decay: FreeDecay,
    linear: LinearPart,
    static_n: NDArray[np.float64],
    tyre_n_m: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least load of each wheel and its standard deviation by the noise, (4,) N each.

    `static_n`, `tyre_n_m`, (4,): load at rest, and stiffness, of each tyre.
    """
    last_s = max(float(r.time_s[-1]) for r in decay.recordings)
    time_s = np.arange(0.0, min(last_s, _LONGEST_S), _STEP_S)
    modes = point.modes
    state = linear.solution[: 2 * N_DOF]
    wave = np.exp(np.multiply.outer(time_s, modes.poles))
    wheels = slice(3, N_DOF)
    heave_m = ((wave * (modes.W @ state)) @ modes.V[wheels].T).real
    load_n = static_n - tyre_n_m * heave_m
    lowest = load_n.argmin(axis=0)
    # Change of each wheel's lowest load by the initial state, but for its sign.
    slopes = tyre_n_m[:, None] * ((modes.V[wheels] * wave[lowest]) @ modes.W).real
    covariance = linear.normal_inverse[: 2 * N_DOF, : 2 * N_DOF]
    return load_n.min(axis=0), np.sqrt(np.einsum("ij,jk,ik->i", slopes, covariance, slopes))
