"""Finds the kind of a bump (`daq.bumps`) from the struck wheels, or from the body's motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.words import Finding

from ..bench.campaign import Method
from ..bench.config import Bench
from ..bumps import Wheels, kinds_of
from ..channels import Quantity
from ..runs import Excitation
from ..vehicle import Corner
from .checks import STRIKE_S, of_quantity
from .window import Trace
from .words import finding

PURITY = 0.8
"""Least likeness to the kind that is due: other wheels show a tenth of the motion of struck ones,
through body and anti-roll bars, and the struck ones differ by a third at most."""
BODY_PURITY = 0.65
"""Least likeness from the body alone, whose motions mix: pitch and roll come with heave.  Simulated
cars show 0.86 and more for the right bump, 0.53 and less for a wrong one."""
_GRID_S = 0.002
"""Spacing of the body's speeds, s."""
_TINY = 1e-12
"""Motion of a car that does not move, by which one can divide."""

_FL, _FR, _RL, _RR = Corner
_STRIKE_WORDS: Mapping[Wheels, str] = {
    Wheels(Corner): "all four wheels",
    Wheels({_FL, _FR}): "front wheels only",
    Wheels({_RL, _RR}): "rear wheels only",
    Wheels({_FL, _RL}): "left wheels only",
    Wheels({_FR, _RR}): "right wheels only",
    Wheels({_FL, _RR}): "front left and rear right",
    Wheels({_FR, _RL}): "front right and rear left",
}
"""Sets of wheels that boards or blocks may lift together, with names."""
_STRIKES = tuple(Wheels(some) for n in (4, 2, 1, 3) for some in combinations(Corner, n))
"""All sets of wheels that may be struck together."""


class Pattern(NamedTuple):
    """The kind of bump that some of the sensors show."""

    likeness: Mapping[Excitation, float]
    """Likeness to each kind of bump, 0..1; equal for kinds that these sensors cannot separate, or
    the campaign does not distinguish."""
    words: str
    """The likeliest kind, and the motion that shows it."""
    by: str
    """The sensors, in words."""
    limit: float
    """Least likeness to the kind that is due."""


def patterns(bench: Bench, signals: tuple[Trace, ...]) -> tuple[Pattern, ...]:
    """Return the patterns of a bump: from four hubs, else from four heights and from the body.

    The heights are hub displacements, else travels, which alone may be misleading: stiff anti-roll
    bars move one wheel with the other.  A push by hand is judged from four travels, else from the
    body.  Empty if the sensors show none of these.
    """
    hubs = _of_four_corners(signals, Quantity.HUB_ACCELERATION)
    hub_heights = _of_four_corners(signals, Quantity.HUB_DISPLACEMENT)
    travels = _of_four_corners(signals, Quantity.SUSPENSION_TRAVEL)
    is_push = bench.campaign.method is Method.PUSH
    if is_push and travels:
        return (_pushed(bench, travels),)
    if hubs and not is_push:
        # After 2.5 s the rear axle has met a board too, at walking pace.
        motion = [trace.rms(-STRIKE_S / 2, 2.5) for trace in hubs]
        return (_of_wheels(bench, np.array(motion), "hubs"),)
    shown = []
    if (hub_heights or travels) and not is_push:
        # A wheel on the board goes up; the body rises after it and pulls the other wheels down.
        upwards = -1.0 if bench.campaign.method is Method.DROP else 1.0
        on_bump = [upwards * t.part(0.0, bench.campaign.bump_s) for t in hub_heights or travels]
        rise = [float(np.max(value, initial=0.0)) for value in on_bump]
        by = "hub displacements" if hub_heights else "travels"
        shown.append(_of_wheels(bench, np.array(rise), by))
    body = _moved_body(bench, signals)
    if body is not None:
        shown.append(_of_body(bench.campaign.excitations, body, "body's motion"))
    return tuple(shown)


def _of_four_corners(signals: tuple[Trace, ...], quantity: Quantity) -> tuple[Trace, ...]:
    """Return the traces of a quantity in the order of `Corner`; none unless all four have one."""
    by_corner = {trace.channel.corner: trace for trace in of_quantity(signals, quantity)}
    return tuple(by_corner[c] for c in Corner) if len(by_corner) == len(Corner) else ()


