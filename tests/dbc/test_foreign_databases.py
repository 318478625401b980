"""ARXML and databases under other names than their own, compared with what they say."""

from __future__ import annotations

from pathlib import Path

import cantools.database
import numpy as np
import pytest

from dbc import FrameBatch, InputError, load_codec, parse_codec

FRAME = 0x123


def arxml(length: int = 12) -> str:
    """Return a system description: one frame with one signal of 12 bits, 0.5 m/s2 a bit, -10."""

    def package(name: str, elements: str) -> str:
        inner = f"<SHORT-NAME>{name}</SHORT-NAME><ELEMENTS>{elements}</ELEMENTS>"
        return f"<AR-PACKAGE>{inner}</AR-PACKAGE>"

    cluster = (
        "<CAN-CLUSTER><SHORT-NAME>Bus</SHORT-NAME><CAN-CLUSTER-VARIANTS><CAN-CLUSTER-CONDITIONAL>"
        "<BAUDRATE>500000</BAUDRATE><PHYSICAL-CHANNELS><CAN-PHYSICAL-CHANNEL>"
        "<SHORT-NAME>Channel</SHORT-NAME><FRAME-TRIGGERINGS><CAN-FRAME-TRIGGERING>"
        "<SHORT-NAME>Trigger</SHORT-NAME><FRAME-REF DEST='CAN-FRAME'>/F/Hub</FRAME-REF>"
        "<CAN-ADDRESSING-MODE>STANDARD</CAN-ADDRESSING-MODE>"
        f"<IDENTIFIER>{FRAME}</IDENTIFIER></CAN-FRAME-TRIGGERING></FRAME-TRIGGERINGS>"
        "</CAN-PHYSICAL-CHANNEL></PHYSICAL-CHANNELS></CAN-CLUSTER-CONDITIONAL>"
        "</CAN-CLUSTER-VARIANTS></CAN-CLUSTER>"
    )
    frame = (
        "<CAN-FRAME><SHORT-NAME>Hub</SHORT-NAME><FRAME-LENGTH>8</FRAME-LENGTH>"
        "<PDU-TO-FRAME-MAPPINGS><PDU-TO-FRAME-MAPPING><SHORT-NAME>M</SHORT-NAME>"
        "<PACKING-BYTE-ORDER>MOST-SIGNIFICANT-BYTE-LAST</PACKING-BYTE-ORDER>"
        "<PDU-REF DEST='I-SIGNAL-I-PDU'>/P/Pdu</PDU-REF><START-POSITION>0</START-POSITION>"
        "</PDU-TO-FRAME-MAPPING></PDU-TO-FRAME-MAPPINGS></CAN-FRAME>"
    )
    pdu = (
        "<I-SIGNAL-I-PDU><SHORT-NAME>Pdu</SHORT-NAME><LENGTH>8</LENGTH><I-SIGNAL-TO-PDU-MAPPINGS>"
        "<I-SIGNAL-TO-I-PDU-MAPPING><SHORT-NAME>S</SHORT-NAME>"
        "<I-SIGNAL-REF DEST='I-SIGNAL'>/S/az</I-SIGNAL-REF>"
        "<PACKING-BYTE-ORDER>MOST-SIGNIFICANT-BYTE-LAST</PACKING-BYTE-ORDER>"
        "<START-POSITION>4</START-POSITION></I-SIGNAL-TO-I-PDU-MAPPING>"
        "</I-SIGNAL-TO-PDU-MAPPINGS></I-SIGNAL-I-PDU>"
    )
    signal = (
        f"<I-SIGNAL><SHORT-NAME>az</SHORT-NAME><LENGTH>{length}</LENGTH>"
        "<NETWORK-REPRESENTATION-PROPS><SW-DATA-DEF-PROPS-VARIANTS>"
        "<SW-DATA-DEF-PROPS-CONDITIONAL>"
        "<BASE-TYPE-REF DEST='SW-BASE-TYPE'>/T/uint</BASE-TYPE-REF>"
        "</SW-DATA-DEF-PROPS-CONDITIONAL></SW-DATA-DEF-PROPS-VARIANTS>"
        "</NETWORK-REPRESENTATION-PROPS>"
        "<SYSTEM-SIGNAL-REF DEST='SYSTEM-SIGNAL'>/Y/az</SYSTEM-SIGNAL-REF></I-SIGNAL>"
    )
    base = (
        "<SW-BASE-TYPE><SHORT-NAME>uint</SHORT-NAME><BASE-TYPE-ENCODING>NONE</BASE-TYPE-ENCODING>"
        "</SW-BASE-TYPE>"
    )
    method = (
        "<COMPU-METHOD><SHORT-NAME>half</SHORT-NAME><CATEGORY>LINEAR</CATEGORY>"
        "<UNIT-REF DEST='UNIT'>/U/acc</UNIT-REF><COMPU-INTERNAL-TO-PHYS><COMPU-SCALES><COMPU-SCALE>"
        "<COMPU-RATIONAL-COEFFS><COMPU-NUMERATOR><V>-10</V><V>0.5</V></COMPU-NUMERATOR>"
        "<COMPU-DENOMINATOR><V>1</V></COMPU-DENOMINATOR></COMPU-RATIONAL-COEFFS></COMPU-SCALE>"
        "</COMPU-SCALES></COMPU-INTERNAL-TO-PHYS></COMPU-METHOD>"
    )
    unit = "<UNIT><SHORT-NAME>acc</SHORT-NAME><DISPLAY-NAME>m/s2</DISPLAY-NAME></UNIT>"
    system = (
        "<SYSTEM-SIGNAL><SHORT-NAME>az</SHORT-NAME><PHYSICAL-PROPS><SW-DATA-DEF-PROPS-VARIANTS>"
        "<SW-DATA-DEF-PROPS-CONDITIONAL>"
        "<COMPU-METHOD-REF DEST='COMPU-METHOD'>/C/half</COMPU-METHOD-REF>"
        "</SW-DATA-DEF-PROPS-CONDITIONAL></SW-DATA-DEF-PROPS-VARIANTS></PHYSICAL-PROPS>"
        "</SYSTEM-SIGNAL>"
    )
    names = {"N": cluster, "F": frame, "P": pdu, "S": signal, "T": base, "C": method}
    names |= {"U": unit, "Y": system}
    return (
        "<?xml version='1.0' encoding='UTF-8'?>\n<AUTOSAR xmlns='http://autosar.org/schema/r4.0' "
        "xmlns:xsi='http://www.w3.org/2001/XMLSchema-instance' "
        "xsi:schemaLocation='http://autosar.org/schema/r4.0 AUTOSAR_4-2-2.xsd'>\n<AR-PACKAGES>"
        + "\n".join(package(name, elements) for name, elements in names.items())
        + "</AR-PACKAGES></AUTOSAR>\n"
    )


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


def kcd(second: str) -> str:
    """Return a message whose selector chooses one of two signals, the second one as given."""
    return (
        '<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0"><Document/>'
        '<Bus name="B"><Message id="0x123" name="Limits" length="8">'
        '<Multiplex name="Which" offset="0" length="8">'
        '<MuxGroup count="3"><Signal name="Low" offset="8" length="16"><Value slope="0.1"/>'
        f'</Signal></MuxGroup><MuxGroup count="4"><Signal name="{second}" offset="16" length="16"/>'
        "</MuxGroup></Multiplex></Message></Bus></NetworkDefinition>"
    )


@pytest.mark.parametrize(
    ("second", "names"),
    [("High", ["Low", "High"]), ("Low", ["Low_m3", "Low_m4"])],
)
def test_signals_of_one_name_that_a_selector_tells_apart(second: str, names: list[str]) -> None:
    text = kcd(second)
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
