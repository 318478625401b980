"""Divides the parameters of a result that is not ok into usable ones and lost ones with a cause.

Every cause whose size was estimated implies a change of each parameter.  A parameter survives if
none of the causes that may still be true moves it by more than its standard deviation: with noise
and cause together it then still lies within three of them.  (With half of the 95 % interval as the
limit, survivors of the stress list had errors of four standard deviations.)
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
"""Share of the misfit that the best cause must explain; below, the rest may have any cause."""
_RIVAL = 0.5
"""Share of the best cause's explanation above which another cause may be the true one."""

_UNEXPLAINED = "no cause that was tried explains the misfit"
_MOST = 3.0
"""Change of a logarithm beyond which its size has no meaning: a factor of twenty."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A possible fault, with its effect on the parameters."""

    cause: str
    """In words."""
    explained: float
    """Share of the misfit that it explains; infinite where there is no misfit to explain."""
    moved: Mapping[str, float]
    """Change of each parameter's unknown by the cause."""


@dataclass(frozen=True, slots=True)
class Loss:
    """The cause for which a parameter is lost."""

    cause: str
    """In words."""
    shift: float = nan
    """Shift of the parameter by the cause, as a share of its value; NaN where that is not known."""


@dataclass(frozen=True, slots=True)
class Survival:
    """The parameters of a result, divided."""

    surviving: tuple[str, ...] = ()
    """Parameters that no cause moves by more than their standard deviation."""
    lost: Mapping[str, Loss] = field(default_factory=dict)
    """The other parameters, each with its cause."""


def survival(estimation: Estimation, hypotheses: Sequence[Hypothesis]) -> Survival:
    """Divide the parameters into those that survive and those that are lost.

    The intervals of a nonlinear fit that converged include the little that it leaves unexplained.
    In a linear fit with a misfit, a parameter survives only if the known causes explain nearly all
    of the misfit.

    `hypotheses`: all causes that were refitted or sized, and that stand out of the noise.
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
        # Two causes may be one shift in two words: rounding must not choose which of them is named.
        worst = max(rivals, key=lambda h: float(f"{abs(h.moved[name]):.6g}"), default=None)
        if name not in lost and worst is not None and abs(worst.moved[name]) > within:
            by = float(np.expm1(np.clip(worst.moved[name], -_MOST, _MOST)))
            lost[name] = Loss(worst.cause, nan if name in SIGNED else by)
    return Survival(tuple(name for name in box.names if name not in lost), lost)