def wrong_mode(due: Excitation, pattern: Pattern) -> Iterator[Finding]:
    """Yield the comparison of the bump with the kind that is due."""
    purity, limit = pattern.likeness[due], pattern.limit
    text = f"a {due.words} bump by the {pattern.by}, {purity:.0%} pure (limit {limit:.0%})"
    if purity < limit:
        text = f"looks like {pattern.words}, not {due.words} ({purity:.0%} {due.words} by the "
        text += f"{pattern.by}, at least {limit:.0%})"
    yield finding("wrong_mode", purity >= limit, purity, limit, "", text)


def _likeness_of_kinds(
    by_strike: Mapping[Wheels, float], planned: tuple[Excitation, ...]
) -> dict[Excitation, float]:
    """Return the likeness to each kind of bump: the largest to a strike that makes this kind."""
    by_kind = dict.fromkeys(Excitation, 0.0)
    for wheels, likeness in by_strike.items():
        for kind in kinds_of(wheels, planned):
            by_kind[kind] = max(by_kind[kind], likeness)
    return by_kind


def _of_wheels(bench: Bench, motion: NDArray[np.float64], by: str) -> Pattern:
    """Return the pattern of the struck wheels; they need not be struck at once.

    `motion`, (4,): size of each wheel's motion, any unit.  The likeness to a strike is the squared
    cosine between the motion and equal motion of only its wheels.
    """
    direction = motion / max(float(np.linalg.norm(motion)), _TINY)
    by_strike = {
        wheels: float(sum(direction[corner.position] for corner in wheels)) ** 2 / len(wheels)
        for wheels in _STRIKES
    }
    planned = bench.campaign.excitations
    best = max(by_strike, key=lambda wheels: by_strike[wheels])
    kind = next((kind.words for kind in kinds_of(best, planned)), "no kind of bump")
    words = _STRIKE_WORDS.get(best, "one wheel only" if len(best) == 1 else "three wheels")
    return Pattern(_likeness_of_kinds(by_strike, planned), f"{kind}: {words}", by, PURITY)


# From the motion of the body, if no sensor shows the wheels ---------------------------------------


class _Body(NamedTuple):
    """Largest motion of the body in the strike, as motion at the corners, all in one unit."""

    heave: float
    pitch: float
    roll: float
    front: float
    rear: float
    left: float
    right: float


def _of_body(planned: tuple[Excitation, ...], body: _Body, by: str) -> Pattern:
    """Return the pattern of heave, pitch and roll; warp moves the body hardly more than bounce.

    A pitch bump heaves the body as much as it turns it: the likeness compares each turning with
    heave alone, and only motion that clearly belongs to another kind is refused.  The struck axle
    moves more than the other, and the struck side more than the other.
    """
    heave = max(body.heave, _TINY)

    def turned(turn: float, other_turn: float) -> float:
        """Return the likeness to pitch or roll, 0..1: its square to the squares of both turns.

        A turn of less than 0.4 of the heave, which a bounce may have, counts in proportion.
        """
        ratio_of_squares = turn**2 / max(turn**2 + other_turn**2, _TINY**2)
        return min(turn / heave / 0.4, 1.0) * ratio_of_squares

    def ratio(struck: float, opposite: float) -> float:
        """Return the ratio of the motion of two ends or sides; 1 if the struck one moves more."""
        return min(struck / max(opposite, _TINY), 1.0)

    # A body that turns by 0.9 of its heave does not bounce.
    level = 1.0 - min(max(body.pitch, body.roll) / heave / 0.9, 1.0) / 2
    by_strike = dict.fromkeys(_STRIKE_WORDS, level)
    pitch, roll = turned(body.pitch, body.roll), turned(body.roll, body.pitch)
    by_strike[Wheels({_FL, _FR})] = ratio(body.front, body.rear) * pitch
    by_strike[Wheels({_RL, _RR})] = ratio(body.rear, body.front) * pitch
    by_strike[Wheels({_FL, _RL})] = ratio(body.left, body.right) * roll
    by_strike[Wheels({_FR, _RR})] = ratio(body.right, body.left) * roll
    likeness = _likeness_of_kinds(by_strike, planned)
    best = max(likeness, key=lambda kind: likeness[kind])
    words = "the body stays level"
    if likeness[best] > level and body.roll > body.pitch:
        words = "left and right against each other"
    elif likeness[best] > level:
        end = "nose" if body.front >= body.rear else "tail"
        words = f"nose and tail against each other, the {end} more"
    return Pattern(likeness, f"{best.words}: {words}", by, BODY_PURITY)


