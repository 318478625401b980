"""Stated facts, places, delays and weights that the runs contradict, each named once.

One wrong statement distorts the fit and makes others disagree with it.  So the one that explains
most is removed first, and only statements that still disagree are named after it (data snooping,
Baarda 1968).  A common factor of all weights counts as a separate statement.  What no residual
shows is noted: the scale of all masses, and what is taken as exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import FactQuantity, MassState
from dbc.words import Finding, Severity

from ..fit.estimation import Estimation
from ..fit.grey_box import SIGNED, GreyBox
from ..fit.likelihood import covariance_of
from .finding import listed

Array = NDArray[np.float64]

_LENGTHS = {
    FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK,
    "a", "b", "t_f", "t_r", "y_s",
}  # fmt: skip
"""Facts that do not depend on the scale."""
_LIMIT_SIGMAS = 4.0
_LEAST_REDUNDANCY = 1e-5
"""Least share of a statement's variance in its misfit; below, the fit is not exact enough to test
it."""
_REFUSED_SHIFT = 0.1
"""Relative change of a parameter by contradicted statements above which the result is refused."""
_ALIKE = 0.95
"""Correlation of two tests above which the runs do not show which statement is wrong."""


def scale_facts(box: GreyBox) -> tuple[str, ...]:
    """Return the stated facts that fix the scale: loads, or a spring that was measured."""
    return tuple(fact.quantity for fact in box.facts if fact.quantity not in _LENGTHS)


def unseen_findings(box: GreyBox, mass_states: Sequence[MassState]) -> Iterator[Finding]:
    """Yield notes on what no residual shows.

    Free decays determine ratios of masses only, and a motion that is shown too large looks like one
    that is larger.

    `box`: structure of a problem that the runs determine.  `mass_states`: as stated.
    """
    if not scale_facts(box):
        text = (
            "the scale rests on the added weights alone: if all of them are 10 % off, so are all "
            "masses, inertias, stiffnesses and dampers, and no fit shows it; weigh the car as a "
            "check"
        )
        yield Finding("scale", Severity.NOTE, text)
    exact = [c.name for group in box.groups for c in group.channels if not c.scale_sigma]
    if exact:
        text = (
            f"no gain_sigma is stated for {listed(exact)}: a sensor that shows 1 % too much can "
            "move half tracks and inertias by 1 to 2 %, more than their intervals, and no fit "
            "shows it; state it from data sheet or calibration"
        )
        yield Finding("gains", Severity.NOTE, text)
    unstated = [
        f"weight {i} of state {state.name}"
        for state in mass_states
        for i, weight in enumerate(state.added.weights, start=1)
        if weight != weight.weighed()
    ]
    if unstated:
        text = (
            f"{listed(unstated)}: stated with ± 0 kg or ± 0 m, but no scale or tape is exact: "
            "0.5 % and 10 mm are assumed; state sigma_kg of the scales and position_sigma_m of the "
            "tape measure"
        )
        yield Finding("exact_weights", Severity.NOTE, text)


@dataclass(frozen=True, slots=True)
class Contradiction:
    """One statement that the runs contradict."""

    name: str
    """Name of the statement; others that the runs do not separate from it follow after "or"."""
    sigmas: float
    """Misfit in its own standard deviations, after the statements named before it were removed."""
    direction: Array
    """Error of each statement, in its sigmas, that this one means, (n_stated,)."""

    @property
    def of_place(self) -> bool:
        """True if it is the place of a sensor or of a weight."""
        return self.name.startswith(("x of ", "y of "))


class _Stated:
    """Compares statements with a fit: facts, then places, delays, gains and weights."""

    def __init__(self, estimation: Estimation) -> None:
        box, eta = estimation.box, estimation.fit.eta
        of_facts, slopes = estimation.engine.fact_misfits(eta)
        n, pulls = len(box.parameters), box.pulls(eta)
        rows = np.zeros((len(pulls), len(eta)))  # elements may follow the unknowns of the grey box
        place = np.arange(len(pulls))
        rows[place, n + place] = 1.0 / box.prior_sigma[n + place]
        self.rows = np.vstack([slopes, rows])
        """Slopes in their sigmas, (n_stated, P)."""
        self.misfits = np.concatenate([of_facts, -pulls])
        """Misfits in their sigmas, (n_stated,)."""
        # Not the covariance of the fit: what widens that does not draw the fit to what is stated.
        covariance = covariance_of(np.sum(list(estimation.fit.information.values()), axis=0))
        self.covariance = np.where(np.isfinite(covariance), covariance, 0.0)
        """Covariance of the unknowns by noise and statements, zero for those not released."""
        laws = np.zeros_like(covariance) if estimation.laws is None else estimation.laws
        noise = np.eye(len(self.rows)) - self.rows @ self.covariance @ self.rows.T
        self.redundancy = noise + self.rows @ laws @ self.rows.T
        """Covariance of the misfits, (n_stated, n_stated)."""
        self.signed = [name in SIGNED for name in box.parameters]

    def sizes(self, wrong: Sequence[Contradiction]) -> Array:
        """Return the multiple of each direction by which what is stated is off, (n_wrong,)."""
        D = np.array([one.direction for one in wrong]).T
        return np.linalg.solve(D.T @ self.redundancy @ D, D.T @ self.misfits)

    def shift(self, wrong: Sequence[Contradiction]) -> Array:
        """Return the change of each parameter without the contradicted statements, (n,).

        It is relative to the value, with its sign; zero for parameters that may be zero.
        """
        off = np.array([one.direction for one in wrong]).T @ self.sizes(wrong)
        moved = -self.covariance[: len(self.signed)] @ (self.rows.T @ off)
        moved[self.signed] = 0.0
        return np.asarray(moved)


def contradiction_findings(estimation: Estimation) -> Iterator[Finding]:
    """Yield a finding on the statements that the runs contradict."""
    wrong = contradictions(estimation)
    if not wrong:
        return
    stated = _Stated(estimation)
    moved = float(np.max(np.abs(stated.shift(wrong))))
    corrections = dict(zip(estimation.box.corrections, estimation.box.stated, strict=True))
    named = []
    for one, size in zip(wrong, stated.sizes(wrong).tolist(), strict=True):
        which = corrections.get(one.name)
        words = f", {which.in_words(-size * which.sigma)}" if which else ""
        named.append(f"{one.name} by {one.sigmas:.1f} sigma{words}")
    text = (
        f"the runs contradict what is stated: {'; '.join(named)} (limit {_LIMIT_SIGMAS:g}; moves a "
        f"parameter by about {min(moved, 1.0) * 100:.1f} %): measure it again"
    )
    severity = Severity.ERROR if moved > _REFUSED_SHIFT else Severity.WARNING
    yield Finding("contradiction", severity, text)


def contradictions(estimation: Estimation) -> tuple[Contradiction, ...]:
    """Return the statements that the runs contradict, the worst first.

    Where the residuals exceed the noise, a misfit counts in units of the residuals.  None where the
    fit did not converge, or is a linear one that does not hold: away from the car every statement
    has a misfit.
    """
    holds = estimation.holds or estimation.nonlinear is not None
    if not (estimation.fit.converged and holds):
        return ()
    stated = _Stated(estimation)
    unit = 1.0 if estimation.holds else np.sqrt(max(1.0, estimation.chi2_per_n))
    misfits, Q = stated.misfits / unit, stated.redundancy
    names, D = _suspects(estimation.box)
    first = np.einsum("ik,ij,jk->k", D, Q, D)
    scale = np.maximum(np.einsum("ik,ik->k", D, D), 1e-300)
    wrong: list[Contradiction] = []
    while names:
        power = np.einsum("ik,ij,jk->k", D, Q, D)
        testable = (first > _LEAST_REDUNDANCY * scale) & (power > 1e-3 * first)
        sigmas = np.where(testable, (D.T @ misfits) / np.sqrt(np.where(testable, power, 1.0)), 0.0)
        worst = int(np.argmax(np.abs(sigmas)))
        if not abs(sigmas[worst]) > _LIMIT_SIGMAS:
            break
        d = D[:, worst]
        alike = np.abs(D.T @ Q @ d) / np.sqrt(np.where(testable, power, np.inf) * power[worst])
        same = [names[k] for k in np.flatnonzero(alike > _ALIKE).tolist() if k != worst]
        name = " or ".join([names[worst], *same])
        wrong.append(Contradiction(name, float(abs(sigmas[worst])), d))
        out = Q @ d / power[worst]
        misfits = misfits - out * (d @ misfits)
        Q = Q - np.outer(out, Q @ d)
    return tuple(wrong)


def _suspects(box: GreyBox) -> tuple[tuple[str, ...], Array]:
    """Return the suspects: each statement alone, and all weights together, (n_stated, k)."""
    labels = [f"{fact.quantity} = {fact.value:g} ± {fact.sigma:g}" for fact in box.facts]
    names = [*labels, *box.corrections]
    together = np.zeros(len(names))
    for state in box.mass_states:
        for i, weight in enumerate(state.added.weights, start=1):
            if weight.sigma_kg > 0.0:
                place = names.index(f"weight {i} of state {state.name}")
                together[place] = weight.mass_kg / weight.sigma_kg
    # Without a fact nothing else fixes the scale: the second-order effect of gravity is too weak.
    if np.count_nonzero(together) > 1 and scale_facts(box):
        return (*names, "all weights by a common factor"), np.column_stack(
            [np.eye(len(names)), together]
        )
    return tuple(names), np.eye(len(names))


def contradicted_shift(estimation: Estimation, wrong: Sequence[Contradiction]) -> dict[str, float]:
    """Return the relative change of each parameter without the contradicted statements."""
    return dict(
        zip(estimation.box.parameters, _Stated(estimation).shift(wrong).tolist(), strict=True)
    )


def shift_without_scales(estimation: Estimation) -> dict[str, float]:
    """Return the change of each parameter if the stated loads and springs are off by one factor."""
    box, scaled = estimation.box, scale_facts(estimation.box)
    loads = [f.value / f.sigma if f.quantity in scaled else 0.0 for f in box.facts]
    direction = np.concatenate([loads, np.zeros(len(box.corrections))])
    return contradicted_shift(estimation, (Contradiction("", 0.0, direction),))
