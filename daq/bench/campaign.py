"""Defines the campaign as data: mass states, kinds of bump, repeats, and how the car is bumped."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from pydantic import AfterValidator, Field

from dbc.words import InputError

from ..bumps import BUMPS
from ..runs import ADDED, BASELINE, Excitation, run_label
from .toml_file import NO_KEY


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


def numbered(pairs: Iterable[Sequence[str]]) -> tuple[Step, ...]:
    """Return steps for pairs of mass state and excitation, with repeats counted in their order.

    Raises InputError if an entry is no pair, or has no known excitation.
    """
    steps: list[Step] = []
    repeats: Counter[tuple[str, str]] = Counter()
    for pair in pairs:
        if len(pair) != 2 or pair[1] not in set(Excitation):
            what = f"{':'.join(pair)!r} is not a run"
            advice = f"write MASS_STATE:EXCITATION, one of {', '.join(Excitation)}"
            raise InputError("runs", what, advice)
        state, kind = pair[0], Excitation(pair[1])
        repeats[state, kind] += 1
        steps.append(Step(state, kind, repeats[state, kind]))
    return tuple(steps)


class Method(StrEnum):
    """The way in which a bump is made."""

    ROLL_OVER = "roll_over"
    """The car rolls over a board: the chosen wheels rise and fall within a fraction of a second."""
    DROP = "drop"
    """The chosen wheels drop off blocks."""
    PUSH = "push"
    """The body is pushed down by hand and let go."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """`[campaign]`: all combinations of mass states, excitations and repeats, and their bumps."""

    excitations: Annotated[tuple[Excitation, ...], Field(min_length=1)] = (
        Excitation.BOUNCE,
        Excitation.PITCH,
        Excitation.ROLL,
    )
    repeats: Annotated[int, Field(ge=1, le=100)] = 2
    """Number of runs of each kind of bump in each mass state."""
    mass_states: Annotated[tuple[str, ...], NO_KEY] = (BASELINE, ADDED)
    """The states of loading, in the order of the fewest changes of masses."""
    bump_s: Annotated[float, Field(gt=0, le=10)] = 0.2
    """Time for which a wheel is on the bump, s."""
    method: Method = Method.ROLL_OVER
    bump_height_m: Annotated[
        float,
        Field(ge=0.1, le=200, alias="bump_height_mm"),  # 0.04 would be a height in metres
        AfterValidator(lambda height_mm: height_mm * 1e-3),
    ] = 0.04
    """Height of board or block, or depth of the push, m."""
    accept_after_s: Annotated[float, Field(ge=0, le=60)] = 3.0
    """Time that the operator has to reject a run before the next is armed, s."""
    instructions: Mapping[Excitation, Annotated[str, Field(max_length=200)]] = field(
        default_factory=dict, hash=False
    )
    """The operator's instructions for the bumps whose usual instructions do not fit."""

    @property
    def steps(self) -> tuple[Step, ...]:
        """Every run, in order."""
        return tuple(
            Step(mass_state, excitation, repeat)
            for mass_state in self.mass_states
            for excitation in self.excitations
            for repeat in range(1, self.repeats + 1)
        )

    def method_of(self, excitation: Excitation) -> Method:
        """Return the way in which a bump is made: what a push cannot make is dropped off blocks."""
        is_push = self.method is Method.PUSH
        return Method.DROP if is_push and BUMPS[excitation].hand is None else self.method


def instruction(campaign: Campaign, excitation: Excitation) -> str:
    """Return the operator's instruction for a bump."""
    if stated := campaign.instructions.get(excitation):
        return stated
    usual: str = getattr(BUMPS[excitation], campaign.method)
    return usual.format(mm=f"{campaign.bump_height_m * 1e3:g}")


def sketch(campaign: Campaign, excitation: Excitation) -> tuple[str, ...]:
    """Return a top view of the car, front on top, with what the operator has to place or push.

    At most 8 lines of at most 30 plain ASCII characters.
    """
    bump, method = BUMPS[excitation], campaign.method_of(excitation)
    board, wheel, legend = {
        Method.ROLL_OVER: ("===", "[ ]", "=== board"),
        Method.DROP: ("   ", "[#]", "[#] wheel on a block"),
        Method.PUSH: ("   ", "[ ]", "(V) push down here"),
    }[method]
    lines = ["            front"]
    for is_lifted in (bump.height_ratios[:2], bump.height_ratios[2:]):  # left, right of an axle
        boards = [board if each else "   " for each in is_lifted]
        wheels = [wheel if each else "[ ]" for each in is_lifted]
        lines += [f"     {boards[0]}         {boards[1]}".rstrip()]
        lines += [f"     {wheels[0]}---------{wheels[1]}", "      |           |"]
    if bump.hand is not None and method is Method.PUSH:
        forward, to_left = bump.hand  # each -1, 0 or 1
        row, column = {1: 2, 0: 3, -1: 5}[forward], 11 - 6 * to_left
        lines[row] = lines[row][:column] + "(V)" + lines[row][column + 3 :]
    return (*lines[:-1], f"  {legend}, {campaign.bump_height_m * 1e3:g} mm")


class Origin(StrEnum):
    """Marks data as a measurement or a demonstration wherever they are shown or stored."""

    REAL = "real"
    """A bus; nothing more is known."""
    SIMULATED = "simulated"
    """The simulated car, within the recorder's own process."""
    REPLAYED = "replayed"
    """An earlier recording, played to a recorder."""
