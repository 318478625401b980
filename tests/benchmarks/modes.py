"""Our modes beside python-control's ERA and pyOMA2's SSI-dat, on the same noisy free decays.

A car's seven modes from three runs, and 25 close modes of a frame from 74 blows at random places.

The peers are helped: they know the order, their channels are scaled by the true noise, and an
oracle picks those of their poles that are nearest to the truth.  Ours finds the seven modes itself.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from importlib import import_module

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from daq.runs import BASELINE
from daq.vehicle import FORD_GRANADA
from identify.model.matrices import physical_model
from identify.modes.modal_model import ModalModel, mac, modes_of
from identify.modes.mode_selection import identify_modes
from identify.modes.state_variable_method import realised_modes

from ..identify.bumps import paper_records
from ..identify.modal_bound import unstructured_bound
from ..identify.structures import struck_frame

RATE_HZ = 200.0
SEEDS = 5
ORDER = 14
FRAME_HZ, FRAME_MODES, FRAME_RECORDS = 512.0, 25, 74
FRAME_NEAR = 1e-3
"""Relative error of a frequency up to which a mode counts as found: a third of what is between the
two that are 0.37 Hz apart."""
TRUTH = modes_of(physical_model(FORD_GRANADA).A)

Decays = list[NDArray[np.float64]]


def main() -> None:
    """Print errors relative to the Cramer-Rao bound, CPU times and their ratios."""
    campaigns = [_decays(seed) for seed in range(SEEDS)]
    bound = unstructured_bound(RATE_HZ, 30.0)
    print(f"modes of 3 runs x 7 channels x 2.7 s at {RATE_HZ:.0f} Hz, 30 dB, {SEEDS} seeds")
    print("  rms error / Cramer-Rao bound of f1..f7 | zeta1..zeta7 (lost: no pole near)")
    own = _row("bumpbench, no oracle", lambda d: identify_modes(d, RATE_HZ), campaigns, bound)
    _row("bumpbench ERA", lambda d: realised_modes(d, RATE_HZ, ORDER), campaigns, bound)
    peers = {f"python-control ERA, {m} rows": _control_era(m) for m in (50, 100, 200)}
    peers |= {f"pyOMA2 SSI-dat, {br} rows": _oma_ssi(br) for br in (12, 25)}
    for name, peer in peers.items():
        spent = _row(name, peer, campaigns, bound)
        print(f"    CPU time ratio {spent / own:.1f}")
    _frame()


def _frame() -> None:
    """Print how many of a frame's modes are found from many records, and what else."""
    records, poles = struck_frame(FRAME_MODES, FRAME_RECORDS, 0)
    truth = np.sort(np.abs(poles)) / (2.0 * np.pi)
    print(f"\n{FRAME_MODES} modes of a frame, {FRAME_RECORDS} records x 3 channels x 2 s at 512 Hz")
    peers: dict[str, Callable[[Decays], ModalModel]] = {
        "bumpbench, no oracle": lambda d: identify_modes(d, FRAME_HZ),
        "bumpbench ERA, order known": lambda d: realised_modes(d, FRAME_HZ, 2 * FRAME_MODES),
        "python-control ERA, 64 rows": _control_era(64, 2 * FRAME_MODES, FRAME_HZ),
        "pyOMA2 SSI-dat, 25 rows": _oma_ssi(25, 2 * FRAME_MODES, FRAME_HZ),
    }
    for name, identify in peers.items():
        began = time.process_time()
        try:
            found = identify(records)
        except MemoryError:
            print(f"  {name:28s} needs more memory than this machine has")
            continue
        spent = time.process_time() - began
        inside = found.frequencies_hz[
            (found.frequencies_hz > 20.0) & (found.frequencies_hz < 235.0)
        ]
        off = np.abs(truth[:, None] / inside - 1.0)
        true, mine = linear_sum_assignment(off)
        near = off[true, mine] < FRAME_NEAR
        rms = float(np.sqrt(np.mean(off[true, mine][near] ** 2))) if near.any() else np.inf
        print(
            f"  {name:28s} {near.sum():2d} found, {len(inside) - near.sum():2d} more in the band,"
            f" rms error {rms:.1e}  CPU {spent:.1f} s"
        )


