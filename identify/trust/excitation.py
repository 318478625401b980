"""Excitation: how far each mode stands out of the noise in each run, and modes that no run excites.

The modes of a vehicle that is alike left and right move either both sides alike or against each
other: a bounce or pitch run shows no mode of the second kind.  That is normal as long as another
run does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from daq.bumps import BUMPS
from daq.runs import Excitation
from daq.vehicle import MassState, VehicleGeometry
from dbc.finding import Finding, Severity

from ..decays.decay import FreeDecay
from ..fit.estimation import Estimation, linearised_at
from ..fit.varpro import Evaluated, LinearPart, over_two, pseudo_inverse
from ..model.matrices import N_DOF, PhysicalModel, loaded_model
from ..modes.modal_model import modes_of
from ..modes.mode_names import mode_names

SNR_LIMIT_DB = 20.0
"""A decaying wave whose energy is E times the noise shows its frequency to ``2 zeta / sqrt(E)``.
At 20 dB and a damping ratio of 0.25 that is 5 %: as much as the added masses shift a frequency,
from which all inertias follow."""
_AS_GOOD = 0.5  # of the strongest drive of a mode (6 dB); the more familiar run is preferred
_FLOOR = 1e-3  # of the noise; -30 dB stands for nothing


def mode_snr_db(estimation: Estimation) -> dict[str, tuple[float, ...]]:
    """Return the energy of each mode in each run over the noise.

    The energy is that of the matched filter: the squares of the mode's share in every sample, in
    units of the noise, summed over all channels, as far as other modes cannot reproduce it.  A run
    that does not excite a mode has some 3 dB by the noise alone.

    Returns dB, in the order of `identify.modes.modal_model.modes_of` for the run's mass state.
    """
    there = linearised_at(estimation)
    return {
        decay.label: tuple(
            (10.0 * np.log10(_energies(there.points[decay.mass_state], decay, one))).tolist()
        )
        for decay, one in zip(estimation.decays, there.linear, strict=True)
    }


def excitation_findings(
    estimation: Estimation, snr_db: Mapping[str, tuple[float, ...]]
) -> tuple[Finding, ...]:
    """Name the modes that the runs of a mass state do not excite.

    The energies of its runs add up, as their information does.
    """
    present = {decay.mass_state for decay in estimation.decays}
    findings: list[Finding] = []
    for state in estimation.box.mass_states:
        if state.name in present:
            rows = [snr_db[d.label] for d in estimation.decays if d.mass_state == state.name]
            findings += _unexcited(estimation, state, 10.0 * np.log10(_sum_of_powers(rows)))
    return tuple(findings)


def _sum_of_powers(rows: list[tuple[float, ...]]) -> NDArray[np.float64]:
    return np.asarray(np.sum(10.0 ** (np.array(rows) / 10.0), axis=0))


def _unexcited(
    estimation: Estimation, state: MassState, total_db: NDArray[np.float64]
) -> Iterator[Finding]:
    box, eta = estimation.box, estimation.fit.eta
    full = box.full(eta.astype(complex)).real
    model = loaded_model(full, state.added)
    modes = modes_of(model.A)
    a, b, t_f, t_r = full[19:23].tolist()
    names = mode_names(modes, VehicleGeometry(a, b, t_f, t_r))
    advised: dict[Excitation, list[str]] = {}
    for k in np.flatnonzero(total_db < SNR_LIMIT_DB).tolist():
        frequency = abs(modes.poles[k]) / (2.0 * np.pi)
        text = f"mode {k + 1} ({names[k]}, {frequency:.2f} Hz) with {total_db[k]:.0f} dB"
        advised.setdefault(best_run(model, modes.poles[k], full[11:15]), []).append(text)
    for run, texts in advised.items():
        yield Finding(
            "excitation",
            Severity.WARNING,
            f"hardly excited in state {state.name}: {', '.join(texts)} in all its runs together "
            f"(limit {SNR_LIMIT_DB:.0f} dB); what depends on them is not known: record a "
            f"{run.words} run in state {state.name}, or one with a higher bump",
        )


def best_run(model: PhysicalModel, pole: complex, tyre_n_m: NDArray[np.float64]) -> Excitation:
    """Return the kind of run that drives a mode, by the road's force on its left eigenvector."""
    poles, right = np.linalg.eig(model.A)
    left = np.linalg.inv(right)[int(np.argmin(np.abs(poles - pole)))]
    gain = {}
    for run, bump in BUMPS.items():
        force = np.concatenate([np.zeros(3), tyre_n_m * np.array(bump.shares)])
        gain[run] = abs(left[N_DOF:] @ np.linalg.solve(model.M, force))
    strongest = max(gain.values())
    return next(run for run in Excitation if gain[run] >= _AS_GOOD * strongest)


def _energies(at: Evaluated, decay: FreeDecay, linear: LinearPart) -> NDArray[np.float64]:
    """Return the energy of each oscillating mode in units of the noise, in order of frequency."""
    size = len(linear.solution)
    normal = np.zeros((size, size))
    for recording, product, stack in zip(
        decay.recordings, linear.products, linear.coefficients, strict=True
    ):
        weighted = stack * at.weights(recording.group)[:, None, None]
        normal += over_two(weighted, product.gram @ stack)
    modes = at.modes
    upper = np.flatnonzero(modes.poles.imag > 0.0)
    upper = upper[np.argsort(np.abs(modes.poles[upper]), kind="stable")]
    # Real coordinates of the modes: initial state = T q, the channels' own unknowns as they are.
    T = np.eye(size)
    T[: 2 * N_DOF, : 2 * N_DOF] = modes.V.real
    T[: 2 * N_DOF, upper] = 2.0 * modes.V[:, upper].real
    T[: 2 * N_DOF, upper + 1] = -2.0 * modes.V[:, upper].imag
    q_normal = T.T @ normal @ T
    z = modes.W @ linear.solution[: 2 * N_DOF]
    own = upper[:, None] + np.arange(2)  # (n_modes, 2)
    others = [np.delete(np.arange(size), pair) for pair in own]
    rest = np.array(others, dtype=np.intp).reshape(-1, size - 2)
    mixed = q_normal[own[:, :, None], rest[:, None]]
    inverse = pseudo_inverse(q_normal[rest[:, :, None], rest[:, None]])
    alone = q_normal[own[:, :, None], own[:, None]] - mixed @ inverse @ mixed.swapaxes(1, 2)
    q = np.stack([z[upper].real, z[upper].imag], axis=1)
    return np.asarray(np.maximum(np.einsum("ki,kij,kj->k", q, alone, q), _FLOOR))
