"""Resamples at equidistant times, for programs that need them, by cubic splines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...runs import Run, SampleGroup
from ...sessions import Session

_MAX_SAMPLES = 1 << 24


def with_even_times(session: Session, rate_hz: float) -> Session:
    """Return a session with all samples at a rate, at times with the digits of universal files.

    Missing samples are filled by the spline; a channel with fewer than four samples is left out.
    Raises InputError if the rate is invalid, or gives more samples than a file should have.
    """
    if not 0.0 < rate_hz < float("inf"):
        raise InputError("--rate", f"{rate_hz:g} Hz is not a rate", "give samples per second")
    return replace(session, runs=tuple(_run(run, rate_hz) for run in session.runs))


def even_times(time_s: NDArray[np.float64], rate_hz: float) -> NDArray[np.float64]:
    """Return equidistant times from the first to the last; their start and step have six digits."""
    step = float(f"{1.0 / rate_hz:.5e}")
    first, last = float(time_s[0]), float(time_s[-1])
    start = float(f"{first:.5e}")
    start += step * (start < first)
    start = float(f"{start:.5e}")
    count = int((last - start) / step) + 1 if last >= start else 0
    if count > _MAX_SAMPLES:
        raise InputError("--rate", f"{rate_hz:g} Hz gives {count} samples", "choose a lower rate")
    return np.asarray(start + step * np.arange(count), np.float64)


def _run(run: Run, rate_hz: float) -> Run:
    groups = [_group(group, rate_hz) for group in run.groups if len(group.time_s)]
    return replace(run, groups=tuple(group for group in groups if len(group.time_s)))


def _group(group: SampleGroup, rate_hz: float) -> SampleGroup:
    from scipy.interpolate import CubicSpline

    time_s = even_times(group.time_s, rate_hz)
    values = {}
    for name, own in group.values.items():
        there = np.isfinite(own)
        if there.sum() >= 4:
            spline = CubicSpline(group.time_s[there], own[there])
            values[name] = np.asarray(spline(time_s), np.float64)
    t_ns = int(group.t_ns[0]) + np.rint((time_s - group.time_s[0]) * 1e9).astype(np.int64)
    return SampleGroup(group.name, time_s, t_ns, values, np.zeros(len(time_s), np.uint8))
