"""Draws curves with their names at their ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ...report.figure import PALETTE, zero_line
from ..result import Curve, CurvePanel

_ALIKE = 0.012
"""Share of the height of the diagram within which curves look like one."""
_LINE = 0.062
"""Height of a line of text, of the height of the diagram."""
_DENSE = 100
"""A curve of more points is a signal, and drawn thin."""


def draw_curves(axes: Axes, panel: CurvePanel) -> None:
    """Draw a panel; curves that coincide share a label."""
    zero_line(axes)
    axes.set_title(panel.title)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.tick_params(axis="y", labelleft=True)  # to one scale, and legible by itself
    for curve in panel.curves:
        axes.plot(
            curve.x,
            curve.y,
            color=PALETTE[curve.hue],
            linewidth=0.9 if len(curve.x) > _DENSE else 1.6,
            linestyle=(0, (4, 2)) if curve.dashed else "-",
            solid_capstyle="round",
        )
    axes.margins(x=0.0, y=0.06)
    low, high = axes.get_ylim()
    groups = _coinciding(panel.curves, (high - low) * _ALIKE)
    wanted = np.array([group[0].y[-1] for group in groups])
    for group, place in zip(groups, _apart(wanted, (high - low) * _LINE), strict=True):
        axes.annotate(
            ", ".join(curve.label for curve in group),
            (float(group[0].x[-1]), float(group[0].y[-1])),
            xytext=(1.02, (place - low) / (high - low)),
            textcoords="axes fraction",
            color=PALETTE[group[0].hue],
            va="center",
            annotation_clip=False,
        )


def _coinciding(curves: Sequence[Curve], tolerance: float) -> list[list[Curve]]:
    """Gather curves that cannot be distinguished."""
    groups: list[list[Curve]] = []
    for curve in curves:
        for group in groups:
            first = group[0]
            same = first.hue == curve.hue and len(first.x) == len(curve.x) <= _DENSE
            if same and np.max(np.abs(first.y - curve.y)) < tolerance:
                group.append(curve)
                break
        else:
            groups.append([curve])
    return groups


def _apart(wanted: np.ndarray, least: float) -> np.ndarray:
    """Move places as little as necessary, so that none are closer than `least`, (n,)."""
    order = np.argsort(wanted, kind="stable")
    # Places less their rank times `least` only have to ascend: isotonic regression by pooling.
    pools: list[tuple[float, int]] = []
    for rank, place in enumerate(wanted[order]):
        pools.append((float(place) - rank * least, 1))
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (a, n), (b, m) = pools[-2:]
            pools[-2:] = [((a * n + b * m) / (n + m), n + m)]
    level = np.concatenate([np.full(n, value) for value, n in pools])
    placed = np.empty(len(wanted))
    placed[order] = level + least * np.arange(len(wanted))
    return placed
