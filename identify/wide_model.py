"""Likelihoods of sessions in a richer linear model: the test that nothing else changed.

The test that all else is unchanged uses a car whose corners may all differ, with bars, damped tyres
and its CG off the middle.  A spring of 3 kN/m between the front wheels is not a parameter: in six
runs at 200 Hz it leaves so little misfit that chance explains it, but it acts along one of these
directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import RICHEST

from .fit.estimation import Estimation
from .fit.grey_box import GreyBox
from .joint import Likelihood, likelihood_at


def wide_likelihoods(
    estimations: Sequence[Estimation],
    points: Sequence[NDArray[np.float64]],
    shares: Sequence[Likelihood],
) -> tuple[Likelihood, ...]:
    """Return the likelihoods in all parameters of a linear car, the parameters of the fits first.

    `points`: the parameters of each session, (p,).  All other parameters are zero there.  `shares`:
    the sessions' likelihoods, which are returned where a fit is not linear or has no decays.
    """
    if any(e.nonlinear is not None or not e.decays for e in estimations):
        return tuple(shares)
    return tuple(
        _wide_likelihood(e, at, share.own)
        for e, at, share in zip(estimations, points, shares, strict=True)
    )


def _wide_likelihood(
    estimation: Estimation, at: NDArray[np.float64], own: NDArray[np.float64]
) -> Likelihood:
    narrow = estimation.box
    box = narrow.with_structure(RICHEST)
    full = narrow.full(np.concatenate([at, own]).astype(complex)).real
    eta = box.unknowns_of(full)[: len(box.parameters)]
    share = likelihood_at(replace(estimation, box=box), eta, own)
    basis = _basis(narrow, box)
    return Likelihood(basis.T @ share.information @ basis, basis.T @ share.target, share.own)


def _basis(narrow: GreyBox, wide: GreyBox) -> NDArray[np.float64]:
    """Return the wide model's unknowns per unit of the narrow model's and the others, (q, q).

    A parameter for both corners of an axle moves both alike; a further one moves them apart.
    """
    rows = {name: i for i, name in enumerate(wide.parameters)}
    columns = []
    for name in narrow.parameters:
        column = np.zeros(len(rows))
        column[[rows[n] for n in (name, f"{name}l", f"{name}r") if n in rows]] = 1.0
        columns.append(column)
    for name, row in rows.items():
        column = np.zeros(len(rows))
        if name in narrow.parameters or (name[:-1] in narrow.parameters and name.endswith("r")):
            continue
        column[row] = 1.0
        if name[:-1] in narrow.parameters:
            column[rows[f"{name[:-1]}r"]] = -1.0
        columns.append(column)
    return np.column_stack(columns)
