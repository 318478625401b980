"""Writes what was identified for other programs: the linear model, and damper curves as tables.

Inputs of the model are forces on the degrees of freedom, then height of the road under each wheel,
then its rate (which only a damped tyre feels).  Outputs are displacement, rate and acceleration of
each degree of freedom, then the travel of each suspension.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.files import write_named
from dbc import InputError

if TYPE_CHECKING:
    from identify import Identification

MODEL_ENDINGS = (".mat",)
DAMPER_ENDINGS = (".csv", ".mat")
_CURVES = (
    "speed_m_s", "force_n", "force_low_n", "force_high_n", "total_n", "total_low_n", "total_high_n",
)  # fmt: skip
"""Columns of a damper's table; the first ascends."""


@dataclass(frozen=True, slots=True)
class StateSpace:
    """dx/dt = A x + B u, y = C x + D u of one mass state."""

    A: Any
    """State matrix; states are the displacements of `daq.vehicle.DOF`, then their rates."""
    B: Any
    C: Any
    D: Any
    inputs: tuple[str, ...]
    """Names with their units."""
    outputs: tuple[str, ...]
    """Names with their units."""


def write_model(result: Identification, path: Path) -> None:
    """Write M, C, K and the state space of each mass state, and the parameters, for MATLAB.

    Raises InputError if a parameter is not determined, or the file cannot be written.
    """
    import numpy as np

    vague = result.undetermined
    if result.quality.verdict == "refused" or not result.physical or vague:
        why = f"not determined: {', '.join(vague)}" if vague else "the identification is refused"
        advice = "see the result of identify for the session"
        raise InputError(str(path), f"not written: {why}", advice)
    content: dict[str, Any] = {
        "parameters": {name: one.value for name, one in result.parameters.items()},
        "covariance": result.document()["covariance"]["matrix"],
    }
    for state, model in result.physical.items():
        space = state_space(result, state)
        matrices = {name: getattr(space, name) for name in "ABCD"}
        content[state] = {"M": model.M, "C_damping": model.C, "K": model.K, **matrices}
        content["inputs"] = np.array(space.inputs, dtype=object)
        content["outputs"] = np.array(space.outputs, dtype=object)
    write_named(path, _mat(content))


def state_space(result: Identification, state: str) -> StateSpace:
    """Return the state space of a mass state."""
    import numpy as np

    from daq.vehicle import DOF, Corner

    model, n = result.physical[state], len(DOF)
    # If the whole car is lifted equally, only the tyres pull back, each at its wheel.
    lifted = np.array([1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])  # as DOF: heave, pitch, roll, wheels
    tyre, tyre_damping = (np.diag(matrix @ lifted)[:, 3:] for matrix in (model.K, model.C))
    acceleration = np.linalg.solve(model.M, np.hstack([np.eye(n), tyre, tyre_damping]))
    entry = np.vstack([np.zeros_like(acceleration), acceleration])  # (14, 15), of the inputs
    value = {name: estimate.value for name, estimate in result.parameters.items()}
    travel = np.zeros((4, 2 * n))  # from the state: the wheel minus the body above it
    for i, corner in enumerate(Corner):
        x, half = (value["a"], value["t_f"]) if corner.front else (-value["b"], value["t_r"])
        y = corner.side * half - value.get("y_s", 0.0)
        travel[i, :3] = -1.0, x, -y
        travel[i, 3 + i] = 1.0
    units = [(str(dof), "rad" if i in (1, 2) else "m") for i, dof in enumerate(DOF)]
    return StateSpace(
        A=model.A,
        B=entry,
        C=np.vstack([np.eye(2 * n), model.A[n:], travel]),
        D=np.vstack([np.zeros_like(entry), acceleration, np.zeros((4, entry.shape[1]))]),
        inputs=(
            *(f"force on {name} [{'N m' if unit == 'rad' else 'N'}]" for name, unit in units),
            *(f"road under {corner} [m]" for corner in Corner),
            *(f"rate of the road under {corner} [m/s]" for corner in Corner),
        ),
        outputs=(
            *(f"{name} [{unit}]" for name, unit in units),
            *(f"rate of {name} [{unit}/s]" for name, unit in units),
            *(f"acceleration of {name} [{unit}/s2]" for name, unit in units),
            *(f"travel {corner} [m]" for corner in Corner),
        ),
    )


def write_damper_table(result: Identification, path: Path) -> None:
    """Write the damper curves of both axles, of one corner, compression positive, SI.

    `.csv` has a row for each axle and speed; `.mat` (MATLAB v5) the matrices `front` and `rear`,
    the names of their `columns`, and the other force elements of each axle.

    Raises InputError if the identification has no damper curves, or the file cannot be written.
    """
    import numpy as np

    if result.forces is None:
        reason = "not written: the linear model explains the decays, so there is no damper curve"
        raise InputError(str(path), reason, "take c_sf and c_sr, or bump higher")
    tables = {}
    for one in result.forces.axles:
        curve = one.damper
        columns = (curve.force_n, *curve.band_n, curve.total_n, *curve.total_band_n)
        tables[one.axle] = np.column_stack([curve.speed_m_s, *columns])
    if path.suffix.lower() == ".mat":
        content: dict[str, Any] = {**tables, "columns": np.array(_CURVES, dtype=object)}
        for one in result.forces.axles:
            determined = {name: e.value for name, e in one.values.items() if e.determined}
            content[f"{one.axle}_elements"] = determined
        write_named(path, _mat(content))
        return
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["axle", *_CURVES])
    for axle, table in tables.items():
        writer.writerows([axle, *(f"{value:.6g}" for value in row)] for row in table)
    write_named(path, text.getvalue().encode())


def _mat(content: dict[str, Any]) -> bytes:
    from scipy.io import savemat

    data = BytesIO()
    savemat(data, content, long_field_names=True, oned_as="column")
    return data.getvalue()
