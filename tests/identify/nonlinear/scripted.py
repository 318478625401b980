"""Scripted fits: a search for a car whose fits end as a test says."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from identify.decays.decay import ChannelGroup
from identify.fit.grey_box import GreyBox
from identify.nonlinear.car import KNOTS, Car, Model
from identify.nonlinear.fit import Clock
from identify.nonlinear.path import ROUGH, Grade
from identify.nonlinear.release import Attempt, release

from .truth import ADDED, BASELINE, RICH, bent

HUB = Channel(
    "hub", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT, delay_sigma_s=1e-3
)
"""A sensor that may be late: its lateness is a correction."""
_NONE = np.zeros(0)
STANDING = Car(np.zeros((4, 22)), _NONE, _NONE, _NONE, _NONE, _NONE, ())
"""A car whose suspensions travel as its wheels move."""
MODEL = Model(GreyBox((ChannelGroup("hubs", (HUB,)),), (BASELINE, ADDED), None, RICH), KNOTS["K3"])


def run(label: str) -> Any:
    """Return a run of 118 values: less its own 18 unknowns it counts 100."""
    return SimpleNamespace(label=label, freedom=118.0, decay=None)


def attempt(name: str, late_s: float = 0.0, n_runs: int = 1) -> Attempt:
    whole = tuple(run(f"{name} whole {i}") for i in range(n_runs))
    short = tuple(run(f"{name} short {i}") for i in range(n_runs))
    return Attempt(whole, short, bent(MODEL), {}, late_s)


@dataclass
class Script:
    """Scripted fits: the chi2/n with which each ends in turn, and what it was asked for."""

    ends: Sequence[float | None]
    asked: list[Any] = field(default_factory=list)
    converged: bool = True
    sizes: dict[str, float] = field(default_factory=dict)
    """Unknowns that each fit sets."""
    compressions: tuple[float, float] = (0.05, 0.04)
    """Largest compression of the front and the rear suspensions, m, on the path of each run."""

    def fit(
        self,
        problem: Any,
        eta: NDArray[np.float64],
        initials: tuple[Any, ...],
        grade: Grade,
        is_over: Callable[[], bool],
        **options: float,
    ) -> Any:
        names = problem.model.names
        free = {names[i] for i in problem.free}
        labels = [run.label for run in problem.runs]
        self.asked.append(
            SimpleNamespace(
                eta=dict(zip(names, eta.tolist(), strict=True)), free=free, runs=labels,
                initials=initials, grade=grade, options=options, knots=problem.model.knots,
            )
        )  # fmt: skip
        end = self.ends[len(self.asked) - 1]
        if end is None:
            return None
        eta = eta.copy()
        for name, value in self.sizes.items():
            eta[names.index(name)] = value
        cost = end * 100.0 * len(problem.runs)
        states = np.zeros((3, 22))
        states[1, [3, 6]] = self.compressions  # front left and rear right
        states[2, 3:7] = -0.09  # rebound
        path = SimpleNamespace(states=states)
        there = SimpleNamespace(
            problem=problem,
            initials=tuple(f"{own}'" for own in initials),
            cars=(STANDING,) * len(problem.runs),
            predicted=tuple(SimpleNamespace(cost=cost, path=path) for _ in problem.runs),
        )
        return SimpleNamespace(
            point=there, eta=eta, cost=cost, iterations=1, decrement=0.1,
            converged=self.converged or grade is ROUGH,
        )  # fmt: skip


def of(*names: str) -> Callable[[str], bool]:
    """Return which groups are allowed."""
    return lambda name: name in names


def play(
    monkeypatch: pytest.MonkeyPatch,
    script: Script,
    attempts: Sequence[Attempt],
    allowed: Callable[[str], bool] = lambda _: False,
    gains: Callable[[Sequence[str], NDArray[np.float64], Any], Any] | None = None,
    log: Callable[[str], None] = lambda _: None,
    clock: Clock | None = None,
) -> Any:
    """Return what a search by a script finds, and the names of the starts that it asked for."""

    def gain_of(best: Any, eta: Any, extra: Any) -> Any:
        problem = best.point.problem
        names = [problem.model.names[i] for i in extra]
        found = gains(names, eta, problem) if gains else ([0.0, 0.0], [0.0, 0.0])
        return np.array(found[0]), np.array(found[1])

    monkeypatch.setattr("identify.nonlinear.release.fit", script.fit)
    monkeypatch.setattr("identify.nonlinear.release.gain_of", gain_of)
    monkeypatch.setattr(
        "identify.nonlinear.release.initial_states_of",
        lambda model, eta, decays, sigma: tuple(f"own {i}" for i in range(len(decays))),
    )
    given: list[str] = []

    def source() -> Iterator[Attempt]:
        for one in attempts:
            given.append(str(vars(one.runs[0])["label"]).split()[0])
            yield one

    found = release(MODEL, source(), allowed, log, clock or Clock())
    return found, given
