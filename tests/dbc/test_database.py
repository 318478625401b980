from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from dbc import InputError, load_codec, parse_codec, read_dbc, shipped_dbc

HEAD = 'VERSION ""\n\nBU_: A B\n\n'
ORPHANS = "VECTOR__INDEPENDENT_SIG_MSG"
SIGNAL = ' SG_ s : 0|16@1- (0.5,0) [0|0] "g" B\n'
GOOD = f"{HEAD}BO_ 256 M: 8 A\n{SIGNAL}"


def with_signal(line: str, tail: str = "") -> str:
    return f"{HEAD}BO_ 256 M: 8 A\n SG_ {line} B\n\n{tail}\n"


ROLES = (
    'BA_DEF_ SG_ "SignalRole" ENUM "value","counter","crc8_j1850","crc16";\n'
    'BA_DEF_DEF_ "SignalRole" "value";\n'
)

REFUSED = {
    "empty": ("", "empty"),
    "blank": (" \n\n\t\n", "empty"),
    "prose": ("A bump test over CAN.\n", "not a valid DBC"),
    "xml": ("<?xml version='1.0'?><a/>", "not a valid DBC"),
    "json": ('{"version": ""}', "not a valid DBC"),
    "nul": ("VERSION \0", "binary"),
    "header only": (HEAD, "no messages"),
    "cut off": (GOOD[:-20], "ends within a definition"),
    "cut off after a message": (GOOD + "\nBA_DEF_ BO_", "ends within a definition"),
    "orphans only": (
        f"{HEAD}BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX\n{SIGNAL}",
        "no mess",
    ),
    "long signal": (
        with_signal('s : 0|1000000@1+ (1,0) [0|0] ""'),
        "x.dbc:6: M.s has 1000000 bits",
    ),
    "65 bits": (with_signal('s : 0|65@1+ (1,0) [0|0] ""'), "x.dbc:6: M.s has 65 bits"),
    "no bits": (with_signal('s : 0|0@1+ (1,0) [0|0] ""'), "x.dbc:6: M.s has 0 bits"),
    "half bits": (
        with_signal('s : 0|1e3@1+ (1,0) [0|0] ""'),
        "x.dbc:6: message M has a line that is not understood",
    ),
    "far start": (with_signal('s : 512|1@1+ (1,0) [0|0] ""'), "x.dbc:6: M.s starts at bit 512"),
    "hidden": (with_signal('s//"\n : 0|\n1000000@1+ (1,0) [0|0] ""'), "x.dbc:6: M.s has 1000000"),
    "payload": (GOOD.replace("M: 8", "M: 65"), "x.dbc:5: message M has 65 bytes"),
    "squeezed": (
        GOOD.replace("BO_ 256 M: 8", "BO_+256M:9999"),
        "x.dbc:5: message ? has a line that",
    ),
    "outside": (with_signal('s : 56|16@1+ (1,0) [0|0] ""'), "x.dbc:6: M.s ends in byte 9 of"),
    "motorola outside": (with_signal('s : 59|8@0+ (1,0) [0|0] ""'), "x.dbc:6: M.s ends in byte 9"),
    "same id": (
        GOOD + f"\nBO_ 256 N: 8 A\n{SIGNAL}",
        "x.dbc:5: message M has the identifier 0x100 of another message",
    ),
    "same id again": (GOOD + f"\nBO_ 0256 N: 8 A\n{SIGNAL}", "x.dbc:5: message M has the ident"),
    "same signal": (GOOD + SIGNAL, "M.s is defined twice"),
    "standard id": (GOOD.replace("256", str(1 << 29)), "more than 11 bits"),
    "extended id": (GOOD.replace("256", str(0xA0000000)), "more than 29 bits"),
    "factor 0": (with_signal('s : 0|8@1+ (0,0) [0|0] ""'), "x.dbc:6: M.s has the factor 0"),
    "factor inf": (with_signal('s : 0|8@1+ (1e400,0) [0|0] ""'), "x.dbc:6: M.s has an infinite"),
    "factor huge": (with_signal(f's : 0|8@1+ (1{"0" * 400},0) [0|0] ""'), "beyond float64"),
    "values huge": (with_signal('s : 0|64@1+ (1.5e300,0.5) [0|0] ""'), "too large for a number"),
    "odd float": (
        with_signal('s : 0|17@1+ (1,0) [0|0] ""', "SIG_VALTYPE_ 256 s : 1;"),
        "17 bit",
    ),
    "no selector": (with_signal('s m0 : 0|8@1+ (1,0) [0|0] ""'), "x.dbc:6: M.s is multiplexed w"),
    "two selectors": (
        with_signal(
            's M : 0|8@1+ (1,0) [0|0] "" B\n SG_ r M : 8|8@1+ (1,0) [0|0] "" B\n'
            ' SG_ t m1 : 16|8@1+ (1,0) [0|0] ""',
        ),
        "x.dbc:8: M.t is multiplexed without one clear selector",
    ),
    "selector loop": (
        with_signal(
            's m0M : 0|8@1+ (1,0) [0|0] "" B\n SG_ r m0M : 8|8@1+ (1,0) [0|0] ""',
            "SG_MUL_VAL_ 256 s r 0-1;\nSG_MUL_VAL_ 256 r s 0-1;",
        ),
        "M.s selects itself",
    ),
    "selector absent": (
        with_signal(
            's m0M : 0|8@1+ (1,0) [0|0] "" B\n SG_ r m0M : 8|8@1+ (1,0) [0|0] ""',
            "SG_MUL_VAL_ 256 s q 0-1;\nSG_MUL_VAL_ 256 r q 0-1;",
        ),
        "selector q, which is not in the message",
    ),
    "selector itself": (
        with_signal('s M : 0|8@1+ (1,0) [0|0] ""', "SG_MUL_VAL_ 256 s s 0-4294967295;"),
        "M.s selects itself",
    ),
    "selector values without a range": (
        with_signal('s M : 0|8@1+ (1,0) [0|0] ""', "SG_MUL_VAL_ 256 s s 0 94294967295;"),
        "x.dbc:8: message M has a line that is not understood",
    ),
    "unknown role": (
        with_signal('s : 0|8@1+ (1,0) [0|0] ""', ROLES + 'BA_ "SignalRole" SG_ 256 s 3;'),
        "M.s has the SignalRole crc16, which is unknown",
    ),
    "signed counter": (
        with_signal('s : 0|8@1- (1,0) [0|0] ""', ROLES + 'BA_ "SignalRole" SG_ 256 s 1;'),
        "not a plain unsigned number",
    ),
    "counter of 33 bits": (
        with_signal('s : 0|33@1+ (1,0) [0|0] ""', ROLES + 'BA_ "SignalRole" SG_ 256 s 1;'),
        "counts in more than 32 bits",
    ),
    "crc of 7 bits": (
        with_signal('s : 0|7@1+ (1,0) [0|0] ""', ROLES + 'BA_ "SignalRole" SG_ 256 s 2;'),
        "not one whole byte",
    ),
    "two counters": (
        with_signal(
            's : 0|8@1+ (1,0) [0|0] "" B\n SG_ r : 8|8@1+ (1,0) [0|0] ""',
            ROLES + 'BA_ "SignalRole" SG_ 256 s 1;\nBA_ "SignalRole" SG_ 256 r 1;',
        ),
        "defined twice",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_database_is_refused_in_one_line(case: str) -> None:
    text, reason = REFUSED[case]
    with pytest.raises(InputError) as refusal:
        parse_codec(text, "x.dbc")
    message = str(refusal.value)
    assert message.startswith("x.dbc")
    assert reason in message
    assert message.isprintable()


def test_syntax_errors_name_the_line() -> None:
    with pytest.raises(InputError, match=r"^x\.dbc:6: message M has a line that is not understood"):
        parse_codec(GOOD.replace("(0.5,0)", "(0.5;0)"), "x.dbc")


def test_a_text_beyond_the_size_limit_is_not_parsed() -> None:
    with pytest.raises(InputError, match="larger than 5 MB"):
        parse_codec(GOOD + " " * (5_000_001 - len(GOOD)), "x.dbc")
    assert len(parse_codec(GOOD + " " * (5_000_000 - len(GOOD)), "x.dbc").messages) == 1


def test_a_file_of_5_megabytes_is_read_and_one_byte_more_is_not(tmp_path: Path) -> None:
    file = tmp_path / "x.dbc"
    file.write_bytes(b" " * 5_000_000)
    assert len(read_dbc(file)) == 5_000_000
    file.write_bytes(b" " * 5_000_001)
    with pytest.raises(InputError, match="larger than 5 MB"):
        read_dbc(file)


@pytest.mark.parametrize(("lines", "refused"), [(1000, False), (1001, True)])
def test_a_thousand_lines_may_be_no_statement(lines: int, refused: bool) -> None:
    text = GOOD + "\n" + "CM_ a\n" * lines + "\nBU_: C\n"
    if refused:
        with pytest.raises(InputError, match="more than 1000 lines are not understood"):
            parse_codec(text, "x.dbc")
    else:
        assert len(parse_codec(text, "x.dbc").messages) == 1


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    large = tmp_path / "large.dbc"
    large.write_bytes(b" " * 5_000_001)
    binary = tmp_path / "binary.dbc"
    binary.write_bytes(bytes(range(128, 160)))
    wide = tmp_path / "wide.dbc"
    wide.write_bytes(GOOD.encode("utf-16"))
    for path, reason in (
        (tmp_path / "absent.dbc", "No such file"),
        (tmp_path, "not a file"),
        (Path("/dev/zero"), "not a file"),
        (large, "larger than 5 MB"),
        (binary, "not a valid DBC"),
        (wide, "UTF-16 text"),
    ):
        with pytest.raises(InputError, match=reason) as refusal:
            load_codec(path)
        assert str(refusal.value).startswith(str(path))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_units_survive_the_encodings_of_editors(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "units.dbc"
    path.write_bytes(GOOD.replace('"g"', '"m/s²"').encode(encoding))
    assert load_codec(path).message("M").signal("s").unit == "m/s²"


def test_a_word_in_a_comment_or_string_is_no_fault() -> None:
    text = GOOD + '\nCM_ "BO_ 1 N: 900 A\nSG_ t : 0|900@1+ SG_MUL_VAL_ 1 a b 0-99999999;";\n'
    assert [message.name for message in parse_codec(text, "x.dbc").messages] == ["M"]


def test_standard_and_extended_identifiers_of_one_number_are_two_messages() -> None:
    text = GOOD + f"\nBO_ {256 | 1 << 31} N: 8 A\n{SIGNAL}"
    codec = parse_codec(text, "x.dbc")
    standard, extended = codec.find(256, False), codec.find(256, True)
    assert standard is not None
    assert extended is not None
    assert (standard.name, extended.name) == ("M", "N")
    assert codec.find(257, False) is None
    with pytest.raises(KeyError, match="no message Q"):
        codec.message("Q")


def test_the_shipped_database_is_the_bench_of_the_readme() -> None:
    codec = parse_codec(shipped_dbc(), "bumpbench.dbc")
    rows = [(m.can_id, m.name, m.length, m.cycle_s, m.is_extended) for m in codec.messages]
    assert rows == [
        (0x100, "IMU_Accel", 8, 0.002, False),
        (0x101, "IMU_Rate", 8, 0.002, False),
        (0x110, "HUB_Front", 6, 0.001, False),
        (0x111, "HUB_Rear", 6, 0.001, False),
        (0x120, "SUSP_Front", 6, 0.002, False),
        (0x121, "SUSP_Rear", 6, 0.002, False),
    ]
    for message in codec.messages:
        assert message.counter is not None
        assert message.counter.modulus == 256
        assert message.crc == message.signals[-1].name == "crc"
        assert message.signals[-1].last_byte == message.length - 1
        assert message.senders
        for signal in message.signals[:-2]:
            assert signal.length == 16
            assert signal.is_signed
            assert signal.is_big_endian == message.name.startswith("HUB")
            assert signal.span == (signal.minimum, signal.maximum)


def test_importing_the_package_does_not_load_the_parser() -> None:
    code = (
        "import sys, dbc; sys.exit(any(name.split('.')[0] == 'cantools' for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_codec_is_its_messages_and_shows_no_more() -> None:
    one, again = (parse_codec(GOOD, "x.dbc") for _ in range(2))
    assert one == again
    assert hash(one) == hash(again)
    assert not [
        word for word in ("by_name", "_by_id", "_readers", "_identifiers") if word in repr(one)
    ]
