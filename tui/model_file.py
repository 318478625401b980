"""Writes the identified model for other programs: MATLAB, python-control, Modelica, JSON.

Inputs are forces on the degrees of freedom, then height of the road under each wheel, then its rate
(which only a damped tyre feels).  Outputs are displacement, rate and acceleration of each degree of
freedom, then the travel of each suspension.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.files import write_named
from dbc import InputError

from .diagnostics import require_ending

if TYPE_CHECKING:
    from identify import Identification


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
    """Write the identified model in the format of the path's ending.

    `.mat` has M, C, K and the state space of each mass state; `.py` makes systems of
    python-control, `.mo` a Modelica block of the first mass state; `.json` has M, C and K with the
    parameters and their covariance.  Raises InputError if nothing is identified, the ending is
    another, or the file cannot be written.
    """
    require_ending(path, "model", MODEL_WRITERS)
    lost = [name for name, one in result.parameters.items() if not one.determined]
    if result.quality.verdict == "refused" or not result.physical or lost:
        why = f"not determined: {', '.join(lost)}" if lost else "the identification is refused"
        raise InputError(
            str(path), f"not written: {why}", "see the result of identify for the session"
        )
    write_named(path, MODEL_WRITERS[path.suffix.lower()](result))


def state_space(result: Identification, state: str) -> StateSpace:
    """Return the state space of a mass state."""
    import numpy as np

    from daq.vehicle import DOF, Corner

    model, n = result.physical[state], len(DOF)
    # If the whole car is lifted equally, only the tyres pull back, each at its wheel.
    lifted = np.array([1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    tyre, tyre_damping = (np.diag(matrix @ lifted)[:, 3:] for matrix in (model.K, model.C))
    force = np.linalg.solve(model.M, np.hstack([np.eye(n), tyre, tyre_damping]))
    entry = np.vstack([np.zeros_like(force), force])
    lengths = {name: result.parameters[name].value for name in ("a", "b")}
    half = [_length(result, name, side) for name in ("t_f", "t_r") for side in (1.0, -1.0)]
    travel = np.zeros((4, 2 * n))
    for i, corner in enumerate(Corner):
        x = lengths["a"] if corner.front else -lengths["b"]
        travel[i, :3] = -1.0, x, -half[i]
        travel[i, 3 + i] = 1.0
    names = [f"{dof}" for dof in DOF]
    forces = [f"force on {name} [{'N m' if i in (1, 2) else 'N'}]" for i, name in enumerate(names)]
    roads = [f"road under {corner} [m]" for corner in Corner]
    rates = [f"rate of the road under {corner} [m/s]" for corner in Corner]
    units = ["rad" if i in (1, 2) else "m" for i in range(n)]
    moved = [f"{name} [{u}]" for name, u in zip(names, units, strict=True)]
    moved += [f"rate of {name} [{u}/s]" for name, u in zip(names, units, strict=True)]
    moved += [f"acceleration of {name} [{u}/s2]" for name, u in zip(names, units, strict=True)]
    return StateSpace(
        A=model.A,
        B=entry,
        C=np.vstack([np.eye(2 * n), model.A[n:], travel]),
        D=np.vstack([np.zeros_like(entry), force, np.zeros((4, entry.shape[1]))]),
        inputs=(*forces, *roads, *rates),
        outputs=(*moved, *(f"travel {corner} [m]" for corner in Corner)),
    )


def _length(result: Identification, name: str, side: float) -> float:
    """Return the place of a spring, m to the left of the CG."""
    middle = result.parameters.get("y_s")
    return side * result.parameters[name].value - (middle.value if middle else 0.0)


def _matlab(result: Identification) -> bytes:
    import numpy as np
    from scipy.io import savemat

    states = {}
    for state, model in result.physical.items():
        space = state_space(result, state)
        states[state] = {
            "M": model.M,
            "C_damping": model.C,
            "K": model.K,
            **{name: getattr(space, name) for name in "ABCD"},
        }
        names = {
            "inputs": np.array(space.inputs, dtype=object),
            "outputs": np.array(space.outputs, dtype=object),
        }
    data = BytesIO()
    content = {
        **states,
        **names,
        "parameters": {name: one.value for name, one in result.parameters.items()},
        "covariance": result.document()["covariance"]["matrix"],
    }
    savemat(data, content, long_field_names=True, oned_as="column")
    return data.getvalue()


def _python(result: Identification) -> bytes:
    """Return a script; `repr` of a float is read back to the same number."""
    lines = ['"""State space of an identified vehicle for python-control; SI."""', ""]
    lines += ["import control", "", "systems = {}"]
    for state in result.physical:
        space = state_space(result, state)
        lines.append(f"systems[{state!r}] = control.ss(")
        lines += [f"    {getattr(space, name).tolist()!r}," for name in "ABCD"]
        lines.append(f"    inputs={list(space.inputs)!r},")
        lines.append(f"    outputs={list(space.outputs)!r},")
        lines.append(")")
    return ("\n".join(lines) + "\n").encode()


def _modelica(result: Identification) -> bytes:
    state = next(iter(result.physical))
    space = state_space(result, state)

    def matrix(rows: Any) -> str:
        return "{" + ",\n    ".join(_braced(map(repr, row)) for row in rows.tolist()) + "}"

    lines = [
        f'block IdentifiedVehicle "Linear vehicle, mass state {state}; SI"',
        "  extends Modelica.Blocks.Continuous.StateSpace(",
        ",\n".join(f"  {name} = {matrix(getattr(space, name))}" for name in "ABCD"),
        "  );",
        f"  constant String inputNames[{len(space.inputs)}] ="
        f" {_braced(map(_quoted, space.inputs))};",
        f"  constant String outputNames[{len(space.outputs)}] ="
        f" {_braced(map(_quoted, space.outputs))};",
        "end IdentifiedVehicle;",
    ]
    return ("\n".join(lines) + "\n").encode()


def _braced(items: Any) -> str:
    return "{" + ", ".join(items) + "}"


def _quoted(text: str) -> str:
    return f'"{text}"'


def _json(result: Identification) -> bytes:
    from daq.vehicle import DOF

    whole = result.document()
    document = {
        "degrees_of_freedom": list(DOF),
        "mass_states": whole["matrices"],
        "parameters": {name: one.value for name, one in result.parameters.items()},
        "covariance": whole["covariance"],
        "verdict": whole["verdict"],
        "provenance": {
            name: text
            for name, text in result.provenance.items()
            if name not in ("dbc", "bench_toml")
        },
    }
    return (json.dumps(document, indent=1) + "\n").encode()


MODEL_WRITERS: dict[str, Callable[[Identification], bytes]] = {
    ".mat": _matlab,
    ".py": _python,
    ".mo": _modelica,
    ".json": _json,
}
"""Makes the content of a file, by its ending."""
