"""The kind of a bump by the wheels struck, or by the body's motion: bounce, pitch, roll or warp."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding

from ..bench.config import Bench
from ..bench.procedure import Method
from ..channels import Quantity
from ..runs import Excitation
from ..vehicle import Corner
from .window import Trace
from .words import finding

PURITY = 0.8
"""Likeness to the pattern that is due: wheels that stand still show a tenth of the struck ones
through body and anti-roll bars, and the struck ones differ by a third at most."""
BODY_PURITY = 0.65
"""Likeness that is due by the body alone, whose motions mix: its pitch goes with heave, its roll
too.  Simulated cars show 0.86 and more if bumped right, 0.53 and less if not."""
_STRIKE_S = 0.1
"""Time after the bump that belongs to the strike, s: the wheels' first swing."""
_AXLES_S = 2.5
"""Time after the front axle at which the rear one has met a board at walking pace, s."""
_HALF_WHEELBASE_M, _HALF_TRACK_M = 1.35, 0.75
"""Half lengths of a usual car, m, where bench.toml states none: only their ratios count."""

Corners = NDArray[np.float64]
"""One figure for each corner, (4,), in the order of `Corner`."""

PATTERNS: Mapping[str, Corners] = MappingProxyType(
    {
        "bounce": np.array([1.0, 1.0, 1.0, 1.0]) / 2,
        "pitch": np.array([1.0, 1.0, -1.0, -1.0]) / 2,
        "roll": np.array([1.0, -1.0, 1.0, -1.0]) / 2,
        "warp": np.array([1.0, -1.0, -1.0, 1.0]) / 2,
    }
)
"""Any motion of four corners is a sum of these; they are orthonormal."""


class Strike(NamedTuple):
    """Wheels that go together, and which excitation that makes."""

    words: str
    corners: tuple[int, int, int, int]
    excitation: Excitation | None


STRIKES = (
    Strike("all four wheels", (1, 1, 1, 1), Excitation.BOUNCE),
    Strike("front wheels only", (1, 1, 0, 0), Excitation.PITCH),
    Strike("rear wheels only", (0, 0, 1, 1), Excitation.PITCH),
    Strike("left wheels only", (1, 0, 1, 0), Excitation.ROLL),
    Strike("right wheels only", (0, 1, 0, 1), Excitation.ROLL),
    Strike("front left and rear right", (1, 0, 0, 1), Excitation.WARP),
    Strike("front right and rear left", (0, 1, 1, 0), Excitation.WARP),
    Strike("one wheel only", (1, 0, 0, 0), None),
    Strike("one wheel only", (0, 1, 0, 0), None),
    Strike("one wheel only", (0, 0, 1, 0), None),
    Strike("one wheel only", (0, 0, 0, 1), None),
    Strike("three wheels", (1, 1, 1, 0), None),
    Strike("three wheels", (1, 1, 0, 1), None),
    Strike("three wheels", (1, 0, 1, 1), None),
    Strike("three wheels", (0, 1, 1, 1), None),
)
"""Either axle, side or diagonal will do: the identification finds out which it was."""


class Pattern(NamedTuple):
    """The kind of bump that some of the sensors show."""

    shares: Mapping[str, float]
    """Shares of bounce, pitch, roll and warp in the motion, 0..1; empty if unknown."""
    likeness: Mapping[Excitation, float]
    """Likeness to each kind of bump, 0..1; equal for kinds that these sensors cannot separate."""
    words: str
    """The motion in words."""
    by: str
    """The sensors, in words."""
    limit: float
    """Least likeness to the kind that is due."""


