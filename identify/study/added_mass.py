"""Figures 2 to 7 of the paper: the size of the added mass, and the effect of an error in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES

from ..model.matrices import delta_mass, physical_model
from ..modes.modal_model import modes_of
from ..modes.pairing import pair_modes
from ..paper.physical_matrices import physical_matrices, state_matrix_of
from ..paper.sequential import sequential_vehicle
from .campaign import PAPER_ADDED_MASS
from .result import Column, Curve, CurvePanel, Study, percent

ERRORS_PERCENT = tuple(float(e) for e in range(-5, 6))
"""Errors on the abscissa of Figs. 3 to 8, %."""

_ADDED_PERCENT = tuple(float(share) for share in range(2, 15, 2))
_DYNAMIC = PARAMETER_NAMES[5:11]
_GEOMETRY = PARAMETER_NAMES[11:]


@dataclass(frozen=True, slots=True)
class MassError:
    """One of Figs. 3 to 7."""

    quantity: str
    """Name of the wrong added inertia."""
    dofs: tuple[int, ...]
    """Its positions on the diagonal of the added mass."""
    says: tuple[str, ...]
    """Values that the paper reads off its figure, and ours."""


_ONE_AXIS = (
    "Paper: no dynamic parameter moves, only {0}, from 2.4 to -2.6 %. Ours: +2.5 to -2.5 %; with"
    " the error that its Wilson-theta simulation makes anyway (Table 2: a -0.141 %) that is 2.4"
    " to -2.6 %."
)
_WHEELS = (
    "Paper: all parameters move, by 5.6 % at most, the tyres' more than the suspension's. Ours: {0}"
    " moves most, by {1} % ({2} % if e were counted as a share of what is stated, not of what is on"
    " board)."
)
MASS_ERRORS: Mapping[str, MassError] = MappingProxyType(
    {
        "fig3": MassError(
            "dm_s",
            (0,),
            (
                "Paper: k_sf, k_sr, c_sf and c_sr fall from about 4 to -4 %, the geometry rises"
                " from about -5 to 5 %, the tyres hardly move. Ours: 3.6 to 4.4 % at the ends,"
                " a -4.8 to 5.2 %, the other lengths less, tyres below 0.5 %.",
            ),
        ),
        "fig4": MassError("dI_yy", (1,), (_ONE_AXIS.format("a and b"),)),
        "fig5": MassError("dI_xx", (2,), (_ONE_AXIS.format("t_f and t_r"),)),
        "fig6": MassError("dm_uf", (3, 4), (_WHEELS.format("k_tf", "5.3", "5.6"),)),
        "fig7": MassError("dm_ur", (5, 6), (_WHEELS.format("k_tr", "5.4", "5.7"),)),
    }
)
_CONVENTION = (
    "Error e: the identification is given (1 - e) times what is on board. Row i of M, C and K is"
    " then (1 - e) times its true self, so K is no longer symmetric and least squares settles"
    " between its two halves."
)


def fig2_study() -> Study:
    """Return the shift of the modes when the mass grows by 2 to 14 % (Fig. 2).

    The added mass is that share of M itself, so that an undamped frequency would fall as
    ``1 / sqrt(1 + share)``; dampers make some modes fall more and some less.
    """
    vehicle = physical_model(FORD_GRANADA)
    before = modes_of(vehicle.A)
    frequency, damping = [], []
    for share in _ADDED_PERCENT:
        after = modes_of(vehicle.with_mass(share / 100.0 * vehicle.M).A)
        partner = pair_modes(before, after).added  # wheel modes change places at 12 %
        frequency.append(percent(after.frequencies_hz[partner], before.frequencies_hz))
        damping.append(percent(after.damping_ratios[partner], before.damping_ratios))
    by_mode = np.array(frequency).T
    columns = (
        Column("mode", "mode", "d"),
        Column("frequency_hz", "f / Hz", ".3f"),
        *(Column(f"at_{share:g}_percent", f"{share:g} %") for share in _ADDED_PERCENT),
    )
    rows = tuple(
        (number, *row)
        for number, row in enumerate(np.column_stack([before.frequencies_hz, by_mode]).tolist(), 1)
    )
    return Study(
        title="Fig. 2, change of the modal frequencies in % by added mass in % of M",
        columns=columns,
        rows=rows,
        notes=(
            "Paper: -0.98 % at 2 % of mass to -6.8 % at 14 %. Ours: frequencies"
            f" {by_mode[:, 0].min():.2f} .. {by_mode[:, 0].max():.2f} % and"
            f" {by_mode[:, -1].min():.2f} .. {by_mode[:, -1].max():.2f} %; the damping ratios,"
            f" which fall alike, reach {np.min(damping[-1]):.2f} %.",
            "Frequency is |lambda| / 2 pi. Modes are paired by shape: from 12 % on 4 and 5 swap.",
        ),
        panels=(
            (
                _by_share("Natural frequency of modes 1 to 7", by_mode),
                _by_share("Damping ratio of modes 1 to 7", np.array(damping).T),
            ),
        ),
    )


def _by_share(title: str, change: NDArray[np.float64]) -> CurvePanel:
    curves = tuple(
        Curve(str(i + 1), np.array(_ADDED_PERCENT), row, hue=1 if i < 3 else 2)
        for i, row in enumerate(change)
    )
    return CurvePanel(title, "added mass / % of M", "change / %", curves)


def mass_error_study(figure: str) -> Study:
    """Return the effect of an error in one added inertia on the parameters (Figs. 3 to 7).

    The chain is the paper's (Eqs. 22-33, then its order of estimation) on the exact modes of both
    mass states: without noise that chain is exact, so all error comes from the added mass.

    `figure`: a key of `MASS_ERRORS`.
    """
    error = MASS_ERRORS[figure]
    found = np.array([_parameters_given(error, e) for e in ERRORS_PERCENT])
    errors = percent(found, FORD_GRANADA.to_array())
    by_name = dict(zip(PARAMETER_NAMES, errors.T, strict=True))
    middle = len(ERRORS_PERCENT) // 2
    rows = tuple(
        (
            name,
            float(by_name[name][0]),
            float(by_name[name][-1]),
            float((by_name[name][middle + 1] - by_name[name][middle - 1]) / 2.0),
        )
        for name in PARAMETER_NAMES
    )
    return Study(
        title=f"Fig. {figure.removeprefix('fig')}, identified parameters by an error in"
        f" {error.quantity}",
        columns=(
            Column("parameter", "parameter"),
            Column("at_minus_5_percent", "error at -5 %"),
            Column("at_plus_5_percent", "error at +5 %"),
            Column("slope", "slope % / %", "+z.3f"),
        ),
        rows=rows,
        notes=(*error.says, _CONVENTION),
        panels=(
            (
                error_panel("Dynamic parameters", error.quantity, by_name, _DYNAMIC),
                error_panel("Structural parameters", error.quantity, by_name, _GEOMETRY),
            ),
        ),
    )


def _parameters_given(error: MassError, error_percent: float) -> NDArray[np.float64]:
    """Return the 15 parameters found when the added mass is stated wrongly."""
    vehicle = physical_model(FORD_GRANADA)
    on_board = delta_mass(PAPER_ADDED_MASS, FORD_GRANADA.a).real
    stated = on_board.copy()
    stated[error.dofs, error.dofs] *= 1.0 - error_percent / 100.0
    light, heavy = (
        state_matrix_of(modes_of(model.A)) for model in (vehicle, vehicle.with_mass(on_board))
    )
    return sequential_vehicle(physical_matrices(light, heavy, stated)).to_array()


def error_panel(
    title: str, quantity: str, by_name: Mapping[str, NDArray[np.float64]], names: tuple[str, ...]
) -> CurvePanel:
    """Return a diagram of the errors of some parameters over the error of the stated quantity.

    Front and rear parameters of a kind share a colour; the rear one is dashed.
    """
    curves = tuple(
        Curve(name, np.array(ERRORS_PERCENT), by_name[name], hue=1 + i // 2, dashed=i % 2 == 1)
        for i, name in enumerate(names)
    )
    return CurvePanel(title, f"error of {quantity} / %", "error of the parameter / %", curves)
