"""Figures for notebooks and scripts: each function returns a matplotlib figure.

They are the figures of the report.  This module loads matplotlib, so `identify` does not import it.
"""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from dbc.errors import InputError

from .modes.state_variable_method import StabilisationDiagram
from .report.blocks import Picture
from .report.cars import shape_of, still_cars
from .report.dampers import damper_picture
from .report.decays import decay_drawing, decay_traces
from .report.evidence import correlation_drawing
from .report.figure import figure_of, look
from .report.modes import mode_text, stabilisation_drawing
from .report.parameters import parameter_section
from .result import Identification

_ACROSS = 2
_TITLE_IN = 0.22


def decays(result: Identification) -> Figure:
    """Draw every run: measured against fitted, and the residuals in units of the noise.

    Raises InputError if the session was refused before a fit.
    """
    estimation = _fitted(result).estimation
    assert estimation is not None  # there is a fit
    runs = decay_traces(estimation)
    first = decay_drawing(runs[0])
    width, height = first.width_in, first.height_in
    down = -(-len(runs) // _ACROSS)
    with matplotlib.rc_context(look()):
        figure = Figure(figsize=(_ACROSS * width, down * (height + _TITLE_IN)))
        parts = figure.subfigures(
            2 * down, _ACROSS, squeeze=False, height_ratios=down * [_TITLE_IN, height]
        )
        for number, run in enumerate(runs):
            row, column = divmod(number, _ACROSS)
            parts[2 * row, column].text(0.13, 0.1, run.label, parse_math=False)
            decay_drawing(run).draw(parts[2 * row + 1, column])
    return figure


def parameters(result: Identification) -> Figure:
    """Draw the relative interval of each parameter, and the sources of its precision.

    Raises InputError if the session was refused before a fit.
    """
    blocks = parameter_section(_fitted(result).document()).blocks
    return figure_of(next(block.drawing for block in blocks if isinstance(block, Picture)))


def dampers(result: Identification) -> Figure:
    """Draw the force of each axle's damper over its speed, with its 95 % band and with friction.

    Raises InputError if the session was refused before a fit, or the linear model explains its
    decays.
    """
    forces = _fitted(result).forces
    if forces is None:
        what = "there is no damper curve: the linear model explains the decays"
        raise InputError("plot", what, "take c_sf and c_sr, or bump higher")
    return figure_of(damper_picture(forces).drawing)


def correlation(result: Identification) -> Figure:
    """Draw the correlation of the parameters' errors.

    Raises InputError if the session was refused before a fit.
    """
    known = _fitted(result).correlation
    return figure_of(correlation_drawing(known.names, known.matrix))


def modes(result: Identification, mass_state: str = "baseline") -> Figure:
    """Draw the mode shapes of the identified vehicle.

    `result`: with a fit.  Raises InputError if the session was refused before a fit, or has no such
    mass state.
    """
    if mass_state not in _fitted(result).modal:
        raise InputError("plot", f"no mass state {mass_state}", f"choose {', '.join(result.modal)}")
    model = result.modal[mass_state]
    shapes = (
        shape_of(name, mode_text(known), mode.frequency_hz, mode.shape, result.geometry)
        for name, mode, known in zip(
            result.mode_names[mass_state], model.modes, result.modes[mass_state], strict=True
        )
    )
    return figure_of(still_cars(tuple(shapes)))


def stabilisation(diagram: StabilisationDiagram) -> Figure:
    """Draw the poles of the State Variable Method over its rank.

    `diagram`: of `identify.stabilisation_diagram`.
    """
    frequency_hz = np.abs(diagram.poles) / (2.0 * np.pi)
    vibrating = diagram.poles.imag > 0.0
    highest = diagram.rank == np.max(diagram.rank[diagram.stable], initial=0)
    modes_hz = frequency_hz[diagram.stable & vibrating & highest]
    return figure_of(stabilisation_drawing(diagram, modes_hz))


def _fitted(result: Identification) -> Identification:
    if not result.parameters:
        what = "; ".join(result.quality.reasons) or "refused"
        raise InputError("plot", f"there is no fit: {what}", "identify a complete session")
    return result
