"""Which parameters of a result that is not ok can still be used, and which are lost to what.

Every cause that was sized says by how much it would move each parameter.  A parameter survives if
none of the causes that may still be true moves it by more than its standard deviation: with noise
and cause together it then still lies within three of them.  (Half of the 95 % interval as the limit
left errors of four standard deviations among the survivors of the stress list.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan

import numpy as np

from ..fit.estimation import Estimation
from ..fit.grey_box import SIGNED
from ..fit.uncertainty import determined
from .misfit import CHI2_LIMIT

_EXPLAINS = 0.35
"""Share of the misfit that the best cause must explain; below, what is left may be anything."""
_RIVAL = 0.5
"""Share of what the best cause explains from which on another one may be the true one."""

_UNEXPLAINED = "no cause that was tried explains the misfit"
_MOST = 3.0
"""Change of a logarithm beyond which its size says nothing: a factor of twenty."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """Something that may be wrong, with what follows for the parameters."""

    cause: str
    """In words."""
    explained: float
    """Share of the misfit that it explains; infinite where it competes for no misfit."""
    moved: Mapping[str, float]
    """By how much each parameter's unknown would move."""


@dataclass(frozen=True, slots=True)
class Loss:
    """Why a parameter is lost."""

    cause: str
    """In words."""
    shift: float = nan
    """By how much the cause would move it, as a share of it; NaN where that is not known."""


@dataclass(frozen=True, slots=True)
class Survival:
    """The parameters of a result, divided."""

    surviving: tuple[str, ...] = ()
    """Those that no cause moves by more than their standard deviation."""
    lost: Mapping[str, Loss] = field(default_factory=dict)
    """The others."""


def survival(estimation: Estimation, hypotheses: Sequence[Hypothesis]) -> Survival:
    """Divide the parameters into those that survive and those that are lost.

    A nonlinear fit that converged and leaves a little has intervals that hold for it.  A linear one
    that leaves something keeps a parameter only if the known causes explain nearly all of it.

    `hypotheses`: all causes that were refitted or sized, and stand out of the noise.
    """
    box, fit = estimation.box, estimation.fit
    names, linear = box.parameters, estimation.nonlinear is None
    if not fit.converged and (linear or not estimation.holds):
        return Survival((), dict.fromkeys(box.names, Loss("the fit did not converge")))
    known = zip(names, determined(box, fit.covariance), strict=True)
    lost = {name: Loss("not determined") for name, is_known in known if not is_known}
    rivals = list(hypotheses)
    if linear and not estimation.holds:
        best = max((h.explained for h in hypotheses if isfinite(h.explained)), default=0.0)
        left = 1.0 + (estimation.chi2_per_n - 1.0) * (1.0 - min(best, 1.0))
        if best < _EXPLAINS or left > CHI2_LIMIT:
            return Survival((), dict.fromkeys(box.names, Loss(_UNEXPLAINED)) | lost)
        rivals = [h for h in hypotheses if h.explained >= _RIVAL * best]
    std = np.sqrt(np.diag(fit.covariance)[: len(names)])
    for name, within in zip(names, std.tolist(), strict=True):
        worst = max(rivals, key=lambda h: abs(h.moved[name]), default=None)
        if name not in lost and worst is not None and abs(worst.moved[name]) > within:
            by = float(np.expm1(np.clip(worst.moved[name], -_MOST, _MOST)))
            lost[name] = Loss(worst.cause, nan if name in SIGNED else by)
    return Survival(tuple(name for name in box.names if name not in lost), lost)
