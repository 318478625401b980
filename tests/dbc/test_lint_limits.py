"""What a message may be before frames are decoded with it: each limit from both sides."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from dbc.layout import CounterRule, MessageLayout, SignalLayout
from dbc.reader.lint import FaultError, ambiguous, as_long_as_it_is, overlaps, usable_part


def signal(name: str = "s", **facts: Any) -> SignalLayout:
    plain: dict[str, Any] = {
        "unit": "", "start": 0, "length": 8, "is_big_endian": False, "is_signed": False,
        "is_float": False, "factor": 1, "offset": 0, "minimum": None, "maximum": None,
        "selector": None, "selected_by": (), "sentinels": (),
    }  # fmt: skip
    return SignalLayout(name=name, **{**plain, **facts})


def message(*signals: SignalLayout, **facts: Any) -> MessageLayout:
    plain: dict[str, Any] = {
        "name": "M", "can_id": 1, "is_extended": False, "length": 8, "cycle_s": None,
        "counter": None, "crc": None, "senders": (),
    }  # fmt: skip
    return MessageLayout(signals=signals or (signal(),), **{**plain, **facts})


def fault(checked: MessageLayout) -> str:
    """Return why a message, or the first of its signals, cannot be used; empty if it can."""
    try:
        _, lost = usable_part(checked)
    except FaultError as error:
        return error.reason
    return lost[0][1] if lost else ""


@pytest.mark.parametrize(
    ("can_id", "extended", "why"),
    [
        (0x7FF, False, ""),
        (0x800, False, "standard identifier 0x800 of more than 11 bits"),
        (0x1FFFFFFF, True, ""),
        (0x20000000, True, "extended identifier 0x20000000 of more than 29 bits"),
    ],
)
def test_an_identifier_has_11_or_29_bits(can_id: int, extended: bool, why: str) -> None:
    assert why in fault(message(can_id=can_id, is_extended=extended))
    assert bool(fault(message(can_id=can_id, is_extended=extended))) is bool(why)


@pytest.mark.parametrize(
    ("facts", "length", "why"),
    [
        ({}, 64, ""),
        ({}, 65, "has 65 bytes, not 0 to 64"),
        ({"length": 1}, 8, ""),
        ({"length": 0}, 8, "has 0 bits, not 1 to 64"),
        ({"length": 64}, 8, ""),
        ({"length": 65}, 16, "has 65 bits, not 1 to 64"),
        ({"start": -1}, 8, "starts at bit -1"),
        ({"start": 511, "length": 1}, 64, ""),
        ({"start": 512, "length": 1}, 64, "starts at bit 512"),
        ({"start": 56}, 8, ""),
        ({"start": 57}, 8, "ends in byte 9 of a message of 8"),
        ({"start": 63, "is_big_endian": True}, 8, ""),
        ({"start": 62, "is_big_endian": True}, 8, "ends in byte 9 of a message of 8"),
        ({"factor": 0}, 8, "factor 0"),
        ({"factor": float("inf")}, 8, "infinite factor or offset"),
        ({"offset": float("-inf")}, 8, "infinite factor or offset"),
        ({"factor": float("nan")}, 8, "infinite factor or offset"),
        ({"factor": 1e308}, 8, "too large for a number"),
        ({"factor": 10**400}, 8, "beyond float64"),
        ({"is_float": True, "length": 16}, 8, ""),
        ({"is_float": True, "length": 32}, 8, ""),
        ({"is_float": True, "length": 64}, 8, ""),
        ({"is_float": True, "length": 24}, 8, "a float of 24 bits"),
        ({"is_float": True, "length": 8}, 8, "a float of 8 bits"),
    ],
)
def test_a_signal_lies_in_its_message_and_is_a_number(
    facts: dict[str, Any], length: int, why: str
) -> None:
    checked = message(signal(**facts), length=length)
    assert why in fault(checked)
    assert bool(fault(checked)) is bool(why)


def test_a_fault_costs_its_signal_and_what_that_selects() -> None:
    bad = signal("top", length=65)
    one = signal("one", selector="top", selected_by=((1, 1),))
    two = signal("two", selector="one", selected_by=((1, 1),))
    kept, lost = usable_part(message(bad, one, two, signal("good"), length=16))
    assert [each.name for each in kept.signals] == ["good"]
    assert [name for name, _ in lost] == ["top", "one", "two"]
    assert "selector top, which is left out" in dict(lost)["one"]
    whole = message(signal("a"), signal("b", start=8))
    assert usable_part(whole) == (whole, [])
    with pytest.raises(FaultError) as caught:
        usable_part(message(bad, one, length=16))
    assert caught.value.signal == "top"
    with pytest.raises(FaultError, match="twice"):
        usable_part(message(signal("a"), signal("a", start=8)))


def chain(n: int) -> MessageLayout:
    """Return a signal with so many selectors above it."""
    signals = [signal("s0")]
    signals += [
        signal(f"s{k}", selector=f"s{k - 1}", selected_by=((1, 1),)) for k in range(1, n + 1)
    ]
    return message(*signals)


@pytest.mark.parametrize(
    ("checked", "why"),
    [
        (chain(15), ""),
        (chain(16), "more than 16 selectors above it"),
        (message(signal(), signal("a", selector="s")), "no value of its selector s"),
        (message(signal("a", selector="x", selected_by=((1, 1),))), "which is not in the message"),
        (message(signal("a", selector="a", selected_by=((1, 1),))), "selects itself"),
        (
            message(
                signal("f", is_float=True, length=32),
                signal("a", selector="f", selected_by=((1, 1),)),
            ),
            "not a whole number",
        ),
        (
            message(signal(), signal("a", selector="s", selected_by=((1, 1),) * 1024)),
            "",
        ),
        (
            message(signal(), signal("a", selector="s", selected_by=((1, 1),) * 1025)),
            "more than 1024 ranges",
        ),
    ],
)
def test_selectors_lead_to_a_plain_one(checked: MessageLayout, why: str) -> None:
    assert why in fault(checked)
    assert bool(fault(checked)) is bool(why)


@pytest.mark.parametrize(
    ("facts", "why"),
    [
        ({}, ""),
        ({"factor": 2}, "not a plain unsigned number"),
        ({"offset": 1}, "not a plain unsigned number"),
        ({"is_signed": True}, "not a plain unsigned number"),
        ({"is_float": True, "length": 16}, "not a plain unsigned number"),
        ({"selector": "s", "selected_by": ((1, 1),)}, "not a plain unsigned number"),
    ],
)
def test_a_counter_and_a_checksum_are_plain_numbers(facts: dict[str, Any], why: str) -> None:
    role = signal("role", start=8, **facts)
    for rule in ({"counter": CounterRule("role", 16)}, {"crc": "role"}):
        checked = message(signal(), role, **rule)
        assert why in fault(checked)
        assert bool(fault(checked)) is bool(why)


@pytest.mark.parametrize(("modulus", "why"), [(2**32, ""), (2**32 + 1, "more than 32 bits")])
def test_a_counter_has_32_bits_at_most(modulus: int, why: str) -> None:
    assert why in fault(message(counter=CounterRule("s", modulus)))
    assert bool(fault(message(counter=CounterRule("s", modulus)))) is bool(why)


@pytest.mark.parametrize(
    ("facts", "is_byte"),
    [
        ({}, True), ({"start": 8}, True), ({"start": 7, "is_big_endian": True}, True),
        ({"length": 7}, False), ({"length": 9}, False), ({"start": 4}, False),
        ({"start": 3, "is_big_endian": True}, False),
    ],
)  # fmt: skip
def test_a_checksum_is_one_whole_byte(facts: dict[str, Any], is_byte: bool) -> None:
    assert (fault(message(signal(**facts), crc="s")) == "") is is_byte


@pytest.mark.parametrize(
    ("first", "second", "shared"),
    [
        ({"start": 0, "length": 8}, {"start": 8, "length": 8}, False),
        ({"start": 0, "length": 9}, {"start": 8, "length": 8}, True),
        ({"start": 7, "length": 8, "is_big_endian": True}, {"start": 0, "length": 1}, True),
        ({"start": 7, "length": 4, "is_big_endian": True}, {"start": 0, "length": 4}, False),
        ({"start": 7, "length": 5, "is_big_endian": True}, {"start": 0, "length": 4}, True),
        ({"start": 3, "length": 5, "is_big_endian": True}, {"start": 15, "length": 1}, True),
        ({"start": 3, "length": 5, "is_big_endian": True}, {"start": 14, "length": 1}, False),
    ],
)
def test_signals_that_share_a_bit_overlap(
    first: dict[str, Any], second: dict[str, Any], shared: bool
) -> None:
    both = message(signal("a", **first), signal("b", **second))
    assert overlaps(both) == [("b", "a")] * shared


def test_signals_of_different_selector_values_may_share_bits() -> None:
    one = signal("one", selector="s", selected_by=((1, 1),), start=8)
    two = replace(one, name="two", selected_by=((2, 2),))
    assert overlaps(message(signal(), one, two)) == []
    assert overlaps(message(signal(), one, replace(two, selected_by=((1, 1),)))) == [("two", "one")]
    assert overlaps(message(signal(), one, signal("always", start=8))) == [("one", "always")]


def test_messages_of_one_identifier_and_width_are_ambiguous() -> None:
    found = ambiguous(
        [message(), message(can_id=2), message(), message(is_extended=True), message(can_id=2)]
    )
    assert sorted(found) == [0, 1, 2, 4]
    assert "identifier 0x1 " in found[0]
    assert "identifier 0x2 " in found[4]


@pytest.mark.parametrize(
    ("can_id", "extended"),
    [(0x7FF, False), (0x800, True), (0x1FFFFFFF, True), (0x20000000, False)],
)
def test_an_identifier_beyond_11_bits_is_one_of_29(can_id: int, extended: bool) -> None:
    assert as_long_as_it_is(message(can_id=can_id)).is_extended is extended
