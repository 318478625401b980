"""Finds the kind of a bump from the motion of the body, if no sensor shows the wheels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bench.config import Bench
from ..channels import Quantity
from ..runs import Excitation
from .strikes import TOGETHER, Corners, Pattern, likeness_of, shares_of
from .window import Trace

BODY_PURITY = 0.65
"""Least likeness from the body alone, whose motions mix: pitch and roll come with heave.  Simulated
cars show 0.86 and more for the right bump, 0.53 and less for a wrong one."""
STRIKE_S = 0.1
"""Time after the bump that belongs to the strike, s: the wheels' first swing."""
_GRID_S = 0.002
"""Spacing of the body's speeds, s."""
_HALF_WHEELBASE_M, _HALF_TRACK_M = 1.35, 0.75
"""Half lengths of a usual car, m, if bench.toml states none: only their ratios count."""
_TURN = 0.9
"""Ratio of turning to heave from which the body does not bounce."""


class Body(NamedTuple):
    """Largest motion of the body in the strike, as motion at the corners, all in one unit."""

    heave: float
    pitch: float
    roll: float
    front: float
    """Motion at the front axle."""
    rear: float
    """Motion at the rear axle."""
    left: float
    """Motion at the left wheels."""
    right: float
    """Motion at the right wheels."""


def body_pattern(bench: Bench, signals: tuple[Trace, ...]) -> Pattern | None:
    """Return the pattern of a bump from accelerometers and gyroscopes; None with too few."""
    body = _moved_body(bench, signals)
    if body is None:
        return None
    power = np.square(body[:3]) / max(float(np.sum(np.square(body[:3]))), 1e-24)
    shares = dict(zip(("bounce", "pitch", "roll"), power.tolist(), strict=True))
    return of_body(bench.campaign.excitations, body, MappingProxyType(shares), "body's motion")


def pushed_pattern(bench: Bench, four: tuple[Trace, ...]) -> Pattern:
    """Return the pattern of a push from the four travels, which the body moves all."""
    motion = _moved_corners(four)
    shares = shares_of(motion)
    heave, pitch, roll = (float(np.sqrt(shares[name])) for name in ("bounce", "pitch", "roll"))
    front, rear = abs(float(motion[0] + motion[1])), abs(float(motion[2] + motion[3]))
    left, right = abs(float(motion[0] + motion[2])), abs(float(motion[1] + motion[3]))
    body = Body(heave, pitch, roll, front, rear, left, right)
    return of_body(bench.campaign.excitations, body, shares, "travels")


def of_body(
    planned: tuple[Excitation, ...], body: Body, shares: Mapping[str, float], by: str
) -> Pattern:
    """Judge by heave, pitch and roll alone; warp moves the body hardly more than bounce does.

    A pitch bump heaves the body as much as it turns it: the likeness compares each turning with
    heave alone, and only motion that clearly belongs to another kind is refused.  The struck axle
    moves more than the other, and the struck side more than the other.

    `planned`: the kinds of the campaign.  `body`: the motion.  `shares`: shares of the motion, for
    the text.  `by`: the sensors, in words.
    """
    turn = max(body.pitch, body.roll)
    still = 1.0 - min(turn / max(body.heave, 1e-12) / _TURN, 1.0) / 2
    like = {}
    for wheels in TOGETHER:
        at_front, to_left = sum(2 * c.front - 1 for c in wheels), sum(c.side for c in wheels)
        if at_front:
            axle = _moved_more(at_front, body.front, body.rear)
            like[wheels] = axle * _turned(body.pitch, body.heave, body.roll)
        elif to_left:
            side = _moved_more(to_left, body.left, body.right)
            like[wheels] = side * _turned(body.roll, body.heave, body.pitch)
        else:
            like[wheels] = still
    likeness = likeness_of(like, planned)
    best = max(likeness, key=lambda kind: likeness[kind])
    words = "the body stays level"
    if likeness[best] > still and body.roll > body.pitch:
        words = "left and right against each other"
    elif likeness[best] > still:
        words = "nose and tail against each other, the "
        words += "nose more" if body.front >= body.rear else "tail more"
    return Pattern(shares, likeness, f"{best.words}: {words}", by, BODY_PURITY, like)


def _moved_more(way: int, positive: float, negative: float) -> float:
    """Return the ratio, at most 1, of the motion of the end or side in direction `way`."""
    own, other = (positive, negative) if way > 0 else (negative, positive)
    return min(own / max(other, 1e-12), 1.0)


def _turned(own: float, heave: float, other: float) -> float:
    """Return the likeness to a turn: from its share of both turns, if the body turns at all."""
    turning = min(own / max(heave, 1e-12) / 0.4, 1.0)
    return turning * own**2 / max(own**2 + other**2, 1e-24)


def _moved_corners(four: tuple[Trace, ...]) -> Corners:
    """Return the common motion of the corners, (4,): the strongest pattern of their records."""
    grid = np.arange(0.0, min(trace.time_s[-1] for trace in four), 0.01)
    rows = np.array([np.interp(grid, trace.time_s, trace.value) for trace in four])
    u, _, _ = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(u[:, 0])


def _moved_body(bench: Bench, signals: tuple[Trace, ...]) -> Body | None:
    """Return the largest speeds of the body, m/s."""
    geometry = bench.vehicle.geometry
    length_m = (geometry.a + geometry.b) / 2 if geometry else _HALF_WHEELBASE_M
    width_m = (geometry.t_f + geometry.t_r) / 2 if geometry else _HALF_TRACK_M
    grid = np.arange(-STRIKE_S / 2, bench.campaign.bump_s + STRIKE_S, _GRID_S)
    points = [t for t in signals if t.channel.quantity is Quantity.BODY_ACCELERATION]
    if not points:
        return None
    values = np.array([_speed(trace, grid) for trace in points])
    ahead_m = np.array([-length_m if t.channel.at_cg else t.channel.x_m for t in points])
    middle_m = float(np.mean(ahead_m))  # from the front axle, because the CG is not known
    pitch = _turning(signals, (Quantity.PITCH_RATE, Quantity.PITCH_ACCELERATION), grid)
    roll = _turning(signals, (Quantity.ROLL_RATE, Quantity.ROLL_ACCELERATION), grid)
    if pitch is not None and roll is not None:
        heave = np.mean(values, axis=0)
    else:
        left_m = [t.channel.y_m for t in points]
        rows = np.stack([np.ones(len(points)), middle_m - ahead_m, left_m], axis=1)
        if len(points) < 3 or np.linalg.matrix_rank(rows, tol=0.1) < 3:
            return None
        heave, pitch, roll = np.linalg.lstsq(rows, values)[0]
    speeds = (
        heave,
        length_m * pitch,
        width_m * roll,
        heave + middle_m * pitch,
        heave + (middle_m + 2.0 * length_m) * pitch,
        heave + width_m * roll,
        heave - width_m * roll,
    )
    return Body(*(float(np.max(np.abs(speed))) for speed in speeds))


def _turning(
    signals: Iterable[Trace], quantities: tuple[Quantity, ...], grid: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the angular speed of the body, rad/s, from the first sensor of these quantities."""
    found = (t for quantity in quantities for t in signals if t.channel.quantity is quantity)
    first = next(found, None)
    return None if first is None else _speed(first, grid)


def _speed(trace: Trace, grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the speed since rest; for a rate, the rate itself."""
    value = np.interp(grid, trace.time_s, trace.value, right=0.0)
    if trace.channel.quantity in (Quantity.PITCH_RATE, Quantity.ROLL_RATE):
        return np.asarray(value)
    return np.asarray(np.cumsum(value) * _GRID_S)
