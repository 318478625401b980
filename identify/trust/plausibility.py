"""Finds parameters that are undetermined, or impossible for a usual vehicle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from daq.bumps import BUMPS
from daq.vehicle import VehicleGeometry, parameter_unit
from dbc.words import Finding, Severity

from ..fit.estimation import Estimation, linearised_at
from ..fit.grey_box import SIGNED
from ..fit.likelihood import covariance_of, normal_blocks
from ..fit.uncertainty import COVERAGE_95, estimates
from ..fit.varpro import LinearPart
from ..model.exponentials import Spectrum
from ..model.matrices import N_DOF, Full, derived_quantities, loaded_model, whole_vehicle_indices
from ..modes.modal_model import mode_names, modes_of
from ..numbers import half_width_percent
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
    odd, solid = [], []
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
    for name, e in estimates(estimation.box, estimation.fit).items():
        if name not in SIGNED or e.value >= -BELOW_SIGMAS * e.std:
            continue
        axle = Full.K_S + 2 * name.endswith("r")
        # In roll an axle has the stiffness of its springs and twice that of its bar.
        if name.startswith("k_a") and e.value >= -0.5 * float(full[axle : axle + 2].real.mean()):
            solid.append(f"{name} {e.value:,.0f} N/m")
        elif name.startswith("k_a"):
            odd.append(f"{name} {e.value:.3g} N/m leaves the axle no stiffness in roll")
        elif name.startswith("c_t"):
            odd.append(f"{name} {e.value:.3g} {e.unit} below zero")
    if odd:
        text = f"not a usual vehicle: {'; '.join(odd)}: check weights, units and positions"
        yield Finding("implausible", Severity.WARNING, text)
    if solid:
        text = (
            f"{', '.join(solid)} below zero: the springs act on a shorter lever in roll than in "
            "heave, as on a solid axle; this is not a fault"
        )
        yield Finding("solid_axle", Severity.NOTE, text)


# How far each mode stands out of the noise -------------------------------------------------------

SNR_LIMIT_DB = 20.0
"""A decaying wave whose energy is E times the noise shows its frequency to ``2 zeta / sqrt(E)``.
At 20 dB and a damping ratio of 0.25 that is 5 %: as much as the added masses shift a frequency,
from which all inertias follow."""
_FLOOR = 1e-3  # of the noise; -30 dB stands for nothing


def mode_snr_db(estimation: Estimation) -> dict[str, tuple[float, ...]]:
    """Return the energy of each mode in each run over the noise.

    The energy is that of the matched filter: the squares of the mode's share in every sample, in
    units of the noise, summed over all channels, as far as other modes cannot reproduce it.  A run
    that does not excite a mode has some 3 dB by the noise alone.

    Returns dB, in the order of `identify.modes.modal_model.modes_of` for the run's mass state.
    """
    model = linearised_at(estimation)
    return {
        decay.label: _snr_db_of_run(model.points[decay.mass_state].modes, linear)
        for decay, linear in zip(estimation.decays, model.linear, strict=True)
    }


def _snr_db_of_run(modes: Spectrum, linear: LinearPart) -> tuple[float, ...]:
    """Return the energy of each mode in one run over the noise, dB, by frequency."""
    state = linear.solution[: 2 * N_DOF]
    covariance = linear.normal_inverse[: 2 * N_DOF, : 2 * N_DOF]
    upper = np.flatnonzero(modes.poles.imag > 0.0)
    snr_db = []
    for k in upper[np.argsort(np.abs(modes.poles[upper]), kind="stable")].tolist():
        rows = np.array([modes.W[k].real, modes.W[k].imag])  # from the state to the mode's share
        share = rows @ state
        energy = float(share @ np.linalg.pinv(rows @ covariance @ rows.T, hermitian=True) @ share)
        snr_db.append(10.0 * float(np.log10(max(energy, _FLOOR))))
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
        modes = modes_of(loaded_model(full, state.added).A)
        weak: dict[str, list[str]] = {}
        """Modes that are not excited, by the kind of run that excites them."""
        for k, name in enumerate(mode_names(modes, geometry)):
            if total_db[k] < SNR_LIMIT_DB:
                frequency_hz = abs(modes.poles[k]) / (2.0 * np.pi)
                text = f"mode {k + 1} ({name}, {frequency_hz:.2f} Hz) with {total_db[k]:.0f} dB"
                weak.setdefault(_exciting_run(name), []).append(text)
        for run, texts in weak.items():
            text = (
                f"hardly excited in state {state.name}: {', '.join(texts)} in all its runs "
                f"together (limit {SNR_LIMIT_DB:.0f} dB); what depends on them is not known: "
                f"record a {run} run in state {state.name}, or one with a higher bump"
            )
            yield Finding("excitation", Severity.WARNING, text)


def _exciting_run(mode_name: str) -> str:
    """Return the kind of run that excites a mode of this name."""
    if "roll" in mode_name or "antisym" in mode_name:
        return "roll"
    return "pitch" if "pitch" in mode_name else "bounce"
