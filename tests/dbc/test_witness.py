"""cantools is asked beside our own reader, and each difference is named with both readings."""

from __future__ import annotations

import pytest

from dbc import Codec, parse_codec, shipped_dbc
from dbc.witness import second_reader as module
from dbc.witness.second_reader import Witness, WitnessReport, payloads

from .mutations import MIXED

TEXT = (
    'VERSION ""\n\nBU_: A B\n\n'
    'BO_ 256 M: 8 A\n SG_ s : 0|16@1- (0.5,0) [0|0] "g" B\n SG_ t : 16|8@1+ (1,0) [0|0] "" B\n\n'
    'BO_ 257 N: 4 A\n SG_ s : 7|12@0+ (0.1,-5) [0|0] "g" B\n\n'
    'VAL_ 256 t 255 "SNA" 254 "error";\n'
)


def ask(text: str, codec: Codec) -> WitnessReport:
    """Return what cantools makes of a text, beside a codec that may be of another one."""
    with Witness(text, "x.dbc", codec, [message.name for message in codec.messages]) as witness:
        return witness.report()


def differences(ours: str, theirs: str) -> list[tuple[str, str | None, str]]:
    """Return what differs where each reader is given a text of its own."""
    found = ask(theirs, parse_codec(ours, "x.dbc"))
    assert found.refusal == ""
    return [(d.message, d.signal, d.reason) for d in found.differences]


@pytest.mark.usefixtures("without_children")
@pytest.mark.parametrize("text", [TEXT, MIXED])
def test_equal_readings_have_no_difference(text: str) -> None:
    codec = parse_codec(text, "x.dbc")
    assert ask(text, codec) == WitnessReport((), "", len(codec.messages))


def test_the_shipped_dbc_is_read_alike_by_cantools_in_a_process_of_its_own() -> None:
    codec = parse_codec(shipped_dbc(), "x.dbc")
    assert ask(shipped_dbc(), codec) == WitnessReport((), "", len(codec.messages))


@pytest.mark.usefixtures("without_children")
@pytest.mark.parametrize(
    ("old", "new", "subject", "words"),
    [
        ("(0.5,0)", "(0.25,0)", ("M", "s"), "has -0.5, cantools has -0.25 in ffffffffffffffff"),
        ("(0.1,-5)", "(0.1,-4)", ("N", "s"), "has -5, cantools has -4 in 00000000"),
        ("(0.1,-5)", "(0.1000001,-5)", ("N", "s"), "has 404.5, cantools has 404.500409"),
        ("0|16@1-", "0|16@1+", ("M", "s"), "has raw -1, cantools has raw 65535"),
        ("7|12@0+", "7|11@0+", ("N", "s"), "has raw 4095, cantools has raw 2047"),
        ("SG_ s : 0", "SG_ r : 0", ("M", "s"), "has a signal, cantools has no such signal"),
        ("N: 4 A", "N: 5 A", ("N", None), "has 4 bytes, cantools has 5 bytes"),
        ("BO_ 257", "BO_ 258", ("N", None), "has 4 bytes, cantools has no such message"),
    ],
)
def test_a_difference_names_message_signal_and_both_readings(
    old: str, new: str, subject: tuple[str, str | None], words: str
) -> None:
    (first, *_) = differences(TEXT, TEXT.replace(old, new))
    assert first[:2] == subject
    assert words in first[2]


@pytest.mark.usefixtures("without_children")
def test_a_message_that_only_cantools_has_is_named() -> None:
    ours = TEXT.replace(TEXT[TEXT.index("BO_ 257") : TEXT.index("VAL_")], "")
    reason = "our DBC reader has no such message, cantools has identifier 0x101"
    assert differences(ours, TEXT) == [("N", None, reason)]


@pytest.mark.usefixtures("without_children")
def test_a_message_that_is_left_out_by_name_is_no_difference() -> None:
    text = TEXT.replace("(0.1,-5)", "(0,-5)")
    codec = parse_codec(text, "x.dbc")
    assert [each.subject for each in codec.left_out] == ["N.s"]
    assert ask(text, codec) == WitnessReport((), "", 1)


@pytest.mark.usefixtures("without_children")
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("inner top 1-3", "inner top 1-4", "in frames with top 1-3, cantools has in frames with"),
        ("deep inner 2-2, 5-9", "deep inner 2-2, 5-8", "inner 2, 5-9, cantools has in frames"),
    ],
)
def test_multiplexing_that_differs_is_named(old: str, new: str, words: str) -> None:
    ((message, signal, reason),) = differences(MIXED, MIXED.replace(old, new))
    assert (message, signal) == ("Mux", old.split()[0])
    assert words in reason


@pytest.mark.usefixtures("without_children")
def test_a_float_that_differs_is_named() -> None:
    ((message, signal, _),) = differences(MIXED, MIXED.replace("SIG_VALTYPE_ 100 other : 2;\n", ""))
    assert (message, signal) == ("Mux", "other")


def test_what_cantools_refuses_is_said() -> None:
    text = TEXT.replace("BO_ 257 N", "BO_ 257 2N")  # a name that begins with a digit
    found = ask(text, parse_codec(text, "x.dbc"))
    assert found.differences == ()
    assert "Invalid syntax" in found.refusal


def test_a_file_that_would_keep_cantools_busy_ends_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_CPU_S", 3)
    text = MIXED.replace("other top 0-0", "other top 0-4000000000")
    found = ask(text, parse_codec(text, "x.dbc"))
    assert found.differences == ()
    assert found.refusal


def test_a_database_that_cantools_reads_alone_is_not_asked_about() -> None:
    with Witness("", "x.kcd", parse_codec(TEXT, "x.dbc"), ["M"]) as witness:
        assert witness.report() == WitnessReport((), "", 0)


def test_sixteen_payloads_are_compared_and_always_the_same() -> None:
    message = parse_codec(TEXT, "x.dbc").message("N")
    sample = payloads(message)
    assert sample == payloads(message)
    assert len(set(sample)) == 16
    assert sample[:3] == (b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x80\0\x80\0")
