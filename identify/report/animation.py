"""Mode shapes that move without a script: SVG with SMIL."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from .shapes import Outline, Shape, at_rest, outline

_FRAMES = 20
_SCALE = 100.0  # of the drawing, units a metre
_BOX = "-218 -142 436 300"
_SLOWEST_HZ, _PERIOD_S = 1.0, 2.4
"""Frequency, Hz, of a mode that has this period, s, on the screen; half the period at ten times the
frequency."""


def moving_car(shape: Shape) -> Markup:
    """Return an SVG of the car in endless motion, with the car at rest behind it.

    `shape`: motion of the car; faster modes move faster, but far more slowly than the real car.
    """
    period = _PERIOD_S * (max(shape.frequency_hz, 0.1) / _SLOWEST_HZ) ** -0.3
    frames = [outline(shape, 2.0 * np.pi * k / _FRAMES) for k in range(_FRAMES)]
    frames.append(frames[0])
    parts = [f'<g class="rest">{_still(at_rest(shape.geometry))}</g>', '<g class="car moving">']
    for name, path_of in _PATHS:
        values = [path_of(frame) for frame in frames]
        parts.append(
            f'<path class="{name}" d="{values[0]}"><animate attributeName="d" dur="{period:.2f}s" '
            f'repeatCount="indefinite" values="{";".join(values)}"/></path>'
        )
    for wheel in range(4):
        rim = frames[0].wheels[wheel]
        heave = [frame.wheels[wheel].mean(axis=0) - rim.mean(axis=0) for frame in frames]
        steps = ";".join(f"{x * _SCALE:.1f} {y * _SCALE:.1f}" for x, y in heave)
        parts.append(
            f'<g><path class="wheel" d="{_line(rim, closed=True)}"/><animateTransform '
            f'attributeName="transform" type="translate" dur="{period:.2f}s" '
            f'repeatCount="indefinite" values="{steps}"/></g>'
        )
    parts.append(f'</g><g class="car still">{_still(frames[0])}</g>')
    name = escape(shape.title)
    return Markup(f'<svg viewBox="{_BOX}" role="img" aria-label="{name}">{"".join(parts)}</svg>')


def _still(car: Outline) -> str:
    paths = [f'<path class="{name}" d="{path_of(car)}"/>' for name, path_of in _PATHS]
    paths += [f'<path class="wheel" d="{_line(rim, closed=True)}"/>' for rim in car.wheels]
    return "".join(paths)


def _line(points: NDArray[np.float64], closed: bool) -> str:
    text = "L".join(f"{x * _SCALE:.0f} {y * _SCALE:.0f}" for x, y in points)
    return f"M{text}{'Z' if closed else ''}"


def _plates(car: Outline) -> str:
    return _line(car.deck, closed=True) + _line(car.roof, closed=True)


def _pillars(car: Outline) -> str:
    return "".join(
        _line(np.stack(ends), closed=False) for ends in zip(car.deck, car.roof, strict=True)
    )


def _springs(car: Outline) -> str:
    return "".join(_line(spring, closed=False) for spring in car.springs)


_PATHS = (("spring", _springs), ("pillar", _pillars), ("plate", _plates))
