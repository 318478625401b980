"""Finds the kind of a bump (`daq.bumps`) from the struck wheels, or from the body's motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dbc.finding import Finding

from ..bench.campaign import Method
from ..bench.config import Bench
from ..bumps import BUMPS, Wheels, kinds_of, mirror_images
from ..channels import Quantity
from ..runs import Excitation
from ..vehicle import Corner
from .body_motion import STRIKE_S, body_pattern, pushed_pattern
from .strikes import STRIKES, Pattern, in_words, likeness_of, shares_of
from .window import Trace
from .words import finding

PURITY = 0.8
"""Least likeness to the pattern that is due: wheels at rest show a tenth of the motion of struck
ones through body and anti-roll bars, and the struck ones differ by a third at most."""
MIRRORED = 1.25
"""Ratio of the likeness to the other side or axle to that of the one due, from which it is the
other."""
_AXLES_S = 2.5
"""Time from the front axle until the rear axle has met a board at walking pace, s."""


def patterns(bench: Bench, signals: tuple[Trace, ...]) -> tuple[Pattern, ...]:
    """Return the patterns of a bump: from four hubs, else from four travels and from the body.

    Travels alone may be misleading with stiff anti-roll bars, which move one wheel with the other.
    """
    found: list[Pattern] = []
    pushed = bench.campaign.method is Method.PUSH
    for quantity in (
        Quantity.HUB_ACCELERATION,
        Quantity.HUB_DISPLACEMENT,
        Quantity.SUSPENSION_TRAVEL,
    ):
        four = _four(signals, quantity)
        if four is None or (pushed and quantity is not Quantity.SUSPENSION_TRAVEL):
            continue
        if pushed:
            return (pushed_pattern(bench, four),)
        if quantity is Quantity.HUB_ACCELERATION:
            return (_of_wheels(bench, four, "hubs", True),)
        found.append(_of_wheels(bench, four, "travels", False))
        break
    body = body_pattern(bench, signals)
    if body is not None:
        found.append(body)
    return tuple(found)


def _four(signals: tuple[Trace, ...], quantity: Quantity) -> tuple[Trace, ...] | None:
    of = {t.channel.corner: t for t in signals if t.channel.quantity is quantity}
    return tuple(of[c] for c in Corner) if all(c in of for c in Corner) else None


def _of_wheels(bench: Bench, four: tuple[Trace, ...], by: str, quick: bool) -> Pattern:
    """Compare the strikes, from the hubs' energies, which need not come at the same time."""
    if quick:
        size = np.array([trace.rms(-STRIKE_S / 2, _AXLES_S) for trace in four])
    else:  # a wheel on the board goes up; the body rises after it and pulls the other wheels down
        way = -1.0 if bench.campaign.method is Method.DROP else 1.0
        parts = [way * trace.part(0.0, bench.campaign.bump_s) for trace in four]
        size = np.array([np.max(part, initial=0.0) for part in parts])
    size = size / max(float(np.linalg.norm(size)), 1e-12)
    like = {
        wheels: float(sum(size[corner.position] for corner in wheels)) ** 2 / len(wheels)
        for wheels in STRIKES
    }
    planned = bench.campaign.excitations
    best = max(like, key=lambda wheels: like[wheels])
    kind = next((kind.words for kind in kinds_of(best, planned)), "no kind of bump")
    words = f"{kind}: {in_words(best)}"
    return Pattern(shares_of(size), likeness_of(like, planned), words, by, PURITY, like)


def struck(due: Excitation, found: Pattern) -> Wheels | None:
    """Return the struck wheels, if they are of the kind due or its mirror image; else None."""
    if found.likeness[due] < found.limit:
        return None
    due_wheels = BUMPS[due].wheels
    best = max(mirror_images(due_wheels), key=lambda wheels: found.strikes.get(wheels, 0.0))
    clear = found.strikes.get(best, 0.0) > MIRRORED * found.strikes.get(due_wheels, 0.0)
    return best if clear else due_wheels


def mirrored(due: Excitation, found: Pattern) -> Iterator[Finding]:
    """Report a bump of another side or axle than the one that is due; both count."""
    wheels, due_wheels = struck(due, found), BUMPS[due].wheels
    if wheels is not None and wheels != due_wheels:
        text = f"{in_words(wheels)}, but {in_words(due_wheels)} were due: it still counts"
        yield finding("mirrored", True, found.strikes[wheels], found.limit, "", text)


def wrong_mode(due: Excitation, found: Pattern) -> Iterator[Finding]:
    """Compare the bump with the kind that is due."""
    like, limit = found.likeness[due], found.limit
    shares = ", ".join(f"{name} {share:.0%}" for name, share in found.shares.items())
    if like >= limit:
        text = (
            f"a {due.words} bump by the {found.by}, {like:.0%} pure (limit {limit:.0%}); {shares}"
        )
        yield finding("wrong_mode", True, like, limit, "", text)
        return
    text = (
        f"looks like {found.words}, not {due.words} ({like:.0%} {due.words}, at least {limit:.0%}; "
        f"by the {found.by}: {shares})"
    )
    yield finding("wrong_mode", False, like, limit, "", text)
