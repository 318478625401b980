"""Channels that are frozen, saturated or no number, on samples made by hand."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.alarms.signals import (
    Limits,
    SignalsWatch,
    Standing,
    _stand,
    advance_signals,
    limits_of,
    signal_symptoms,
)
from daq.channels import Quantity
from daq.samples.mapping import MappedChannel
from dbc import FrameBatch
from dbc.samples import Quality, Samples

from ..watched_bench import CODEC, MAPPED, frames

USED = next(m for m in MAPPED if m.channel.quantity is not Quantity.UNUSED)
T_NS = 1_800_000_000_000_000_000
NOTHING = FrameBatch.concatenate([frames(0x700, [bytes(8)], T_NS)]).select(np.zeros(0, np.intp))


def samples(values: list[float], start: int = 0, quality: int = 0) -> Samples:
    array: NDArray[np.float64] = np.array(values)
    t_ns = T_NS + (start + np.arange(len(values))) * 10**8
    return Samples("a.b", t_ns, array, np.full(len(values), quality, np.uint8))


def test_equal_samples_in_a_row_are_counted() -> None:
    one = _stand(None, samples([2.0, 2.0, 2.0]), 2.0, 2.0, True)
    assert one == Standing(2.0, T_NS, 3, T_NS + 2 * 10**8, 1)
    two = _stand(one, samples([2.0, 2.0], 3), 2.0, 2.0, False)
    assert two == Standing(2.0, T_NS, 5, T_NS + 4 * 10**8, 1)
    three = _stand(two, samples([2.0], 5), 2.0, 2.0, True)
    assert (three.samples, three.moving) == (6, 2)
    assert _stand(two, samples([4.0], 5), 4.0, 4.0, False).samples == 1
    moved = _stand(two, samples([2.0, 5.0], 5), 2.0, 5.0, True)
    assert moved == Standing(5.0, T_NS + 6 * 10**8, 1, T_NS + 6 * 10**8, 0)


@pytest.mark.parametrize(
    ("still_s", "moving", "fine", "n", "stuck"),
    [
        (0.79, 0, True, 500, ""),
        (0.8, 0, True, 500, "not even noise for 0.8 s"),
        (0.8, 0, False, 500, ""),
        (0.1, 2, False, 500, ""),
        (0.1, 3, False, 500, "while others move"),
        (0.8, 3, True, 2, ""),
    ],
)
def test_a_frozen_sensor(still_s: float, moving: int, fine: bool, n: int, stuck: str) -> None:
    standing = Standing(1.5, T_NS, n, T_NS + round(still_s * 1e9), moving)
    limits = Limits(-1.0, 1.0, 0.01, fine, "-1 to 1")
    found = signal_symptoms(SignalsWatch((), {"a": limits}, {"a": standing}))
    assert [s.code for s in found] == ["stuck"] * bool(stuck)
    if stuck:
        assert found[0].text.startswith("500 samples in a row are 1.5")
        assert found[0].text.endswith(stuck)


def with_signal(mapped: MappedChannel, **facts: Any) -> MappedChannel:
    changed = replace(mapped.signal, **facts)
    signals = tuple(changed if s is mapped.signal else s for s in mapped.message.signals)
    return replace(mapped, message=replace(mapped.message, signals=signals))


def test_the_range_is_that_of_the_bits_or_a_narrower_one_of_the_dbc() -> None:
    mapped = USED
    low, high = mapped.signal.span
    wide = with_signal(mapped, minimum=low - 1, maximum=high + 1)
    assert (limits_of(wide).low, limits_of(wide).high) == (low, high)
    narrow = with_signal(mapped, minimum=-1.0, maximum=2.0)
    assert (limits_of(narrow).low, limits_of(narrow).high) == (-1.0, 2.0)
    assert limits_of(narrow).range_text == f"-1 to 2 {mapped.signal.unit}"
    none = with_signal(mapped, minimum=0.0, maximum=0.0)
    assert (limits_of(none).low, limits_of(none).high) == (low, high)
    bit = with_signal(mapped, length=1)
    assert (limits_of(bit).low, limits_of(bit).high) == (-np.inf, np.inf)


def channel_turn(values: list[float], quality: int = 0) -> tuple[SignalsWatch, dict[str, int]]:
    """Return one turn of a channel from -4 to 4, and what was counted in it."""
    mapped = with_signal(USED, minimum=-4.0, maximum=4.0)
    decoded = CODEC.decode(NOTHING)
    signal = mapped.channel.signal
    decoded = replace(decoded, samples={signal: samples(values, 0, quality)})
    watch, counts = advance_signals(SignalsWatch(), (mapped,), decoded)
    return watch, {code: count.number for (code, _), count in counts.items()}


@pytest.mark.parametrize(
    ("values", "saturated"),
    [
        ([3.99, -3.99], 0),
        ([4.0, 3.0, 4.1], 2),
        ([-4.0, 0.0, 3.0], 1),
        ([-4.0, 4.0], 2),
        ([np.nan, 4.0], 1),
        ([np.inf, 3.0], 0),
        ([-np.inf, 3.0], 0),
    ],
)
def test_samples_at_the_end_of_the_range_are_counted(values: list[float], saturated: int) -> None:
    watch, counts = channel_turn(values)
    assert counts.get("saturated", 0) == saturated
    assert counts.get("not_a_number", 0) == int((~np.isfinite(values)).sum())
    assert watch.overloaded == (USED.channel.name,) * bool(saturated)


def test_samples_that_cannot_be_used_are_counted_by_their_kind() -> None:
    assert channel_turn([1.0, 2.0], int(Quality.SENTINEL))[1] == {"no_value": 2}
    assert channel_turn([1.0, 9.0], int(Quality.OUT_OF_RANGE))[1] == {
        "out_of_range": 2,
        "saturated": 1,
    }
    assert channel_turn([1.0, 9.0], int(Quality.CRC_BAD))[1] == {}
    assert channel_turn([1.0, 9.0], int(Quality.CRC_BAD))[0].standing == {}


@pytest.mark.parametrize(
    ("value", "gain", "counted"),
    [
        (0.99e6, 1.0, 0),
        (1.01e6, 1.0, 1),
        (-1.01e6, 1.0, 1),
        (0.51e6, -2.0, 1),
        (0.49e6, -2.0, 0),
        (1e300, 1.0, 1),
        (-np.inf, 1.0, 1),
    ],
)
def test_a_value_that_no_sensor_shows_is_not_a_number(
    value: float, gain: float, counted: int
) -> None:
    """The samples of a sensor that sent 1e12 m were not used, and no alarm said so."""
    mapped = with_signal(USED, minimum=None, maximum=None, is_float=True)
    mapped = replace(mapped, factor=1.0, channel=replace(mapped.channel, gain=gain))
    decoded = replace(CODEC.decode(NOTHING), samples={mapped.channel.signal: samples([1.0, value])})
    watch, counts = advance_signals(SignalsWatch(), (mapped,), decoded)
    numbers = {code: count.number for (code, _), count in counts.items()}
    assert numbers.get("not_a_number", 0) == counted
    assert watch.standing[mapped.channel.name].value == (1.0 if counted else value)


@pytest.mark.parametrize(("steps", "moving"), [(19.0, 0), (21.0, 1)])
@pytest.mark.parametrize("alike", [True, False])
@pytest.mark.parametrize("gain", [1.0, 4.0])
def test_another_channel_of_the_kind_moves_by_more_than_twenty_steps(
    steps: float, moving: int, alike: bool, gain: float
) -> None:
    kinds = [m for m in MAPPED if m.channel.quantity is not Quantity.UNUSED]
    still, other = next(
        (one, two)
        for one, two in combinations(kinds, 2)
        if (one.channel.quantity is two.channel.quantity) is alike
    )
    other = replace(other, channel=replace(other.channel, gain=gain))
    moved = steps * limits_of(still).step / abs(other.factor * gain)
    decoded = CODEC.decode(NOTHING)
    found = {still.channel.signal: samples([1.0, 1.0]), other.channel.signal: samples([0.0, moved])}
    watch, _ = advance_signals(SignalsWatch(), (still, other), replace(decoded, samples=found))
    assert watch.standing[still.channel.name].moving == moving * alike
