"""When two readings of a message are the same: raw values exactly, scaled ones to rounding."""

from __future__ import annotations

from typing import Any

import pytest

from dbc import parse_codec
from dbc.layout import MessageLayout
from dbc.witness.compare import Difference, message_differences


def message(signal: str, length: int = 8) -> MessageLayout:
    text = f'VERSION ""\n\nBU_: A B\n\nBO_ 256 M: {length} A\n SG_ s : {signal} [0|0] "" B\n'
    return parse_codec(text, "x.dbc").message("M")


def read(signal: str, payload: bytes, raw: float, value: float, **changed: Any) -> list[Difference]:
    """Return what differs where cantools reads one payload so."""
    own = message(signal, len(payload))
    one = {"selector": None, "chosen": [], "raw": [raw], "values": [value]} | changed
    theirs = {"length": len(payload), "signals": {"s": one}}
    return message_differences(own, [payload], theirs)


@pytest.mark.parametrize("length", [1, 7, 8, 9, 12, 63, 64])
def test_payloads_of_any_length_are_read(length: int) -> None:
    payload = bytes(length - 1) + b"\xc8"
    assert read(f"{8 * length - 8}|8@1+ (1,0)", payload, 200, 200.0) == []
    (found,) = read(f"{8 * length - 8}|8@1+ (1,0)", payload, 199, 199.0)
    assert (found.ours, found.theirs) == ("raw 200", f"raw 199 in {payload.hex()}")


@pytest.mark.parametrize(
    ("scale", "value", "same"),
    [
        ("(1,0)", 200.0, True),
        ("(1,0)", 200.0 + 1.9e-10, True),  # a few roundings of 200
        ("(1,0)", 200.0 + 2.1e-10, False),
        ("(1,0)", 200.0 - 2.1e-10, False),
        ("(-1,0)", -200.0 + 1.9e-10, True),
        ("(1,300)", 500.0 + 4.9e-10, True),  # the offset rounds, too
        ("(1,300)", 500.0 + 5.1e-10, False),
        ("(1,-200)", 3.9e-10, True),
        ("(1,-200)", 4.1e-10, False),
        ("(1,0)", float("nan"), False),
    ],
)
def test_values_may_differ_by_rounding(scale: str, value: float, same: bool) -> None:
    found = read(f"0|8@1+ {scale}", b"\xc8", 200, value)
    assert (found == []) is same


def test_values_that_look_alike_are_written_in_full() -> None:
    ((found),) = read("0|8@1+ (1,0)", b"\xc8", 200, 200.0000001)
    assert (found.ours, found.theirs) == ("200.0", "200.0000001 in c8")
    assert "signal s: our DBC reader has 200.0, cantools has 200.0000001 in c8" in found.reason


def test_raw_values_are_the_same_to_the_bit() -> None:
    (found,) = read("0|8@1+ (1,0)", b"\xc8", 200.0000001, 200.0)
    assert found.ours == "raw 200"


def test_no_number_is_no_number_for_both() -> None:
    """SIG_VALTYPE_ 1: all ones are no number."""
    text = (
        'VERSION ""\n\nBU_: A B\n\nBO_ 256 M: 4 A\n SG_ s : 0|32@1- (2,1) [0|0] "" B\n\n'
        "SIG_VALTYPE_ 256 s : 1;\n"
    )
    own = parse_codec(text, "x.dbc").message("M")
    nan = float("nan")
    for values, same in (([nan, 5.0], True), ([nan, nan], False), ([5.0, 5.0], False)):
        one = {"selector": None, "chosen": [], "raw": [nan, 2.0], "values": values}
        theirs = {"length": 4, "signals": {"s": one}}
        payloads = [b"\xff\xff\xff\xff", b"\0\0\0\x40"]
        assert (message_differences(own, payloads, theirs) == []) is same


def test_of_several_payloads_the_first_that_differs_is_named() -> None:
    own = message("0|8@1+ (1,0)", 1)
    one = {"selector": None, "chosen": [], "raw": [1, 3, 4], "values": [1.0, 3.0, 4.0]}
    (found,) = message_differences(
        own, [b"\x01", b"\x02", b"\x03"], {"length": 1, "signals": {"s": one}}
    )
    assert (found.ours, found.theirs) == ("raw 2", "raw 3 in 02")


@pytest.mark.parametrize(
    ("theirs", "signal", "what"),
    [
        (None, None, "no such message"),
        ({"length": 7, "signals": {}}, None, "7 bytes"),
        ({"length": 8, "signals": {}}, "s", "no such signal"),
    ],
)
def test_what_cantools_lacks_is_named(theirs: Any, signal: str | None, what: str) -> None:
    (found,) = message_differences(message("0|8@1+ (1,0)"), [bytes(8)], theirs)
    assert (found.message, found.signal, found.theirs) == ("M", signal, what)


def test_a_signal_that_only_cantools_has_is_named() -> None:
    same = {"selector": None, "chosen": [], "raw": [0], "values": [0.0]}
    theirs = {"length": 8, "signals": {"s": same, "t": same}}
    (found,) = message_differences(message("0|8@1+ (1,0)"), [bytes(8)], theirs)
    assert (found.signal, found.ours, found.theirs) == ("t", "no such signal", "a signal")


def test_frames_of_a_signal_are_compared_before_its_values() -> None:
    (found,) = read("0|8@1+ (1,0)", b"\xc8", 0, 0.0, selector="top", chosen=[[1, 1], [5, 9]])
    assert (found.ours, found.theirs) == ("in every frame", "in frames with top 1, 5-9")
