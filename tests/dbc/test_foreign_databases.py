"""ARXML and databases under other names than their own, compared with what they say."""

from __future__ import annotations

import sys
from pathlib import Path
from time import process_time

import cantools.database
import numpy as np
import pytest

from dbc import FrameBatch, InputError, load_codec, parse_codec

from .foreign_texts import FRAME, SYM_TEXT, arxml, kcd_text


def frames(can_id: int, payload: bytes, extended: bool = False) -> FrameBatch:
    data = np.frombuffer(payload.ljust(8, b"\0"), np.uint8).reshape(1, 8)
    one = np.zeros(1, np.uint8)
    return FrameBatch(
        np.zeros(1, np.int64),
        np.array([can_id], np.uint32),
        np.array([extended], np.uint16),
        one,
        np.array([len(payload)], np.uint8),
        data,
    )


@pytest.mark.parametrize("name", ["a.arxml", "a.xml", "a.dbc"])
def test_arxml_under_any_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(arxml())
    codec = load_codec(path)
    message = codec.message("Hub")
    assert (message.can_id, message.is_extended, message.length) == (FRAME, False, 8)
    assert message.signal("az").unit == "m/s2"
    payload = (0x3E8 << 4).to_bytes(8, "little")
    assert codec.decode(frames(FRAME, payload)).samples["Hub.az"].value.tolist() == [490.0]


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("a.arxml", arxml()[:-60], "not a valid ARXML"),
        ("a.arxml", arxml(1_000_000), r"a.arxml:\d+: the number 1000000 lies outside"),
        ("a.arxml", "<!DOCTYPE x [<!ENTITY a 'b'>]>" + arxml(), "XML entities"),
        ("a.arxml", arxml() + " " * 5_000_000, "larger than 5 MB"),
        ("a.cdd", "<?xml version='1.0'?>\n<CANDELA dtdvers='5'></CANDELA>", "diagnostic"),
        ("a.arxml", "no XML at all", "not a valid ARXML"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(name: str, text: str, why: str) -> None:
    with pytest.raises(InputError, match=why) as caught:
        parse_codec(text, name)
    assert str(caught.value).isprintable()


def j1939(values: str) -> str:
    """Return a DBC with EEC1 (PGN 61444), TSC1 (PGN 0, addressed) and a proprietary frame."""
    return (
        'VERSION ""\nBU_: A\n'
        'BO_ 2364540158 EEC1: 8 A\n SG_ rpm : 24|16@1+ (0.125,0) [0|0] "1/min" A\n'
        'BO_ 2348810494 TSC1: 8 A\n SG_ torque : 0|8@1+ (1,-125) [0|0] "%" A\n'
        'BO_ 2566844160 Own: 8 A\n SG_ x : 0|8@1+ (1,0) [0|0] "" A\n'
        'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
        f"{values}"
    )


MARKED = (
    'BA_DEF_DEF_ "VFrameFormat" "ExtendedCAN";\n'
    'BA_ "VFrameFormat" BO_ 2364540158 3;\nBA_ "VFrameFormat" BO_ 2348810494 3;\n'
)
PAYLOAD = bytes([130, 0, 0, 0x40, 0x1F, 0, 0, 0])


@pytest.mark.parametrize(
    ("can_id", "signal"),
    [
        (0x0CF00400, "EEC1.rpm"),  # another source and priority
        (0x18F00417, "EEC1.rpm"),
        (0x0C0000FE, "TSC1.torque"),
        (0x0C001721, "TSC1.torque"),  # to 0x17 from 0x21
        (0x18FF0040, None),  # is not marked, and has another source
        (0x0CF00500, None),
        (0x0DF00400, None),  # another data page
    ],
)
def test_j1939_is_matched_by_parameter_group(can_id: int, signal: str | None) -> None:
    codec = parse_codec(j1939(MARKED), "a.dbc")
    found = codec.decode(frames(can_id, PAYLOAD, extended=True)).samples
    assert list(found) == ([signal] if signal else [])
    if signal == "EEC1.rpm":
        assert found[signal].value.tolist() == [1000.0]


def test_j1939_only_where_the_database_or_the_user_says_so() -> None:
    plain = parse_codec(j1939('BA_DEF_DEF_ "VFrameFormat" "ExtendedCAN";\n'), "a.dbc")
    other = frames(0x0CF00400, PAYLOAD, extended=True)
    assert not plain.decode(other).samples
    assert list(plain.by_parameter_group().decode(other).samples) == ["EEC1.rpm"]
    all_of_them = parse_codec(j1939('BA_DEF_DEF_ "VFrameFormat" "J1939PG";\n'), "a.dbc")
    assert list(all_of_them.decode(other).samples) == ["EEC1.rpm"]


def test_several_sources_of_one_group_are_told_apart_by_their_identifiers_alone() -> None:
    second = 'BO_ 2364539905 EEC1_b: 8 A\n SG_ rpm : 24|16@1+ (1,0) [0|0] "" A\n'
    twice = j1939(MARKED).replace("BO_ 2348810494", f"{second}BO_ 2348810494", 1)
    codec = parse_codec(twice + 'BA_ "VFrameFormat" BO_ 2364539905 3;\n', "a.dbc")
    assert list(codec.decode(frames(0x0CF00401, PAYLOAD, True)).samples) == ["EEC1_b.rpm"]
    assert list(codec.decode(frames(0x0CF004FE, PAYLOAD, True)).samples) == ["EEC1.rpm"]
    assert not codec.decode(frames(0x0CF00477, PAYLOAD, True)).samples


@pytest.mark.parametrize(
    ("second", "names"),
    [("High", ["Low", "High"]), ("Low", ["Low_m3", "Low_m4"])],
)
def test_signals_of_one_name_that_a_selector_tells_apart(second: str, names: list[str]) -> None:
    text = kcd_text(second)
    codec = parse_codec(text, "a.kcd")
    assert not codec.left_out
    database = cantools.database.can.Database(strict=False)
    database.add_kcd_string(text)
    for which, name in zip((3, 4), names, strict=True):
        payload = bytes([which, 1, 2, 3, 0, 0, 0, 0])
        found = codec.decode(frames(FRAME, payload)).samples
        expected = database.decode_message(FRAME, payload)
        assert isinstance(expected, dict)
        assert found[f"Limits.{name}"].value.tolist() == [expected[("Low", second)[which - 3]]]


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("a.kcd", kcd_text("High").replace('offset="8"', 'offset="-1"'), "Limits.Low starts at"),
        ("a.sym", SYM_TEXT.replace("CycleTime=10", "CycleTime=1" + "0" * 400), "Pots has a number"),
        ("a.sym", SYM_TEXT.replace("255=", "1e400="), "Which_A has a number beyond"),
    ],
)
def test_a_number_that_no_frame_has_costs_its_signal_or_message_alone(
    name: str, text: str, why: str
) -> None:
    codec = parse_codec(text, name)
    assert [why in each.text for each in codec.left_out] == [True]
    assert codec.messages


