"""Each limit of buses and messages, from both sides, on frames made by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import BusConfig
from daq.bench.sensors import SampleSet, SensorClock
from daq.channels import Channel, Quantity
from daq.check.frame_checks import check_buses, check_messages, frame_table, mixed_messages
from daq.samples.mapping import Timekeeping, map_channels
from dbc import Codec, FrameBatch, parse_codec
from dbc.codec import CounterRule, MessageLayout
from dbc.words import Finding, Severity

from ..small_campaign import frames_at

T_NS = 1_800_000_000_000_000_000
WARN, FAIL, OK = Severity.WARNING, Severity.ERROR, Severity.NOTE
DBC = """VERSION ""

BU_: A

BO_ 256 M: 8 A
 SG_ cnt : 0|8@1+ (1,0) [0|0] "" A
 SG_ v : 8|8@1- (0.001,0) [0|0] "m" A
 SG_ stamp : 16|32@1+ (1,0) [0|0] "us" A
 SG_ crc : 56|8@1+ (1,0) [0|0] "" A
"""
(MESSAGE,) = parse_codec(DBC, "m.dbc").messages
COUNTED = replace(MESSAGE, counter=CounterRule("cnt", 256))
CHECKED = replace(MESSAGE, crc="crc", crc_rule="sum8")
CODEC = Codec((MESSAGE,))
CLOCKS = {"M": SensorClock("M.stamp", 1e-6, 2.0**32)}


def message(cycle_s: float | None = 0.01, plain: MessageLayout = MESSAGE) -> MessageLayout:
    return replace(plain, cycle_s=cycle_s)


def sent(times_s: Sequence[float] | NDArray[np.float64], can_id: int = 256, **columns: Any) -> Any:
    """Return frames at these times whose second byte changes; other columns as stated."""
    t_ns = T_NS + np.rint(np.asarray(times_s) * 1e9).astype(np.int64)
    data = np.zeros((len(t_ns), 8), np.uint8)
    data[:, 1] = np.arange(len(t_ns)) * 7
    return frames_at(t_ns, **{"data": data, "can_id": can_id, **columns})


def beats(n: int, period_s: float = 0.01) -> NDArray[np.float64]:
    return np.arange(float(n)) * period_s


def checked(
    described: MessageLayout,
    *frames: FrameBatch,
    clocks: Mapping[str, SensorClock] | None = None,
    quantity: Quantity = Quantity.BODY_DISPLACEMENT,
) -> list[Finding]:
    batch = FrameBatch.concatenate(frames)
    one = Channel("c", quantity, signal="M.v")
    mapped = map_channels((one,), (described,), "m.dbc")
    keeping = Timekeeping({"M": described}, clocks or {}, ())
    decoded = Codec((described,)).decode(batch)
    return check_messages(mapped, keeping, frame_table((described,), batch), decoded)


def found(lines: Sequence[Finding]) -> dict[str, Severity]:
    assert {line.subject for line in lines} == {"message M"}
    return {line.code: line.severity for line in lines}


@pytest.mark.parametrize(
    ("off", "verdict"),
    [
        (0.019, OK), (-0.019, OK), (0.021, WARN), (-0.021, WARN),
        (0.099, WARN), (-0.099, WARN), (0.101, FAIL), (-0.101, FAIL),
    ],
)  # fmt: skip
def test_a_rate_may_be_two_percent_off_and_fails_from_ten_on(off: float, verdict: Severity) -> None:
    lines = checked(message(), sent(beats(300, 0.01 / (1 + off))))
    assert found(lines) == {"rate": verdict}
    assert lines[0].figures["rate_hz"] == pytest.approx(100 * (1 + off), rel=1e-6)
    if verdict is not OK:
        assert lines[0].text == f"{100 * (1 + off):.1f} Hz instead of 100.0 Hz"
        assert f"cycle_ms = {10 / (1 + off):.3g} " in lines[0].advice
        (once,) = checked(message(), sent([0.0]))
        assert (once.severity, "cycle_ms" in once.advice) == (FAIL, False)


@pytest.mark.parametrize(
    ("cycle_s", "silent_s", "stale"),
    [(0.01, 0.49, False), (0.01, 0.51, True), (0.1, 0.99, False), (0.1, 1.01, True),
     (None, 0.49, False), (None, 0.51, True)],
)  # fmt: skip
def test_a_message_is_stale_after_half_a_second_or_ten_cycles(
    cycle_s: float | None, silent_s: float, stale: bool
) -> None:
    times = beats(30, cycle_s or 0.01)
    lines = checked(message(cycle_s), sent(times), sent([times[-1] + silent_s], 0x700))
    assert (found(lines).get("stale") is FAIL) is stale
    if stale:
        assert lines[0].text == f"silent for the last {silent_s:.2f} s"


@pytest.mark.parametrize(
    ("length", "verdict", "says"),
    [(7, FAIL, "3 of 30 frames have 7 bytes; the DBC says 6"), (5, FAIL, "3 of 30"), (6, OK, "")],
)
def test_a_frame_has_the_length_of_the_dbc(length: int, verdict: Severity, says: str) -> None:
    short = replace(MESSAGE, length=6, signals=MESSAGE.signals[:3], cycle_s=0.01)
    lengths = np.full(30, 6)
    lengths[5:8] = length
    lines = checked(short, sent(beats(30), length=lengths))
    expected = WARN if length > 6 else verdict
    assert found(lines) == ({"length": expected} if length != 6 else {"rate": OK})
    if length != 6:
        assert lines[0].text.startswith(says)


def with_checksums(n: int, bad: int) -> NDArray[np.uint8]:
    """Return payloads with a sum modulo 256 behind them, of some of which it is wrong."""
    data = np.zeros((n, 8), np.uint8)
    data[:, 0] = np.arange(n) % 256
    data[:, 7] = data[:, 0]
    data[:bad, 7] ^= 0x55
    return data


@pytest.mark.parametrize(
    ("bad", "verdict", "advice"),
    [(0, OK, ""), (2, WARN, "check wiring"), (3, FAIL, "check wiring"),
     (100, FAIL, "check wiring"), (101, FAIL, "no rule matches"), (200, FAIL, "no rule matches")],
)  # fmt: skip
def test_one_checksum_in_a_hundred_may_fail(bad: int, verdict: Severity, advice: str) -> None:
    lines = checked(message(plain=CHECKED), sent(beats(200), data=with_checksums(200, bad)))
    assert found(lines) == ({"checksum": verdict} if bad else {"rate": OK})
    assert lines[0].advice.startswith(advice)
    if bad:
        assert lines[0].text == f"{bad} of 200 frames have a wrong checksum (sum8)"


def counted(values: Sequence[int] | NDArray[np.int64]) -> NDArray[np.uint8]:
    data = np.zeros((len(values), 8), np.uint8)
    data[:, 0] = values
    return data


@pytest.mark.parametrize(("n", "still"), [(10, False), (11, True)])
def test_a_counter_stands_still_if_eleven_frames_have_the_same(n: int, still: bool) -> None:
    lines = checked(message(plain=COUNTED), sent(beats(n), data=counted([9] * n)))
    assert ("does not change from 9" in lines[0].text) is still
    assert (found(lines).get("counter") is FAIL) is still


@pytest.mark.parametrize(("lost", "verdict"), [(0, OK), (2, WARN), (3, FAIL)])
def test_one_frame_in_a_hundred_may_be_missing(lost: int, verdict: Severity) -> None:
    """Of 250: 2 missing are 0.8 % of the 248 that came, 3 are 1.2 %."""
    keep = np.ones(250, bool)
    keep[20 : 20 + 50 * lost : 50] = False
    frames = sent(beats(250)[keep], data=counted(np.arange(250)[keep]))
    lines = checked(message(plain=COUNTED), frames)
    assert found(lines) == ({"counter": verdict} if lost else {"rate": OK})
    if lost:
        text = f"{lost} frames are missing according to the counter cnt (of {250 - lost})"
        assert lines[0].text == text


@pytest.mark.parametrize(("modulus", "beyond"), [(100, False), (99, True)])
def test_a_counter_that_reaches_its_modulus_has_another(modulus: int, beyond: bool) -> None:
    described = replace(COUNTED, counter=CounterRule("cnt", modulus), cycle_s=0.01)
    lines = checked(described, sent(beats(200), data=counted(np.arange(200) % 100)))
    text = "the counter cnt reaches 99, beyond 98"
    assert (lines[0].text == text and lines[0].severity is FAIL) is beyond


def test_a_counter_that_starts_anew_is_a_sensor_that_restarts() -> None:
    values = np.concatenate([np.arange(60), np.arange(40)])
    lines = checked(message(plain=COUNTED), sent(beats(100), data=counted(values)))
    assert found(lines) == {"counter": FAIL}
    assert lines[0].text == "the counter cnt started again 1 time"


@pytest.mark.parametrize(
    ("rate", "verdict"),
    [(1.19, OK), (0.81, OK), (1.21, FAIL), (0.79, FAIL)],
)
def test_a_sensors_clock_runs_with_that_of_the_bus(rate: float, verdict: Severity) -> None:
    """Its 32 bits of microseconds begin anew on the way."""
    data = np.zeros((200, 8), np.uint8)
    stamp = (2**32 - 500_000 + np.rint(np.arange(200) * 1e4 * rate).astype(np.int64)) % 2**32
    data[:, 2:6] = stamp.astype("<u4")[:, None].view(np.uint8).reshape(200, 4)
    data[:, 1] = np.arange(200)
    lines = checked(message(), sent(beats(200), data=data), clocks=CLOCKS)
    assert found(lines) == ({"clock": verdict} if verdict is not OK else {"rate": OK})
    if verdict is not OK:
        assert lines[0].text.startswith(f"M.stamp runs {rate:.4g} times as fast")
    few = sent(beats(9), data=data[:9])
    assert found(checked(message(), few, clocks=CLOCKS)) == {"rate": OK}
    ten = checked(message(), sent(beats(10), data=data[:10]), clocks=CLOCKS)
    assert ("clock" in found(ten)) is (verdict is not OK)


@pytest.mark.parametrize(
    ("quantity", "verdict"), [(Quantity.BODY_DISPLACEMENT, FAIL), (Quantity.UNUSED, WARN)]
)
def test_an_absent_message_fails_if_it_is_used(quantity: Quantity, verdict: Severity) -> None:
    (line,) = checked(message(), sent(beats(100), 0x123), quantity=quantity)
    assert (line.code, line.severity) == ("absent", verdict)
    assert line.text == "no frame with identifier 0x100"
    slow = checked(message(), sent(beats(300, 0.02)), quantity=quantity)
    assert found(slow) == {"rate": verdict}


def test_a_message_that_numbers_the_samples_of_others_must_come() -> None:
    carrier = replace(message(), name="C", can_id=0x101)
    mapped = map_channels((Channel("c", Quantity.UNUSED, signal="M.v"),), (message(),), "m.dbc")
    sets = (SampleSet(name="set", messages=("M",), bound_by="C.cnt"),)
    keeping = Timekeeping({"M": message(), "C": carrier}, {}, sets)
    messages = (message(), carrier)
    batch = sent(beats(30))
    table, decoded = frame_table(messages, batch), Codec(messages).decode(batch)
    lines = check_messages(mapped, keeping, table, decoded)
    assert [(line.subject, line.code, line.severity) for line in lines] == [
        ("message M", "rate", OK),
        ("message C", "absent", FAIL),
    ]


@pytest.mark.parametrize(
    ("quantity", "verdict"), [(Quantity.BODY_DISPLACEMENT, FAIL), (Quantity.UNUSED, WARN)]
)
def test_a_message_on_two_buses_is_two_sensors(quantity: Quantity, verdict: Severity) -> None:
    one, other = sent(beats(50, 0.02)), sent(beats(50, 0.02) + 0.01, bus=1)
    lines = checked(message(), one, other, quantity=quantity)
    assert found(lines)["mixed_buses"] is verdict
    assert "comes on the buses 0 and 1" in lines[0].text
    both = FrameBatch.concatenate([one, other])
    assert mixed_messages((MESSAGE,), both) == ("M",)
    assert mixed_messages((MESSAGE,), one) == ()
    assert mixed_messages((MESSAGE,), FrameBatch.empty()) == ()


# The buses ----------------------------------------------------------------------------------------


def bus(channel: str, bitrate: int = 500_000) -> BusConfig:
    return BusConfig("virtual", channel, bitrate)


def traffic(*frames: FrameBatch, buses: tuple[BusConfig, ...] = (bus("can0"),)) -> list[Finding]:
    batch = FrameBatch.concatenate(frames)
    errors = CODEC.decode(batch).counts.error_frames
    return check_buses(frame_table((MESSAGE,), batch), errors, buses)


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


@pytest.mark.parametrize(("n", "more"), [(6, ""), (7, " and 1 more"), (9, " and 3 more")])
def test_six_strangers_are_listed(n: int, more: str) -> None:
    strangers = [sent(beats(101 - k), 0x700 + k) for k in range(n)]
    _, line = traffic(sent(beats(101)), *strangers)
    shown = ", ".join(f"0x70{k} (100 Hz)" for k in range(6))
    assert line.text == f"{n} identifiers are not in the DBC: {shown}{more}"
    assert line.figures["unknown"] == n
    (_, one) = traffic(sent(beats(101)), strangers[0])
    assert one.text == "1 identifier is not in the DBC: 0x700 (100 Hz)"
