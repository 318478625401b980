"""Figures for notebooks and scripts: each function returns a matplotlib figure.

They are the figures of the report.  Each raises InputError if the session was refused before a fit.
This module loads matplotlib, so `identify` does not import it.
"""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from dbc.words import InputError

from .modes.state_variable_method import StabilisationDiagram
from .report.cars import still_cars
from .report.evidence import decay_pictures
from .report.page import LOOK, figure_of
from .report.parameters import damper_picture, intervals_picture, moving_cars, stabilisation_picture
from .result import Identification


def decays(result: Identification) -> Figure:
    """Draw every run: measured against fitted, and the residuals in units of the noise."""
    estimation = _fitted(result).estimation
    assert estimation is not None  # there is a fit
    pictures = list(decay_pictures(estimation))
    title_in, height_in, down = 0.22, pictures[0].height_in, -(-len(pictures) // 2)
    with matplotlib.rc_context(dict(LOOK)):
        figure = Figure(figsize=(2 * pictures[0].width_in, down * (height_in + title_in)))
        heights = down * [title_in, height_in]
        parts = figure.subfigures(2 * down, 2, squeeze=False, height_ratios=heights)
        for number, picture in enumerate(pictures):
            row, column = divmod(number, 2)
            parts[2 * row, column].text(0.13, 0.1, picture.title, parse_math=False)
            picture.draw(parts[2 * row + 1, column])
    return figure


def parameters(result: Identification) -> Figure:
    """Draw the relative interval of each parameter, and the sources of its precision."""
    return figure_of(intervals_picture(_fitted(result)))


def dampers(result: Identification) -> Figure:
    """Draw the force of each axle's damper over its speed, with its 95 % band and with friction.

    Raises InputError if the linear model explains the decays.
    """
    forces = _fitted(result).forces
    if forces is None:
        reason = "there is no damper curve: the linear model explains the decays"
        raise InputError("plot", reason, "take c_sf and c_sr, or bump higher")
    return figure_of(damper_picture(forces))


def modes(result: Identification, mass_state: str = "baseline") -> Figure:
    """Draw the mode shapes of the identified vehicle.

    Raises InputError if the session has no such mass state.
    """
    if mass_state not in _fitted(result).modal:
        raise InputError("plot", f"no mass state {mass_state}", f"choose {', '.join(result.modal)}")
    return figure_of(still_cars(moving_cars(result, mass_state)))


def stabilisation(diagram: StabilisationDiagram) -> Figure:
    """Draw the poles of the State Variable Method over its rank.

    `diagram`: of `identify.stabilisation_diagram`.  Lines mark its stable modes of highest rank.
    """
    frequency_hz = np.abs(diagram.poles) / (2.0 * np.pi)
    vibrating = diagram.poles.imag > 0.0
    highest = diagram.rank == np.max(diagram.rank[diagram.stable], initial=0)
    modes_hz = frequency_hz[diagram.stable & vibrating & highest]
    return figure_of(stabilisation_picture("stabilisation", "", diagram, modes_hz))


def _fitted(result: Identification) -> Identification:
    """Return a result that has a fit."""
    if not result.parameters:
        reason = "; ".join(result.quality.reasons) or "refused"
        raise InputError("plot", f"there is no fit: {reason}", "identify a complete session")
    return result