def patterns(bench: Bench, seen: tuple[Trace, ...]) -> tuple[Pattern, ...]:
    """Return how the car was bumped: by four hubs, else by four travels and by the body.

    Travels alone may be misled by stiff anti-roll bars, which move one wheel with the other.
    """
    found: list[Pattern] = []
    pushed = bench.procedure.method is Method.PUSH
    for quantity in (
        Quantity.HUB_ACCELERATION,
        Quantity.HUB_DISPLACEMENT,
        Quantity.SUSPENSION_TRAVEL,
    ):
        four = _four(seen, quantity)
        if four is None or (pushed and quantity is not Quantity.SUSPENSION_TRAVEL):
            continue
        if pushed:
            return (_of_body(_moved(four), "travels"),)
        if quantity is Quantity.HUB_ACCELERATION:
            return (_of_wheels(bench, four, "hubs", True),)
        found.append(_of_wheels(bench, four, "travels", False))
        break
    body = _body(bench, seen)
    if body is not None:
        found.append(_of_body(body, "body's motion"))
    return tuple(found)


def _four(seen: tuple[Trace, ...], quantity: Quantity) -> tuple[Trace, ...] | None:
    of = {t.channel.corner: t for t in seen if t.channel.quantity is quantity}
    return tuple(of[c] for c in Corner) if all(c in of for c in Corner) else None


def _of_wheels(bench: Bench, four: tuple[Trace, ...], by: str, quick: bool) -> Pattern:
    """Compare the strikes; by the hubs' energies, which need not come at the same time."""
    if quick:
        size = np.array([trace.rms(-_STRIKE_S / 2, _AXLES_S) for trace in four])
    else:  # a wheel on the board goes up, and the body, which rises after it, draws the others down
        size = np.array([np.max(trace.part(0.0, bench.bump_s), initial=0.0) for trace in four])
    return _of_strikes(size / max(float(np.linalg.norm(size)), 1e-12), by)


def _of_strikes(size: Corners, by: str) -> Pattern:
    likeness = [float(size @ s.corners) ** 2 / sum(s.corners) for s in STRIKES]
    best = STRIKES[int(np.argmax(likeness))]
    alike = {
        kind: max(like for like, s in zip(likeness, STRIKES, strict=True) if s.excitation is kind)
        for kind in Excitation
    }
    kind = best.excitation or "none of the four"
    return Pattern(_shares(size), alike, f"{kind}: {best.words}", by, PURITY)


def _shares(size: Corners) -> Mapping[str, float]:
    power = {name: float(size @ row) ** 2 for name, row in PATTERNS.items()}
    total = max(sum(power.values()), 1e-24)
    return MappingProxyType({name: value / total for name, value in power.items()})


def _moved(four: tuple[Trace, ...]) -> Corners:
    """Return how the corners move together: the strongest pattern of the four records, (4,)."""
    grid = np.arange(0.0, min(trace.time_s[-1] for trace in four), 0.01)
    rows = np.array([np.interp(grid, trace.time_s, trace.value) for trace in four])
    u, s, _ = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(u[:, 0] * s[0])


def _body(bench: Bench, seen: tuple[Trace, ...]) -> Corners | None:
    """Return heave, pitch and roll of the body as what they are at the corners, m/s, (3,)."""
    geometry = bench.vehicle.geometry
    length_m = (geometry.a + geometry.b) / 2 if geometry else _HALF_WHEELBASE_M
    width_m = (geometry.t_f + geometry.t_r) / 2 if geometry else _HALF_TRACK_M
    stop_s = bench.bump_s + _STRIKE_S
    points = [t for t in seen if t.channel.quantity is Quantity.BODY_ACCELERATION]
    turns: dict[str, float] = {}
    for quantity, lever_m in (
        (Quantity.PITCH_RATE, length_m),
        (Quantity.ROLL_RATE, width_m),
        (Quantity.PITCH_ACCELERATION, length_m),
        (Quantity.ROLL_ACCELERATION, width_m),
    ):
        found = [t for t in seen if t.channel.quantity is quantity]
        if found:
            axis = "pitch" if "pitch" in quantity else "roll"
            turns.setdefault(axis, lever_m * _swing(found[0], stop_s))
    if points and len(turns) == 2:
        heave = np.mean([_swing(trace, stop_s) for trace in points])
        return np.array([float(heave), turns["pitch"], turns["roll"]])
    return _by_points(points, length_m, width_m, stop_s)


