"""Brings the fits of several sessions to one structure, so that one joint fit can hold them all.

A car without anti-roll bars is one whose bars have no stiffness.  Where one session needs more
parameters than another, the linear fit of the other session is repeated with these parameters, so
that their difference becomes known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from daq.vehicle import Structure

from .fit.estimation import Estimation
from .fit.likelihood import fit


def with_common_structure(estimations: Sequence[Estimation]) -> tuple[Estimation, ...]:
    """Return the fits, the linear ones extended to every parameter that any of them has.

    A nonlinear fit, and one stored without its decays, stays as it is.
    """
    every = [e.box.structure for e in estimations]
    structure = Structure(
        symmetric=all(one.symmetric for one in every),
        anti_roll_bars=any(one.anti_roll_bars for one in every),
        tyre_damping=any(one.tyre_damping for one in every),
        cg_offset=any(one.cg_offset for one in every),
    )
    return tuple(
        e
        if e.box.structure == structure or e.nonlinear is not None or not e.decays
        else _refitted(e, structure)
        for e in estimations
    )


def _refitted(estimation: Estimation, structure: Structure) -> Estimation:
    box = estimation.box.with_structure(structure)
    start = box.unknowns_of(estimation.full)
    found = fit(box, estimation.decays, estimation.sigma, start)
    chi2 = estimation.chi2_per_n
    if estimation.freedom > 0.0:
        chi2 += (found.cost - estimation.fit.cost) / estimation.freedom
    return replace(estimation, box=box, fit=found, chi2_per_n=chi2)
