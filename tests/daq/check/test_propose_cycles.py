"""The cycle of a message that is another one than its database states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import Bench, bench_codec, parse_bench
from daq.bench.databases import Database, stored_text
from daq.bench.ready_maps import ready_map
from daq.check.propose import propose_sensors
from dbc import FrameBatch

from ..sensor_frames import START_NS
from ..wild_bench import POT


def frames_every(ms: float, *can_ids: int, length: int = 7) -> FrameBatch:
    """Return 3 s of frames that hold a counter in their last byte."""
    n = round(3000 / ms)
    t_ns = np.repeat(START_NS + np.round(np.arange(n) * ms * 1e6).astype(np.int64), len(can_ids))
    data = np.zeros((len(t_ns), 8), np.uint8)
    data[:, length - 1] = np.repeat(np.arange(n), len(can_ids)) % 256
    return FrameBatch(
        t_ns,
        np.tile(np.array(can_ids, np.uint32), n),
        np.zeros(len(t_ns), np.uint16),
        np.zeros(len(t_ns), np.uint8),
        np.full(len(t_ns), length, np.uint8),
        data,
    )


def proposed(frames: FrameBatch, *databases: Database) -> tuple[str, Bench]:
    text = propose_sensors(databases, (), frames, None).text
    return text, parse_bench(text, "proposed", Path(), stored_text(databases))


@pytest.mark.parametrize(
    ("ms", "stated"), [(5.0, None), (4.6, None), (4.5, 4.5), (5.5, None), (5.6, 5.6)]
)
def test_a_rate_of_more_than_a_tenth_off_is_stated(ms: float, stated: float | None) -> None:
    text, bench = proposed(frames_every(ms, 385), Database("pot.dbc", POT))
    assert [rule.cycle_ms for rule in bench.message_rules] == (
        [pytest.approx(stated)] if stated else []
    )
    assert ("not the 200.0 Hz of its database" in text) == bool(stated)


def test_a_message_without_a_channel_keeps_its_cycle() -> None:
    frames = FrameBatch.concatenate([frames_every(5.0, 385), frames_every(100.0, 1793, length=1)])
    _, bench = proposed(frames, Database("pot.dbc", POT))
    assert bench.message_rules == ()


def test_a_ready_map_keeps_its_other_rules_at_another_cycle() -> None:
    layout = Database("layout:bosch_mm7", ready_map("bosch_mm7").dbc_text)
    alone = parse_bench('dbc = "layout:bosch_mm7"', "bench.toml", Path())
    ids = [message.can_id for message in bench_codec(alone).messages]
    pot = frames_every(5.0, 385)
    for ms, rate in ((5.0, 3), (10.0, 0)):
        frames = FrameBatch.concatenate([frames_every(ms, *ids, length=8), pot])
        text, bench = proposed(frames, layout, Database("pot.dbc", POT))
        assert text.count("measured 200.0 Hz, not the 100.0 Hz") == rate
        own = [m for m in bench_codec(bench).messages if m.name.startswith("bosch_mm7.")]
        assert [m.cycle_s for m in own] == [ms * 1e-3] * 3
        assert [m.counter and m.counter.signal for m in own] == ["counter"] * 3


def test_what_a_comment_says_of_a_signal_holds_for_every_device_of_its_kind() -> None:
    text = (
        'VERSION ""\n\nBU_: A\n\nBO_ 385 Gyro: 8 A\n SG_ w : 0|16@1- (0.01,0) [0|0] "deg/s" A\n'
        'CM_ SG_ 385 w "pitch rate of the car";\nBA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;\n'
        'BA_DEF_DEF_ "GenMsgCycleTime" 5;\n'
    )
    _, bench = proposed(frames_every(5.0, 385, 387, length=8), Database("gyro.dbc", text))
    assert [(s.name, s.id_offset) for s in bench.sensors] == [("gyro_1", 0), ("gyro_2", 2)]
    assert [c.quantity for c in bench.channels] == ["pitch_rate", "pitch_rate"]
