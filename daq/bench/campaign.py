"""Defines the campaign as data: the mass states, the kinds of bump and the number of repeats."""

from __future__ import annotations

from dataclasses import dataclass

from ..runs import ADDED, BASELINE, Excitation, run_label


@dataclass(frozen=True, slots=True)
class Step:
    """One run of the campaign."""

    mass_state: str
    excitation: Excitation
    repeat: int

    @property
    def label(self) -> str:
        """`baseline_bounce_1` and the like."""
        return run_label(self.mass_state, self.excitation, self.repeat)


@dataclass(frozen=True, slots=True)
class Campaign:
    """All combinations of mass states, excitations and repeats, in the order of the runs."""

    excitations: tuple[Excitation, ...] = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
    """The kinds of bump."""
    repeats: int = 2
    """Number of runs of each kind of bump in each mass state."""
    mass_states: tuple[str, ...] = (BASELINE, ADDED)
    """The states of loading; the runs are ordered so that masses are changed as seldom as
    possible."""

    @property
    def steps(self) -> tuple[Step, ...]:
        """Every run, in order."""
        return tuple(
            Step(mass_state, excitation, repeat)
            for mass_state in self.mass_states
            for excitation in self.excitations
            for repeat in range(1, self.repeats + 1)
        )
