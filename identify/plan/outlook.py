"""The expected interval of every parameter of a plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import parameter_unit

from ..fit.grey_box import SIGNED
from ..fit.uncertainty import COVERAGE_95, LARGEST_SHARE, Estimate
from ..fit.varpro import pseudo_inverse
from .element_outlook import DamperPoint, damper_points, element_estimates
from .information import Fisher

_FLOOR = 1e-13  # of the largest eigenvalue: rounding
_OPEN = 1.0  # standard deviation of a logarithm (or of a unit) in an undetermined direction


@dataclass(frozen=True, slots=True)
class Outlook:
    """The expected result of a plan."""

    parameters: Mapping[str, Estimate]
    """Expected value, standard deviation (infinite where undetermined) and 95 % interval; a length
    that is known beforehand has no interval."""
    relative: Mapping[str, float]
    """Half the 95 % interval as a share of the value, of each parameter that is to be identified
    and cannot be zero; infinite where undetermined."""
    undetermined: tuple[str, ...]
    """Parameters that the plan leaves undetermined."""
    reasons: tuple[str, ...]
    """Reasons why they are undetermined."""
    worst: float
    mean: float
    """Largest and mean of `relative` over the parameters that are determined; infinite if none
    is."""
    open_directions: int
    """Number of independent combinations of parameters that are undetermined."""
    elements: Mapping[str, Estimate]
    """Friction, mounts, stops and further unknowns of a real car, by the names of
    `identify.nonlinear.unknowns`; the damper's knees are in `dampers`."""
    dampers: tuple[DamperPoint, ...]
    """Points of the damper curves of a real car."""


def expected(fisher: Fisher) -> Outlook:
    """Return the precision of each parameter if the estimate reaches the Cramer-Rao bound."""
    box = fisher.box
    H = _of_parameters(fisher)
    values, vectors = np.linalg.eigh(H)
    floored = np.maximum(values, _FLOOR * max(float(values[-1]), 1.0))
    std = np.sqrt(np.square(vectors) @ (1.0 / floored))  # of logarithms
    lost = [
        name for name, s in zip(box.parameters, std.tolist(), strict=True) if s > _largest(name)
    ]
    slopes = box.parameter_slopes(fisher.eta)
    known = dict(zip(box.parameters, (std * slopes).tolist(), strict=True))
    parameters, relative = {}, {}
    for name, value in zip(box.names, box.values(fisher.eta).tolist(), strict=True):
        one = np.inf if name in lost else known.get(name, 0.0)
        half = COVERAGE_95 * one
        parameters[name] = Estimate(value, one, value - half, value + half, parameter_unit(name))
        if name in known and name not in SIGNED:
            relative[name] = half / value
    finite = [share for share in relative.values() if np.isfinite(share)] or [np.inf]
    return Outlook(
        parameters=parameters,
        relative=relative,
        undetermined=tuple(lost),
        reasons=_reasons(fisher, H, lost),
        worst=max(finite),
        mean=float(np.mean(finite)),
        open_directions=int(np.sum(floored < _OPEN**-2)),
        elements=element_estimates(fisher),
        dampers=damper_points(fisher),
    )


def vague(parameters: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Return the parameters of an identification that are too uncertain to plan with."""
    return tuple(
        name
        for name, e in parameters.items()
        if not (name in SIGNED or e.std <= LARGEST_SHARE * abs(e.value))
    )


def _largest(name: str) -> float:
    """Return the largest standard deviation of an unknown that counts as determined."""
    return 1.0 if name in SIGNED else LARGEST_SHARE


def _reasons(fisher: Fisher, H: NDArray[np.float64], lost: list[str]) -> tuple[str, ...]:
    """Return why parameters are undetermined, from the information, (n, n), on all parameters."""
    box = fisher.box
    own = np.diag(H).tolist()
    blind = [name for name, h in zip(box.parameters, own, strict=True) if h < _largest(name) ** -2]
    # All masses, springs and dampers larger by one factor: the free decays stay as they are.
    scaled = [name[0] in "mIkc" for name in box.parameters]
    change = [fisher.eta[i] if n in SIGNED else 1.0 for i, n in enumerate(box.parameters)]
    v = np.array(change) * scaled
    no_scale = float(v @ H @ v) < LARGEST_SHARE**-2
    explained = {*blind, *(n for n, s in zip(box.parameters, scaled, strict=True) if s * no_scale)}
    mixed = [name for name in lost if name not in explained]
    reasons = []
    if blind:
        reasons.append(f"nothing that is planned depends noticeably on {', '.join(blind)}")
    if no_scale:
        reasons.append(
            "nothing that is planned fixes the scale: all masses, springs and dampers could be"
            " larger by one factor"
        )
    if mixed:
        reasons.append(f"what is planned does not separate {', '.join(mixed)}, or is too noisy")
    return tuple(reasons)


def _of_parameters(fisher: Fisher) -> NDArray[np.float64]:
    """Return the information on the parameters alone; the corrections are eliminated."""
    H, n = fisher.information, len(fisher.box.parameters)
    if n == len(H):
        return H
    mixed = H[n:, :n]
    return np.asarray(H[:n, :n] - mixed.T @ pseudo_inverse(H[n:, n:]) @ mixed)
