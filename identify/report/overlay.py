"""Overlays decays of several sessions: one small figure for each run that all sessions have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..decays.decay import FreeDecay
from ..fit.estimation import Estimation
from .blocks import Gallery, Picture
from .envelope import envelope
from .panels import Floats, OverlayPanel

_BINS = 220
_SHOWN_S = 1.5
"""Seconds of a decay that are drawn; what follows is mostly noise."""
_SESSIONS = 4
"""Largest number of sessions drawn: more curves cannot be distinguished."""


def overlay_gallery(labels: Sequence[str], estimations: Sequence[Estimation]) -> Gallery | None:
    """Return the overlaid decays of sessions; None where no run is in all of them."""
    shown = estimations[:_SESSIONS]
    by_label = [{decay.label: decay for decay in one.decays} for one in shown]
    pictures = []
    for label in by_label[0] if by_label else ():
        if all(label in decays for decays in by_label):
            decays = [each[label] for each in by_label]
            panel = _panel(labels, decays, shown[0].sigma)
            if panel is not None:
                pictures.append(Picture(f"overlay_{label}", label, "", panel))
    if not pictures:
        return None
    return Gallery(
        "The same run of each session",
        "The channel that stands out most from its noise, from the start of its free decay, as "
        "measured except for a constant (the zero of a sensor says nothing about the car); grey "
        "is the first session. Bumps of another height change the size but not the shape.",
        tuple(pictures),
    )


def _panel(
    labels: Sequence[str], decays: Sequence[FreeDecay], sigma: dict[str, float]
) -> OverlayPanel | None:
    columns = [_columns(decay) for decay in decays]
    common = [name for name in columns[0] if all(name in other for other in columns)]
    if not common:
        return None
    name = max(common, key=lambda n: float(np.std(columns[0][n][1])) / sigma[n])
    unit = next(
        c.unit for r in decays[0].recordings for c in r.group.channels if c.name == name
    ).replace("2", "²")
    first = columns[0][name]
    curves = tuple(envelope(*_with_mean_of(column[name], first), _BINS) for column in columns)
    return OverlayPanel(name, unit, tuple(labels[: len(curves)]), curves)


def _with_mean_of(
    column: tuple[Floats, Floats], first: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Return a curve with the mean of the first, as each fit has its own constant for it."""
    time_s, values = column
    reference = np.interp(time_s, *first)
    return time_s, values - np.mean(values - reference)


def _columns(decay: FreeDecay) -> dict[str, tuple[Floats, Floats]]:
    found = {}
    for recording in decay.recordings:
        early = recording.time_s < _SHOWN_S
        for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
            if early.any():
                found[channel.name] = recording.time_s[early], column[early]
    return found