def _decays(seed: int) -> Decays:
    records = paper_records(RATE_HZ, 30.0, seed)
    return [
        record.decay(0.3 + 1e-9).recordings[0].values
        for record in records
        if record.mass_state == BASELINE
    ]


def _row(
    name: str,
    identify: Callable[[Decays], ModalModel],
    campaigns: Sequence[Decays],
    bound: NDArray[np.float64],
) -> float:
    """Print a row and return the CPU time of one identification, s."""
    errors, seconds = [], []
    for decays in campaigns:
        began = time.process_time()
        found = identify(decays)
        seconds.append(time.process_time() - began)
        errors.append(_errors(found))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / bound
    text = [f"{r:5.1f}" if r < 99.0 else " lost" for r in ratio]
    print(f"  {name:28s} {' '.join(text[:7])} | {' '.join(text[7:])}  CPU {min(seconds):.3f} s")
    return min(seconds)


def _errors(found: ModalModel) -> NDArray[np.float64]:
    """Return relative errors of the frequencies and damping ratios of the nearest poles, (14,)."""
    distance = np.abs(found.poles - TRUTH.poles[:, None]) / 10.0
    unlike = 1.0 - mac(TRUTH.shapes, found.shapes / found.poles**2)
    true, mine = linear_sum_assignment(distance + unlike)
    errors = np.full((2, 7), np.inf)
    errors[0, true] = found.frequencies_hz[mine] / TRUTH.frequencies_hz[true] - 1.0
    errors[1, true] = found.damping_ratios[mine] / TRUTH.damping_ratios[true] - 1.0
    return errors.ravel()


def _noise(decays: Decays) -> NDArray[np.float64]:
    return np.asarray(np.std([decay[-100:] for decay in decays], axis=(0, 1)))


def _continuous(
    z: NDArray[np.complex128], shapes: NDArray[np.complex128], rate_hz: float
) -> ModalModel:
    poles = np.log(z.astype(complex)) * rate_hz
    return ModalModel(poles[poles.imag > 0.0], shapes[:, poles.imag > 0.0])


def _control_era(
    rows: int, order: int = ORDER, rate_hz: float = RATE_HZ
) -> Callable[[Decays], ModalModel]:
    """Return ERA with the runs as inputs."""
    control = import_module("control")

    def identify(decays: Decays) -> ModalModel:
        noise = _noise(decays)
        outputs = np.stack(decays, axis=-1).transpose(1, 2, 0) / noise[:, None, None]
        columns = outputs.shape[2] - rows - 1
        system, _ = control.eigensys_realization(
            outputs, order, m=rows, n=columns, dt=1.0 / rate_hz
        )
        z, vectors = np.linalg.eig(system.A)
        return _continuous(z, noise[:, None] * (system.C @ vectors), rate_hz)

    return identify


def _oma_ssi(
    rows: int, order: int = ORDER, rate_hz: float = RATE_HZ
) -> Callable[[Decays], ModalModel]:
    """Return data-driven SSI with the runs as further channels, at twice the order."""
    logging.disable(logging.INFO)
    algorithms, setups = import_module("pyoma2.algorithms"), import_module("pyoma2.setup")

    def identify(decays: Decays) -> ModalModel:
        noise = _noise(decays)
        setup = setups.SingleSetup(np.hstack([decay / noise for decay in decays]), fs=rate_hz)
        # Its own limits on damping and phase would leave none of a vehicle's modes.
        anything = {"xi_max": 1.0, "mpc_lim": 0.0, "mpd_lim": 1.0, "CoV_max": 1.0}
        ssi = algorithms.SSI(
            name="ssi", method="dat", br=rows, ordmax=2 * order, step=2, hc=anything
        )
        setup.add_algorithms(ssi)
        setup.run_by_name("ssi")
        z, vectors = np.linalg.eig(ssi.result.A[-1])
        shapes = (ssi.result.C[-1] @ vectors).reshape(len(decays), len(noise), -1)
        strongest = np.argmax(np.linalg.norm(shapes, axis=1), axis=0)
        return _continuous(z, noise[:, None] * shapes[strongest, :, np.arange(len(z))].T, rate_hz)

    return identify


if __name__ == "__main__":
    main()
