"""A bench with a short campaign, and the frames of its hubs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.bench.campaign import Campaign
from daq.bench.config import Bench, TriggerConfig, load_bench
from daq.runs import Event, Excitation
from dbc import Codec, FrameBatch, parse_codec

START_NS = 1_800_000_000_000_000_000
PERIOD_S = 1.2
CAMPAIGN = Campaign((Excitation.BOUNCE, Excitation.ROLL), 1, bump_height_m=0.05)
LABELS = [step.label for step in CAMPAIGN.steps]


@cache
def small_bench() -> Bench:
    """Return the shipped bench with a campaign of four short runs."""
    return replace(
        load_bench(None),
        campaign=CAMPAIGN,
        trigger=TriggerConfig(level=3.0, pre_s=0.1, post_s=0.5, rest_s=0.1),
    )


@cache
def small_codec() -> Codec:
    return parse_codec(small_bench().dbc_text, "shipped")


def frames_at(
    t_ns: ArrayLike,
    data: NDArray[np.uint8] | None = None,
    can_id: ArrayLike = 0,
    length: ArrayLike = 8,
    flags: ArrayLike = 0,
    bus: ArrayLike = 0,
) -> FrameBatch:
    """Return frames at these times; a column may be one number for all, and data zeros."""
    stamps = np.asarray(t_ns, np.int64)
    n = len(stamps)
    columns = {"can_id": can_id, "flags": flags, "bus": bus, "length": length}
    full = {name: np.broadcast_to(column, n) for name, column in columns.items()}
    return FrameBatch(stamps, data=np.zeros((n, 8), np.uint8) if data is None else data, **full)


def bumps(codec: Codec, count: int, message: str = "HUB_Front") -> FrameBatch:
    """Frames of one message at 1 kHz: every 1.2 s, after 0.5 s of rest, 20 m/s2 for 0.2 s."""
    layout = codec.message(message)
    n = round(count * PERIOD_S * 1000)
    t_s = np.arange(n) * 1e-3
    phase_s = t_s % PERIOD_S - 0.5
    acc_g = np.where((phase_s > 0) & (phase_s < 0.2), 20 / 9.80665, 0.0)
    names = [s.name for s in layout.signals if s.name.startswith("acc")]
    data = codec.encode(message, dict.fromkeys(names, acc_g))
    return frames_at(START_NS + np.arange(n) * 1_000_000, data, layout.can_id, layout.length)


def blocks(frames: FrameBatch, size: int = 100) -> list[FrameBatch]:
    return [frames.select(slice(i, i + size)) for i in range(0, len(frames), size)]


def codes(events: Sequence[Event]) -> list[tuple[str, str]]:
    return [(event.code, event.text) for event in events]


PLANNED = [(code, label) for label in LABELS for code in ("bump", "run_end")]