def test_a_limit_beyond_float64_limits_nothing() -> None:
    text = SYM_TEXT.replace("/max:5000", "/max:5" + "0" * 400)
    signal = parse_codec(text, "a.sym").message("Pots").signal("Force")
    assert (signal.minimum, signal.maximum) == (-5000.0, sys.float_info.max)


SCALE = "<COMPU-SCALE><LOWER-LIMIT>{}</LOWER-LIMIT><UPPER-LIMIT>{}</UPPER-LIMIT>"


def test_the_limits_of_a_falling_arxml_signal_are_in_order(
    capfd: pytest.CaptureFixture[str],
) -> None:
    text = arxml().replace("<V>0.5</V>", "<V>-0.5</V>")
    codec = parse_codec(text.replace("<COMPU-SCALE>", SCALE.format(0, 4000)), "a.arxml")
    signal = codec.message("Hub").signal("az")
    assert (signal.factor, signal.minimum, signal.maximum) == (-0.5, -2010.0, -10.0)
    found = codec.decode(frames(FRAME, (100 << 4).to_bytes(8, "little")))["Hub.az"]
    assert (found.value.tolist(), found.quality.tolist()) == ([-60.0], [0])
    assert not codec.notes
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("LINEAR</CATEGORY>", "RAT_FUNC</CATEGORY>", "category RAT_FUNC is not yet implemented"),
        ("<COMPU-SCALE>", SCALE.format(5, 1), "valid interval"),
    ],
)
def test_what_cantools_does_not_understand_of_values_is_a_note(
    old: str, new: str, said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    codec = parse_codec(arxml().replace(old, new, 1), "a.arxml")
    assert [said in note.text for note in codec.notes] == [True]
    assert capfd.readouterr() == ("", "")


def test_a_range_of_a_sym_has_2000_identifiers_at_most() -> None:
    text = SYM_TEXT.replace("00000023h", "000007F2h")  # from 0x22
    assert len(parse_codec(text, "a.sym").messages) == 2003
    with pytest.raises(InputError, match=r"a.sym:\d+: more than 2000 identifiers"):
        parse_codec(SYM_TEXT.replace("00000023h", "000007F3h"), "a.sym")


@pytest.mark.parametrize(
    ("kind", "old", "new"),
    [
        ("sym", "Mux=A 0,8 1", "Mux=A 2147483648,8 1"),
        ("sym", "Mux=A 0,8 1", 'Mux="A b" 513,8 1'),
        ("sym", "Sig=Travel 0", 'Sig="Tra \\" vel" 1000000000'),
        ("sym", "Sig=Travel 0", "Sig=Travel \u0663\u0663\u0663\u0663\u0663\u0663\u0663"),
        ("sym", "unsigned 12", "unsigned 12_000_000"),
        ("kcd", 'length="16"', 'length="1_000_000"'),
        ("kcd", 'length="16"', 'length="&#49;000000"'),
        ("kcd", 'length="16"', 'length="513"'),
        ("arxml", "<START-POSITION>4<", "<START-POSITION>0xFFFFFFFF<"),
        ("arxml", "<START-POSITION>4<", "<START-POSITION><!-- 4 -->99999999<"),
        ("arxml", "<LENGTH>12<", "<LENGTH>&#57;99999<"),
    ],
)
def test_a_number_that_would_fill_memory_is_refused_however_it_is_written(
    kind: str, old: str, new: str
) -> None:
    text = {"sym": SYM_TEXT, "kcd": kcd_text("High"), "arxml": arxml()}[kind]
    assert old in text
    with pytest.raises(InputError, match="lies outside any payload"):
        parse_codec(text.replace(old, new, 1), f"a.{kind}")


@pytest.mark.parametrize("end", ['Sig="x', 'Sig="x\\"', 'Title="'])
def test_a_text_without_an_end_hides_nothing(end: str) -> None:
    with pytest.raises(InputError, match=r"a.sym:\d+: has a text without an end"):
        parse_codec(f"{SYM_TEXT}{end} 1000000000\n", "a.sym")


@pytest.mark.parametrize("piece", ["Sig=,", 'Sig="', '\\"', "Sig=a ", ",1 ", 'Mux=\\"', "// "])
def test_the_look_for_numbers_grows_with_the_length_alone(piece: str) -> None:
    began = process_time()
    with pytest.raises(InputError):
        parse_codec("FormatVersion=6.0 // x\n" + piece * (400_000 // len(piece)), "a.sym")
    assert process_time() - began < 8.0


def test_a_name_that_ends_in_digits_is_no_number() -> None:
    codec = parse_codec(SYM_TEXT.replace("Travel", "Travel12345"), "a.sym")
    assert codec.message("Pots").signal("Travel12345").start == 0
    assert not codec.left_out


@pytest.mark.parametrize("missing", [' name="Limits"', ' name="High"'])
def test_a_message_or_signal_without_a_name_is_left_out(missing: str) -> None:
    other = (
        '<Message id="0x7" name="Other" length="1"><Signal name="x" offset="0"/></Message></Bus>'
    )
    text = kcd_text("High").replace(missing, "", 1).replace("</Bus>", other)
    codec = parse_codec(text, "a.kcd")
    assert [m.name for m in codec.messages] == ["Other"]
    assert len(codec.left_out) == 1
