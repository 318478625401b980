"""Load, silence, strangers and pauses of the buses, from both sides of each limit."""

from __future__ import annotations

from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from daq.bench.config import BusConfig, bench_codec, load_bench
from daq.check.bus_checks import check_traffic
from daq.check.check import CheckReport, check_bench
from daq.check.frame_checks import frame_table
from dbc import Codec, FrameBatch, FrameFlag
from dbc.finding import Finding, Severity

from .test_frame_limits import MESSAGE, beats, sent

CODEC = Codec((MESSAGE,))


def bus(channel: str, bitrate: int = 500_000) -> BusConfig:
    return BusConfig("virtual", channel, bitrate)


def traffic(*frames: FrameBatch, buses: tuple[BusConfig, ...] = (bus("can0"),)) -> list[Finding]:
    batch = FrameBatch.concatenate(frames)
    messages = CODEC.messages
    return check_traffic(messages, frame_table(messages, batch), CODEC.decode(batch), buses)


@pytest.mark.parametrize(("bitrate", "heavy"), [(14_500, False), (14_200, True)])
def test_a_bus_is_heavily_loaded_from_four_fifths_on(bitrate: int, heavy: bool) -> None:
    """101 frames of 114.7 bits in a second are 11,585 bit/s: 80 % of 14,481."""
    (line,) = traffic(sent(beats(101)), buses=(bus("can0", bitrate),))
    assert line.severity is (Severity.WARNING if heavy else Severity.NOTE)
    assert line.subject == "bus"
    assert line.text == f"101 frames in 1.00 s, about {82 if heavy else 80} % of the bit rate"
    assert bool(line.advice) is heavy
    assert line.figures["frames"] == 101
    assert line.figures["seconds"] == pytest.approx(1.0)
    assert line.figures["load"] == pytest.approx(101 * 114.7 / bitrate)
    (once,) = traffic(sent([0.0]))
    assert once.figures["load"] == 0.0


def test_each_bus_is_named_and_one_without_frames_fails() -> None:
    three = (bus("can0"), bus("can1", 250_000), bus("can2"))
    lines = traffic(sent(beats(51)), sent(beats(101), bus=1), buses=three)
    assert [(line.subject, line.severity) for line in lines] == [
        ("bus can0", Severity.NOTE),
        ("bus can1", Severity.NOTE),
        ("bus can2", Severity.ERROR),
    ]
    assert lines[2].text == "no frame in 1.00 s"
    loads = [line.figures["load"] for line in lines[:2]]
    assert loads == pytest.approx([51 * 114.7 / 500_000, 101 * 114.7 / 250_000])
    two = (bus("can0"), bus("can1", 250_000))
    beyond = traffic(sent(beats(101)), sent(beats(101), bus=1), sent(beats(101), bus=5), buses=two)
    assert [line.subject for line in beyond] == ["bus can0", "bus can1", "bus 5"]
    assert beyond[2].figures["load"] == pytest.approx(101 * 114.7 / 250_000)


@pytest.mark.parametrize(("n", "more"), [(6, ""), (7, " and 1 more"), (9, " and 3 more")])
def test_six_strangers_are_listed(n: int, more: str) -> None:
    strangers = [sent(beats(101 - k), 0x700 + k) for k in range(n)]
    _, line = traffic(sent(beats(101)), *strangers)
    shown = ", ".join(f"0x70{k} (100 Hz)" for k in range(6))
    assert line.text == f"{n} identifiers are not in the DBC: {shown}{more}"
    assert line.figures["unknown"] == n
    (_, one) = traffic(sent(beats(101)), strangers[0])
    assert one.text == "1 identifier is not in the DBC: 0x700 (100 Hz)"


def test_a_stranger_of_the_other_width_is_named_with_its_twin() -> None:
    _, line = traffic(sent(beats(9)), sent(beats(9), 256, flags=FrameFlag.EXTENDED))
    assert line.advice == "0x100 comes with 29 bits; the DBC has M with 11"
    wide = replace(MESSAGE, is_extended=True)
    batch = sent(beats(9))
    table = frame_table((wide,), batch)
    *_, line = check_traffic((wide,), table, Codec((wide,)).decode(batch), (bus("can0"),))
    assert line.advice == "0x100 comes with 11 bits; the DBC has M with 29"


def report(frames: FrameBatch) -> CheckReport:
    bench = replace(load_bench(None), channels=())
    return check_bench(bench, bench_codec(bench), frames, date(2026, 6, 1))


@pytest.mark.parametrize(("gap_s", "pauses"), [(0.49, 0), (0.51, 1)])
def test_fifty_intervals_without_a_frame_are_a_pause(gap_s: float, pauses: int) -> None:
    first, second = beats(101), 1.0 + gap_s + beats(201)
    found = report(sent(np.concatenate([first, second]), 0x7FF))
    assert len([line for line in found.lines if line.code == "pause"]) == pauses
    assert found.frames == (201 if pauses else 302)
    assert found.seconds == pytest.approx(2.0 if pauses else 3.0 + gap_s)


def test_of_several_stretches_the_longest_is_checked() -> None:
    parts = [beats(51), 10.0 + beats(301), 20.0 + beats(101)]
    found = report(sent(np.concatenate(parts), 0x7FF))
    (line,) = [line for line in found.lines if line.code == "pause"]
    assert line.text.startswith("2 pauses without any frame, 16.5 s in all")
    assert line.text.endswith("3.0 s")
    assert line.figures["pauses"] == 2
    assert line.figures["paused_s"] == pytest.approx(16.5)
    assert found.frames == 301
    assert found.seconds == pytest.approx(3.0)


def test_of_nothing_there_is_no_time_and_no_frame() -> None:
    found = report(FrameBatch.empty())
    assert (found.frames, found.seconds) == (0, 0.0)
    assert [line.code for line in found.lines] == ["no_frames"]
