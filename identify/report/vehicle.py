"""Section on the vehicle as stated beforehand, and its agreement with the result."""

from __future__ import annotations

import numpy as np

from daq.sessions import Session
from daq.vehicle import BodyWeight, MassState, Structure

from ..fit.estimation import Estimation
from ..numbers import number
from .blocks import Block, Cell, Section, Table
from .words import plain


def vehicle_section(session: Session, estimation: Estimation) -> Section:
    """Return structure, facts, stated uncertainties and added weights."""
    blocks: list[Block] = [_model(session)]
    if estimation.box.facts:
        blocks.append(_facts(estimation))
    blocks += [_weights(state) for state in session.mass_states if state.added.weights]
    if estimation.box.corrections:
        blocks.append(_corrections(estimation))
    return Section(
        "vehicle",
        "Vehicle, facts and model",
        "What is given to the identification. Facts and stated uncertainties are data like the "
        "samples: they influence the fit, and may disagree with it.",
        tuple(blocks),
    )


def _model(session: Session) -> Table:
    vehicle = session.vehicle
    rows = [
        ("sides", "left and right alike" if vehicle.structure.symmetric else "each for itself"),
        ("beyond the 15 parameters", _beyond(vehicle.structure) or "nothing"),
        ("lengths a, b, t_f, t_r", "identified" if vehicle.geometry is None else "given"),
        ("facts", str(len(vehicle.facts)) if vehicle.facts else "none"),
        ("mass states", ", ".join(state.name for state in session.mass_states)),
    ]
    cells = tuple((Cell(name), Cell(text)) for name, text in rows)
    return Table("Model of the vehicle", ("", ""), cells)


def _beyond(structure: Structure) -> str:
    names = ("anti_roll_bars", "tyre_damping", "cg_offset")
    return ", ".join(plain(name) for name in names if getattr(structure, name))


def _facts(estimation: Estimation) -> Table:
    misfits, _ = estimation.engine.fact_misfits(estimation.fit.eta)
    rows = [
        (
            Cell(plain(fact.quantity)),
            Cell(number(fact.value)),
            Cell(number(fact.sigma)),
            Cell(number(fact.value - misfit * fact.sigma)),
            Cell(f"{misfit:+.2f}"),
        )
        for fact, misfit in zip(estimation.box.facts, misfits.tolist(), strict=True)
    ]
    return Table(
        "Facts: scales and tape measure",
        ("fact", "#stated", "#uncertainty", "#identified", "#stated less identified, sigma"),
        tuple(rows),
        "All in SI units. A misfit beyond 3 sigma means that scales and decays disagree.",
    )


def _weights(state: MassState) -> Table:
    rows = []
    for weight in state.added.weights:
        if isinstance(weight, BodyWeight):
            at = (weight.x_m, weight.y_m, weight.height_m, weight.position_sigma_m)
            place = (Cell("body"), *(Cell(f"{value:.3f}") for value in at))
        else:
            place = (Cell(f"hub {weight.corner}"), *(Cell("") for _ in range(4)))
        rows.append((*place, Cell(number(weight.mass_kg)), Cell(f"{weight.sigma_kg:.3g}")))
    return Table(
        f"Weights of mass state {state.name}",
        ("on", "#x, m", "#y, m", "#above CG, m", "#place ±, m", "#mass, kg", "#mass ±, kg"),
        tuple(rows),
        "Positions from the middle of the front axle: x forward, y to the left.",
    )


def _corrections(estimation: Estimation) -> Table:
    box, fit = estimation.box, estimation.fit
    first = len(box.parameters)
    pulls = box.pulls(fit.eta)
    std = np.sqrt(np.diag(fit.covariance))[first:]
    rows = []
    for i, name in enumerate(box.corrections):
        factor, unit = _scale(name)
        sigma = float(box.prior_sigma[first + i])
        rows.append(
            (
                Cell(name),
                Cell(f"{sigma * factor:.3g}"),
                Cell(f"{float(fit.eta[first + i]) * factor:+.3f}"),
                Cell(f"{float(std[i]) * factor:.3f}"),
                Cell(unit),
                Cell(f"{pulls[i]:+.2f}"),
            )
        )
    return Table(
        "Stated uncertainties: what the decays say of them",
        ("what", "#stated sigma", "#found off by", "#± sigma", "unit", "#pull, sigma"),
        tuple(rows),
        "Found off by: fitted less stated value. A pull beyond 3 sigma means that the "
        "statement is wrong.",
    )


def _scale(name: str) -> tuple[float, str]:
    if name.startswith("delay"):
        return 1e3, "ms"
    if name.startswith("gain"):
        return 100.0, "%"
    return (1.0, "kg") if name.startswith("weight") else (1e3, "mm")