def _swing(trace: Trace, stop_s: float) -> float:
    """Return the largest speed within the strike, SI; of a rate, the rate itself."""
    first, last = np.searchsorted(trace.time_s, [-_STRIKE_S / 2, stop_s])
    value, time_s = trace.value[first:last], trace.time_s[first:last]
    if len(value) < 2:
        return 0.0
    if trace.channel.quantity in (Quantity.PITCH_RATE, Quantity.ROLL_RATE):
        return float(np.max(np.abs(value)))
    speed = np.cumsum((value[1:] + value[:-1]) / 2 * np.diff(time_s))
    return float(np.max(np.abs(speed)))


def _by_points(
    points: list[Trace], length_m: float, width_m: float, stop_s: float
) -> Corners | None:
    """Return the same by three or more accelerometers at known places."""
    rows = np.array([[1.0, -t.channel.x_m, t.channel.y_m] for t in points])
    if len(points) < 3 or np.linalg.matrix_rank(rows, tol=0.1) < 3:
        return None
    rows[:, 1] -= np.mean(rows[:, 1])  # about the middle of the sensors, for want of the CG
    grid = np.arange(-_STRIKE_S / 2, stop_s, 0.002)
    values = np.array([np.interp(grid, t.time_s, t.value) for t in points])
    motion = np.cumsum(np.linalg.lstsq(rows, values, rcond=None)[0], axis=1) * 0.002
    return np.asarray(np.max(np.abs(motion), axis=1) * [1.0, length_m, width_m])


def _of_body(motion: Corners, by: str) -> Pattern:
    """Judge by heave, pitch and roll alone; warp moves the body but little more than bounce does.

    A pitch bump heaves the body as much as it turns it: the likeness counts each turning against
    heave alone, and only what clearly belongs to another kind is refused.
    """
    if len(motion) == 4:  # corners' travels: a push moves all of them by the body
        shares = _shares(motion)
        size = np.sqrt([shares["bounce"], shares["pitch"], shares["roll"]])
    else:
        size = np.asarray(motion / max(float(np.linalg.norm(motion)), 1e-12))
        power = size**2 / max(float(np.sum(size**2)), 1e-24)
        shares = MappingProxyType(
            {name: float(p) for name, p in zip(("bounce", "pitch", "roll"), power, strict=True)}
        )
    heave, pitch, roll = (float(s) for s in size)
    turn = max(pitch, roll)
    still = 1.0 - min(turn / max(heave, 1e-12) / _TURN, 1.0) / 2
    likeness = {
        Excitation.BOUNCE: still,
        Excitation.WARP: still,
        Excitation.PITCH: _likeness(pitch, heave, roll),
        Excitation.ROLL: _likeness(roll, heave, pitch),
    }
    best = max(likeness, key=lambda kind: likeness[kind])
    words = {
        Excitation.PITCH: "pitch: nose and tail against each other",
        Excitation.ROLL: "roll: left and right against each other",
    }.get(best, "bounce: the body stays level")
    return Pattern(shares, likeness, words, by, BODY_PURITY)


_TURN = 0.9
"""Turning over heave from which on the body does not bounce."""


def _likeness(own: float, heave: float, other: float) -> float:
    """Return how much of a turn it is: by its share of both turns, if it turns at all."""
    turning = min(own / max(heave, 1e-12) / 0.4, 1.0)
    return turning * own**2 / max(own**2 + other**2, 1e-24)


def wrong_mode(due: Excitation, found: Pattern) -> Iterator[Finding]:
    """Compare with the kind of bump that is due."""
    like, limit = found.likeness[due], found.limit
    shares = ", ".join(f"{name} {share:.0%}" for name, share in found.shares.items())
    if like >= limit:
        text = f"a {due} bump by the {found.by}, {like:.0%} pure (limit {limit:.0%}); {shares}"
        yield finding("wrong_mode", True, like, limit, "", text)
        return
    text = (
        f"looks like {found.words}, not {due} ({like:.0%} {due}, at least {limit:.0%}; by the "
        f"{found.by}: {shares})"
    )
    yield finding("wrong_mode", False, like, limit, "", text)