def _pushed(bench: Bench, travels: tuple[Trace, ...]) -> Pattern:
    """Return the pattern of a push from the four travels: the body moves all of them."""
    grid_s = np.arange(0.0, min(trace.time_s[-1] for trace in travels), 0.01)
    on_grid = np.array([np.interp(grid_s, trace.time_s, trace.value) for trace in travels])
    # (4 corners, n times) to (4 corners, 4 shapes), the shape of most motion first.
    shapes, _, _ = np.linalg.svd(on_grid, full_matrices=False)
    fl, fr, rl, rr = shapes[:, 0].tolist()
    body = _Body(
        heave=abs(fl + fr + rl + rr) / 2,
        pitch=abs(fl + fr - rl - rr) / 2,
        roll=abs(fl - fr + rl - rr) / 2,
        front=abs(fl + fr),
        rear=abs(rl + rr),
        left=abs(fl + rl),
        right=abs(fr + rr),
    )
    return _of_body(bench.campaign.excitations, body, "travels")


def _moved_body(bench: Bench, signals: tuple[Trace, ...]) -> _Body | None:
    """Return the largest speeds of the body, m/s.

    None without an accelerometer on the body, or if neither sensors of its turning nor three points
    show pitch and roll.
    """
    geometry = bench.vehicle.geometry
    # Half wheelbase and half track of a usual car: only their ratio counts.
    half_base_m, half_track_m = 1.35, 0.75
    if geometry is not None:
        half_base_m = (geometry.a + geometry.b) / 2
        half_track_m = (geometry.t_f + geometry.t_r) / 2
    points = of_quantity(signals, Quantity.BODY_ACCELERATION)
    if not points:
        return None
    grid_s = np.arange(-STRIKE_S / 2, bench.campaign.bump_s + STRIKE_S, _GRID_S)
    point_speeds = np.array([_speed(trace, grid_s) for trace in points])  # (points, n times)
    # From the front axle, forward positive; the CG is not known: it is taken as in the middle.
    ahead_m = np.array([-half_base_m if t.channel.at_cg else t.channel.x_m for t in points])
    middle_m = float(np.mean(ahead_m))
    of_pitch = of_quantity(signals, Quantity.PITCH_RATE)
    of_pitch = of_pitch or of_quantity(signals, Quantity.PITCH_ACCELERATION)
    of_roll = of_quantity(signals, Quantity.ROLL_RATE)
    of_roll = of_roll or of_quantity(signals, Quantity.ROLL_ACCELERATION)
    if of_pitch and of_roll:
        heave = np.mean(point_speeds, axis=0)
        pitch, roll = _speed(of_pitch[0], grid_s), _speed(of_roll[0], grid_s)
    else:  # as a plane through the speeds of three points or more that are not on one line
        left_m = [t.channel.y_m for t in points]
        # (points, 3): the speed of each point for a heave, a pitch rate and a roll rate of 1.
        plane = np.stack([np.ones(len(points)), middle_m - ahead_m, left_m], axis=1)
        if np.linalg.matrix_rank(plane, tol=0.1) < 3:  # within 0.1 m of one line
            return None
        heave, pitch, roll = np.linalg.lstsq(plane, point_speeds)[0]

    def largest(speed: NDArray[np.float64]) -> float:
        return float(np.max(np.abs(speed)))

    return _Body(
        heave=largest(heave),
        pitch=largest(half_base_m * pitch),
        roll=largest(half_track_m * roll),
        front=largest(heave + middle_m * pitch),
        rear=largest(heave + (middle_m + 2.0 * half_base_m) * pitch),
        left=largest(heave + half_track_m * roll),
        right=largest(heave - half_track_m * roll),
    )


def _speed(trace: Trace, grid_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a trace on a grid, (n,): an acceleration integrated since rest, a rate unchanged."""
    value = np.interp(grid_s, trace.time_s, trace.value, right=0.0)
    is_rate = trace.channel.quantity in (Quantity.PITCH_RATE, Quantity.ROLL_RATE)
    return np.asarray(value if is_rate else np.cumsum(value) * _GRID_S)
