"""Databases: what cannot be decoded correctly is left out and named; units; values of no value."""

from __future__ import annotations

import math
from pathlib import Path
from time import process_time

import cantools.database
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc import UNUSABLE, Codec, InputError, Quality, load_codec, parse_codec, shipped_dbc
from dbc.database import names_no_value
from dbc.units import SiUnit, known_si
from tui.cli import run

from .databases import FRAME, SYM_TEXT, TWO_BUSES, arxml, block, kcd, kcd_message

HEAD = 'VERSION ""\n\nNS_ :\n\tCM_\n\tVAL_\n\nBS_:\n\nBU_: A B\n\n'
M = 'BO_ 256 M: 8 A\n SG_ s : 0|16@1- (0.5,0) [0|0] "g" B\n SG_ t : 16|8@1+ (1,0) [0|0] "" A,B\n\n'
N = 'BO_ 257 N: 8 A\n SG_ s : 0|8@1+ (1,0) [0|0] "" B\n\n'


def names(codec: Codec) -> list[str]:
    """Return the names of all signals."""
    return [f"{message.name}.{each.name}" for message in codec.messages for each in message.signals]


def signal(line: str, tail: str = "") -> str:
    return f"{HEAD}BO_ 300 Bad: 8 A\n SG_ {line} B\n{N}{tail}"


COUNTERS = 'BA_DEF_ SG_ "SignalRole" ENUM "value","counter";\n'
# A text with a fault in message Bad or signal Bad.s, and what is said on which line.
LEFT_OUT = {
    "syntax": (signal('s : 0|16@1- (0.5;0) [0|0] "g"'), "12: signal s is not valid DBC"),
    "factor 0": (signal('s : 0|16@1- (0,0) [0|0] "g"'), "has the factor 0"),
    "factor": (signal('s : 0|8@1+ (1e400,0) [0|0] ""'), "factor or offset beyond float64"),
    "long": (signal('s : 0|9999@1- (1,0) [0|0] "g"'), "s has 9999 bits"),
    "beyond": (signal('s : 60|16@1- (1,0) [0|0] "g"'), "ends in byte 10 of a message of 8"),
    "float": (
        signal('s : 0|17@1- (1,0) [0|0] ""', "SIG_VALTYPE_ 300 s : 1;\n"),
        "is a float of 17 bits",
    ),
    "bytes": (signal('s : 0|8@1+ (1,0) [0|0] ""').replace("Bad: 8", "Bad: 65"), "has 65 bytes"),
    "no selector": (signal('s m1 : 0|8@1- (1,0) [0|0] "g"'), "without one clear selector"),
    "two selectors": (
        signal(
            's M : 0|8@1- (1,0) [0|0] "g" B\n SG_ u M : 8|8@1+ (1,0) [0|0] "" B\n'
            ' SG_ v m1 : 16|8@1+ (1,0) [0|0] ""'
        ),
        "Bad.v is multiplexed without one clear selector",
    ),
    "selector of itself": (
        signal(
            's m0M : 0|8@1+ (1,0) [0|0] "" B\n SG_ r m0M : 8|8@1+ (1,0) [0|0] ""',
            "SG_MUL_VAL_ 300 s r 0-1;\nSG_MUL_VAL_ 300 r s 0-1;\n",
        ),
        "has no usable selector",
    ),
    "range": (
        signal(
            's M : 0|32@1+ (1,0) [0|0] "" B\n SG_ r m0 : 32|8@1+ (1,0) [0|0] ""',
            "SG_MUL_VAL_ 300 r s 0-4000000000;\n",
        ),
        "message Bad has a SG_MUL_VAL_ that has 4,000,000,001 values",
    ),
    "identifier": (
        signal('s : 0|8@1+ (1,0) [0|0] ""').replace("300", "1073741824"),
        "has an identifier of 31 bits",
    ),
    "twin": (
        signal('s : 0|8@1+ (1,0) [0|0] ""')
        + 'BO_ 300 Bad2: 8 A\n SG_ q : 0|8@1+ (1,0) [0|0] "" B\n',
        "identifier 0x12C of another",
    ),
    "twin signals": (
        signal('s : 0|8@1+ (1,0) [0|0] "" B\n SG_ s : 0|8@1+ (1,0) [0|0] ""'),
        "is defined twice",
    ),
    "type": (
        signal('s : 0|32@1- (1,0) [0|0] ""', "SIG_VALTYPE_ 300 s ; 1;\n"),
        "message Bad has a SIG_VALTYPE_",
    ),
    "type of no signal": (
        signal('s : 0|32@1- (1,0) [0|0] ""', "SIG_VALTYPE_ 300 q : 1;\n"),
        "16: SIG_VALTYPE_ 300 q names no signal",
    ),
    "type without an end": (
        signal('s : 0|32@1- (1,0) [0|0] ""', 'SIG_VALTYPE_ 300 s : 1\nVAL_ 257 s 1 "a" ;\n'),
        "16: message Bad has a SIG_VALTYPE_",
    ),
    "mistyped": (
        signal('s : 0|32@1- (1,0) [0|0] ""', "SIG_VLTYPE_ 300 s : 1;\n"),
        "16: message Bad has",
    ),
    "table": (signal('s : 0|8@1- (1,0) [0|0] ""', 'VAL_ 300 s 1 "a "b" c";\n'), "16: message Bad"),
    "role": (
        signal(
            's : 0|8@1+ (1,0) [0|0] ""',
            'BA_DEF_ SG_ "SignalRole" ENUM "value","crc16";\nBA_ "SignalRole" SG_ 300 s 1;\n',
        ),
        "s cannot have the SignalRole crc16",
    ),
    "long counter": (
        signal('s : 0|33@1+ (1,0) [0|0] ""', f'{COUNTERS}BA_ "SignalRole" SG_ 300 s 1;\n'),
        "s cannot have the SignalRole counter",
    ),
    "head": (signal('s : 0|8@1- (1,0) [0|0] ""').replace("300 Bad:", "300 Bad"), "11: message Bad"),
    "no head": (signal('s : 0|8@1- (1,0) [0|0] ""').replace("BO_ 300", "XO_ 300"), "11: message ?"),
}


@pytest.mark.parametrize("case", LEFT_OUT)
def test_what_cannot_be_decoded_costs_itself_only(case: str) -> None:
    text, said = LEFT_OUT[case]
    codec = parse_codec(M + text, "x.dbc")
    kept = {name for name in names(codec) if not name.startswith("Bad.")}
    assert kept == {"M.s", "M.t", "N.s"}
    assert "Bad.s" not in names(codec) or case == "two selectors"
    if said[:2].isdigit():
        said = f"x.dbc:{int(said[:2]) + M.count(chr(10))}{said[2:]}"
    assert any(said in str(each) for each in codec.left_out), codec.left_out
    assert all(each.where.startswith("x.dbc") for each in codec.left_out)


REPAIRED = {
    "11 bits": f"{HEAD}{M}{N}".replace("256", "2048"),
    "table of none": f'{HEAD}{M}{N}VAL_ 256 q 1 "a";\nVAL_ 9 s 1 "a";\n',
    "unknown": f"{HEAD}{M}{N}FOO_ bar;\n",
    "range of a FLOAT": f'{HEAD}{M}{N}BA_DEF_ BO_ "f" FLOAT 10000 20000;\n',
}


@pytest.mark.parametrize("case", REPAIRED)
def test_a_repair_loses_nothing(case: str) -> None:
    codec = parse_codec(REPAIRED[case], "x.dbc")
    assert names(codec) == ["M.s", "M.t", "N.s"]
    assert not codec.left_out
    assert codec.message("M").is_extended == (case == "11 bits")


def test_a_signal_outside_of_a_message_costs_nothing_else() -> None:
    table, stray = 'VAL_ 256 t 255 "invalid" ;\n', ' SG_ x : 0|8@1+ (1,0) [0|0] "" A\n'
    codec = parse_codec(HEAD + M + table + stray + N, "x.dbc")
    assert names(codec) == ["M.s", "M.t", "N.s"]
    assert codec.message("M").signal("t").sentinels == (255,)
    assert [each.text for each in codec.left_out] == ["signal x is not valid DBC"]


REFUSED = {
    "empty": ("", "empty"),
    "prose": ("A bump test over CAN.\n", "no messages"),
    "nul": ("VERSION \0", "binary"),
    "header only": (HEAD, "no messages"),
    "type of which message": (f"{HEAD}{M}SIG_VALTYPE_ s : 1;\n", "of an unknown message"),
    "attribute": (f'{HEAD}{M}BA_ "GenMsgOther" BO_ 256 10;\n', "not a valid DBC: 'GenMsgOther'"),
    "huge": (signal('s : 0|999999@1- (1,0) [0|0] "g"'), "x.dbc:12: .* lies outside any payload"),
    "huge message": (f"{HEAD}{M}BO_ 9 L: 999999999 A\n", "x.dbc:.* lies outside any payload"),
    "split over lines": (f'{HEAD}{M}VAL_ 256\n q 1 "a";\n', "not a valid DBC: unused VAL_"),
    "quotes": ('CM_ "\n' * 200, "x.dbc:"),
    "recursion": (
        f'{HEAD}BO_ 1 M: 8 A\n SG_ s0 M : 0|8@1+ (1,0) [0|0] "" B\n'
        + "".join(f' SG_ s{k} m1M : 0|8@1+ (1,0) [0|0] "" B\n' for k in range(1, 1200))
        + "".join(f"SG_MUL_VAL_ 1 s{k} s{k - 1} 1-1;\n" for k in range(1, 1200)),
        "not a valid DBC",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_database_is_refused_in_one_line(case: str) -> None:
    text, said = REFUSED[case]
    with pytest.raises(InputError, match=said) as caught:
        parse_codec(text, "x.dbc")
    assert str(caught.value).isprintable()
    assert str(caught.value).startswith("x.dbc")


@pytest.mark.parametrize("cut", [2, 4, 9, 15, 20])
def test_a_text_that_is_cut_off_is_refused(cut: int) -> None:
    with pytest.raises(InputError, match="ends within a definition"):
        parse_codec((HEAD + M + N + "SIG_VALTYPE_ 256 s : 1;\n")[:-cut], "x.dbc")


@pytest.mark.parametrize(("errors", "loads"), [(40, True), (41, False)])
def test_forty_errors_of_syntax_are_repaired_and_no_more(errors: int, loads: bool) -> None:
    text = HEAD + M + "".join(f'BO_ {k} K{k}: 8 A\n SG_ s ; "" B\n' for k in range(errors)) + N
    if loads:
        assert len(parse_codec(text, "x.dbc").left_out) == 40
        return
    with pytest.raises(InputError, match="more than 40 errors of syntax"):
        parse_codec(text, "x.dbc")


def test_a_comment_may_name_any_size() -> None:
    codec = parse_codec(f'{HEAD}{M}{N}CM_ BO_ 256 "length = 123456";\n', "x.dbc")
    assert names(codec) == ["M.s", "M.t", "N.s"]


@pytest.mark.parametrize(("values", "loads"), [(1 << 11, True), ((1 << 16) + 1, False)])
def test_ranges_of_selectors_have_a_limit(values: int, loads: bool) -> None:
    text = (
        f'{HEAD}BO_ 1 M: 8 A\n SG_ top M : 0|32@1+ (1,0) [0|0] "" B\n'
        f' SG_ s m0 : 32|8@1+ (1,0) [0|0] "" B\nSG_MUL_VAL_ 1 s top 0-{values - 1};\n'
        f"{N}"
    )
    codec = parse_codec(text, "x.dbc")
    assert names(codec) == (["M.top", "M.s", "N.s"] if loads else ["N.s"])
    if loads:
        assert codec.message("M").signal("s").selected_by == ((0, values - 1),)


def test_messages_of_one_name_have_their_identifier_in_it() -> None:
    far = M.replace("256", str((1 << 31) + 256))
    codec = parse_codec(HEAD + M + N + far + N.replace("257 N", "258 M_0x100"), "x.dbc")
    assert [m.name for m in codec.messages] == ["M_0x100", "N", "M_0x100x", "M_0x100xx"]
    decoded = codec.decode(block([b"\2\0\7\0\0\0\0\0"], [256]))
    assert decoded["M_0x100.s"].value.tolist() == [1.0]


def test_roles_long_names_cycles_and_senders_are_read() -> None:
    text = (
        f'{HEAD}{M}BO_TX_BU_ 256 : A,B;\nBA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;\n'
        'BA_DEF_ SG_ "SignalRole" ENUM "value","counter";\n'
        'BA_DEF_ SG_ "SystemSignalLongSymbol" STRING;\nBA_DEF_DEF_ "GenMsgCycleTime" 0;\n'
        f'BA_ "GenMsgCycleTime" BO_ 256 5;\nBA_ "SignalRole" SG_ 256 t 1;\n'
        f'BA_ "SystemSignalLongSymbol" SG_ 256 s "{"long" * 9}";\n'
    )
    message = parse_codec(text, "x.dbc").message("M")
    assert message.cycle_s == 0.005
    assert message.counter is not None
    assert (message.counter.signal, message.counter.modulus) == ("t", 256)
    assert [s.name for s in message.signals] == ["long" * 9, "t"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_encodings_and_line_ends(tmp_path: Path, encoding: str, ends: str) -> None:
    path = tmp_path / "x.dbc"
    path.write_bytes((HEAD + M.replace('"g"', '"°/s"')).replace("\n", ends).encode(encoding))
    assert load_codec(path).message("M").signal("s").unit == "°/s"


def test_decode_ends_with_one_line_for_a_broken_database(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, dbc = tmp_path / "x.log", tmp_path / "x.dbc"
    log.write_text("(1.0) can0 100#0200070000000000\n")
    dbc.write_text("no database")
    assert run(["decode", str(log), "--dbc", str(dbc)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    dbc.write_text(HEAD + M + N.replace(": 0|8@1+", ": 0|8@1"))
    assert run(["decode", str(log), "--dbc", str(dbc)]) == 0
    out, err = capsys.readouterr()
    assert "1.000000000,M,s,1,g" in out
    assert "x.dbc:16: signal s is not valid DBC" in err


# KCD, SYM and ARXML against what they say; databases of several buses ---------------------------


@pytest.mark.parametrize("name", ["a.arxml", "a.xml", "a.dbc"])
def test_arxml_under_any_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(arxml())
    hub = load_codec(path).message("Hub")
    assert (hub.can_id, hub.is_extended, hub.length) == (FRAME, False, 8)
    assert hub.signal("az").unit == "m/s2"
    decoded = load_codec(path).decode(block([(0x3E8 << 4).to_bytes(8, "little")], FRAME))
    assert decoded["Hub.az"].value.tolist() == [490.0]


def test_sym_is_what_cantools_reads() -> None:
    codec = parse_codec(SYM_TEXT, "a.sym")
    theirs = cantools.database.can.Database(strict=False)
    theirs.add_sym_string(SYM_TEXT)
    payload = bytes([1, 0x23, 0x45, 0x67, 0x89, 0x40, 0x12, 0x45])
    for each in theirs.messages:
        decoded = codec.decode(block([payload], each.frame_id, each.is_extended_frame))
        values = each.decode(payload, decode_choices=False)
        ours = {name.partition(".")[2]: s.value.tolist() for name, s in decoded.samples.items()}
        assert {name: value[0] for name, value in ours.items() if value} == values
    assert codec.message("Pots").cycle_s == 0.01
    assert [s.sentinels for m in codec.messages for s in m.signals if s.name == "Mode"] == [(255,)]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.arxml", arxml()[:-60], "not a valid ARXML"),
        ("a.arxml", arxml(100_000_000), r"a.arxml:\d+: .* lies outside any payload"),
        ("a.arxml", "no XML at all", "not a valid ARXML"),
        ("a.kcd", TWO_BUSES.replace('length="16"', 'length="999999999"'), "outside any payload"),
        ("a.kcd", TWO_BUSES[:-30], "not a valid KCD"),
        ("a.kcd", kcd('<Bus name="Empty"/>'), "no messages"),
        ("a.sym", SYM_TEXT.replace("unsigned 12", "unsigned 999999999"), "outside any payload"),
        ("a.sym", "FormatVersion=5.0\n", "not a valid SYM"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(name: str, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        parse_codec(text, name)
    assert str(caught.value).isprintable()


def test_an_identifier_of_two_buses_is_left_out_unless_both_mean_the_same() -> None:
    codec = parse_codec(TWO_BUSES, "car.kcd")
    assert [m.name for m in codec.messages] == ["Own"]
    assert ["of another" in each.text for each in codec.left_out] == [True, True]
    passed = [f'<Bus name="{n}">{kcd_message("Hub", 0.5, producer=n)}</Bus>' for n in "12"]
    gateway = parse_codec(kcd(*passed), "car.kcd")
    assert [m.name for m in gateway.messages] == ["Hub"]
    hubs = kcd_message("Hub", 0.5) + kcd_message("Other", 1)
    twice = f'<Bus name="B">{hubs}{kcd_message("C", 1, 1)}</Bus>'
    assert [m.name for m in parse_codec(kcd(twice), "car.kcd").messages] == ["C"]


# Databases with random faults: each is read, repaired or refused in one line --------------------

TEXTS = {"dbc": shipped_dbc(), "kcd": TWO_BUSES, "sym": SYM_TEXT, "arxml": arxml()}
PIECES = ('"', ";", "\n", "BO_ ", " SG_ ", "VAL_ ", "SG_MUL_VAL_ ", "-", "99999", "ü", "<", ">")


def outcome(rng: np.random.Generator, kind: str) -> str:
    """Return what becomes of a text with one to four faults: read, repaired or refused."""
    text = TEXTS[kind]
    for _ in range(rng.integers(1, 5)):
        at, width = int(rng.integers(len(text) + 1)), int(rng.integers(1, 40))
        piece = PIECES[rng.integers(len(PIECES))]
        change = rng.integers(4)
        if change == 0:  # cut off
            text = text[: max(at, 1)]
        elif change == 1:  # a part is lost
            text = text[:at] + text[at + width :]
        elif change == 2:  # a part comes twice
            text = text[: at + width] + text[at:]
        else:
            text = text[:at] + piece + text[at + (width % 2) :]
    try:
        codec = parse_codec(text, f"x.{kind}")
    except InputError as error:
        return "refused" if str(error).isprintable() else "garbled"
    return "repaired" if codec.left_out else "read"


@settings(max_examples=40, deadline=None, derandomize=True, database=None)
@given(st.integers(0, 1 << 32), st.sampled_from(["dbc", "kcd", "sym", "arxml"]))
def test_a_changed_database_is_read_or_refused_and_nothing_else(seed: int, kind: str) -> None:
    assert outcome(np.random.default_rng(seed), kind) in ("read", "repaired", "refused")


@pytest.mark.long
@pytest.mark.parametrize("kind", TEXTS)
def test_thousands_of_changed_databases_take_no_long_time(kind: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(1250):
        began_s = process_time()
        assert outcome(rng, kind) != "garbled"
        assert process_time() - began_s < 30.0


# Units ------------------------------------------------------------------------------------------

SPELLINGS = {
    "m/s2": (1.0, "m/s2"),
    "m/s^2": (1.0, "m/s2"),
    "m/s²": (1.0, "m/s2"),
    "m/s/s": (1.0, "m/s2"),
    "g": (9.80665, "m/s2"),
    "deg/s": (math.pi / 180, "rad/s"),
    "°/s": (math.pi / 180, "rad/s"),
    "deg/s²": (math.pi / 180, "rad/s2"),
    "µm": (1e-6, "m"),
    "km/h": (1000 / 3600, "m/s"),
    "%": (0.01, "1"),
    "mrad/s": (0.001, "rad/s"),
    "deg": (math.pi / 180, "rad"),
    "in": (0.0254, "m"),
    "ms": (1e-3, "s"),
    "kHz": (1000.0, "Hz"),
    "kN": (1000.0, "N"),
    "kg": (1.0, "kg"),
    "mV": (0.001, "V"),
    "mA": (0.001, "A"),
    "bar": (1e5, "Pa"),
    "": (1.0, "1"),
    # As public databases write them.
    "m.s-2": (1.0, "m/s2"),
    "Unit_MeterPerSeconSquar": (1.0, "m/s2"),
    "Unit_ForceOfGravi": (9.80665, "m/s2"),
    "degrees/sec": (math.pi / 180, "rad/s"),
    "Unit_MilliMeter": (0.001, "m"),
    "Unit_None": (1.0, "1"),
}


def test_factors_are_exact_in_every_spelling() -> None:
    for spelling, (factor, unit) in SPELLINGS.items():
        known = known_si(spelling)
        assert known is not None
        assert (known.unit, known.offset) == (unit, 0.0)
        assert math.isclose(known.factor, factor, rel_tol=1e-15)
    for spelling in ("m/s²", "°/s", "°", "µm", "°C"):
        misread = spelling.encode("utf-8").decode("cp1252")  # UTF-8, read as Windows text
        assert misread != spelling
        assert known_si(misread) == known_si(spelling) is not None
    assert known_si("degC") == SiUnit(1.0, 273.15, "K")


@pytest.mark.parametrize("unit", ["furlong", "M/S2", "m/s3", "deg/h", "\x1b[31m", "\ud800", "°x"])
def test_an_unknown_unit_is_not_guessed(unit: str) -> None:
    assert known_si(unit) is None


def test_every_unit_of_the_shipped_database_is_known() -> None:
    units = {s.unit for m in parse_codec(shipped_dbc(), "shipped").messages for s in m.signals}
    assert {si and si.unit for si in map(known_si, units)} == {"1", "m/s2", "rad/s", "m"}


# Values that are no measurement, by their names ---------------------------------------------------


NO_VALUE = """error|Error|ERROR|Error indicator|Error Indicator|SNA|DI_GEAR_SNA|AEB_SNA|sna|N/A|n.a.
|not available|Not Available|NotAvailable|not_available|Signal not available|TemporarilyNotAvailable
|TemporaryUnavailable|Unavailable|UNAVAILABLE|invalid|Invalid|INVALID|Signal invalid|signal invalid
|SignalInvalid|Invalid (GRAY)|not valid|Value not defined|Undefined|Undefined_2|UNDEFINABLE_DATA
|Unknown|Sensor error|Line error|lfa_error|Sensor fault|LV_FAULT|temporary_fault|Failure|Not used
|Init|INIT|Initialization|Not Initialized|Not Calibrated_(Orange Blink)|Reserved|reserviert
|nicht_verfügbar|nicht_verfuegbar__Fehler_oder_Init|Ersatz_Init_oder_Fehlerwert|Fehler|ungültig
|Init_oder_nicht_verbaut|not recognized|Open circuit|OpenCircuit|Short circuit|short to ground
|No signal|no_data|signal out of range|Not connected|Overflow|ADC saturated
|disconnected|Kurzschluss|cable break
|Error_Code_12|ErrorValue|Not installed""".replace("\n", "")
A_VALUE = """No error|NO_ERROR|No Fault|No_Fault|NO_FAULT|NotFaulted|kein Fehler|without error
|Available|AVAILABLE|Valid|valid signal|Off|On|Zero|Standstill|Max|Full scale|> 1000|Initialized
|driver_override|Normalbetrieb erreicht|nicht_gesperrt
|verriegelt|Default|Terror|Failsafe|not invalid|Signal|Reset
|Error free|Fault not present|error inactive|fault_not_detected|no open circuit|not out of range
|Short track alignment|Open|Bus off|Error_none|Not Detected|1.5 bar|""".replace("\n", "")


def test_names_that_say_there_is_no_value_and_names_that_do_not() -> None:
    assert [label for label in NO_VALUE.split("|") if not names_no_value(label)] == []
    assert [label for label in A_VALUE.split("|") if names_no_value(label)] == []


def one_signal(line: str, tail: str) -> str:
    return f'VERSION ""\n\nBU_: A\n\nBO_ 5 M: 4 A\n SG_ s : {line} A\n\n{tail}\n'


def test_a_sentinel_is_nan_and_marked_and_the_rest_is_scaled() -> None:
    line = '0|16@1+ (0.01,-40) [-40|600] "degC"'
    table = 'VAL_ 5 s 65535 "Signal not available" 65534 "error" 65000 "Max" 0 "Min" ;'
    codec = parse_codec(one_signal(line, table), "x.dbc")
    raws = (0, 1, 4000, 65000, 65533, 65534, 65535)
    sent = [raw.to_bytes(2, "little") for raw in raws]
    samples = codec.decode(block([*sent, b"\xff"], 5))["M.s"]
    assert samples.value[:5].tolist() == [raw * 0.01 + -40 for raw in raws[:5]]
    assert np.isnan(samples.value[5:]).all()
    out, code, cut = Quality.OUT_OF_RANGE, Quality.SENTINEL, Quality.MISSING
    assert samples.quality.tolist() == [0, 0, 0, out, out, code, code, cut]
    assert Quality.SENTINEL in UNUSABLE


@pytest.mark.parametrize(
    ("line", "table", "sentinel", "number"),
    [
        ('0|8@1- (2,0) [0|0] ""', '255 "SNA"', 0xFF, (0x80, -256)),  # written as unsigned
        ('0|8@1- (2,0) [0|0] ""', '-128 "SNA"', 0x80, (0xFF, -2)),
        ('0|8@1+ (2,0) [0|0] ""', '-1 "SNA"', 0xFF, (0x7F, 254)),
        ('7|8@0+ (1,0) [0|0] ""', '256 "SNA" 255 "SNA"', 0xFF, (0, 0)),
        ('0|8@1+ (1,0) [0|0] ""', '0 "error"', 0, (1, 1)),
    ],
)
def test_the_pattern_of_bits_decides(
    line: str, table: str, sentinel: int, number: tuple[int, float]
) -> None:
    codec = parse_codec(one_signal(line, f"VAL_ 5 s {table} ;"), "x.dbc")
    samples = codec.decode(block([bytes([sentinel]) * 4, bytes([number[0]]) * 4], 5))["M.s"]
    assert samples.quality.tolist() == [Quality.SENTINEL, 0]
    assert samples.value[1] == number[1]


def test_a_table_that_names_every_value_is_an_enumeration_and_stays_a_number() -> None:
    table = 'VAL_ 5 s 0 "Off" 1 "On" 2 "Error" 3 "SNA" ;'
    sent = [bytes([raw]) * 4 for raw in range(4)]
    whole = parse_codec(one_signal('0|2@1+ (1,0) [0|0] ""', table), "x.dbc").decode(block(sent, 5))
    assert whole["M.s"].value.tolist() == [0, 1, 2, 3]
    assert not whole["M.s"].quality.any()
    partly = parse_codec(one_signal('0|3@1+ (1,0) [0|0] ""', table), "x.dbc").decode(block(sent, 5))
    assert partly["M.s"].quality.tolist() == [0, 0, Quality.SENTINEL, Quality.SENTINEL]


def test_floats_and_64_bits_have_sentinels_too() -> None:
    single = one_signal(
        '0|32@1- (0.5,0) [0|0] ""', 'SIG_VALTYPE_ 5 s : 1;\nVAL_ 5 s -999 "invalid" ;'
    )
    sent = [np.float32(value).tobytes() for value in (-999, -999.5, np.nan)]
    samples = parse_codec(single, "x.dbc").decode(block(sent, 5))["M.s"]
    assert samples.quality.tolist() == [Quality.SENTINEL, 0, 0]
    assert samples.value[1] == -499.75
    wide = one_signal('0|64@1+ (1,0) [0|0] ""', f'VAL_ 5 s {2**64 - 1} "SNA" ;').replace(
        "M: 4", "M: 8"
    )
    sent = [b"\xff" * 8, b"\xfe" + b"\xff" * 7]
    samples = parse_codec(wide, "x.dbc").decode(block(sent, 5))["M.s"]
    assert samples.quality.tolist() == [Quality.SENTINEL, 0]


def test_selectors_and_counters_keep_their_numbers() -> None:
    both = (
        'VERSION ""\n\nBU_: A\n\nBO_ 5 M: 4 A\n SG_ top M : 0|8@1+ (1,0) [0|0] "" A\n'
        ' SG_ one m255 : 8|8@1+ (1,0) [0|0] "" A\n SG_ n : 16|8@1+ (1,0) [0|0] "" A\n\n'
        'BA_DEF_ SG_ "SignalRole" ENUM "value","counter","crc8_j1850";\n'
        'BA_ "SignalRole" SG_ 5 n 1;\nVAL_ 5 top 255 "invalid" ;\nVAL_ 5 n 255 "invalid" ;\n'
    )
    decoded = parse_codec(both, "x.dbc").decode(block([b"\xff\x07\xff\x00"], 5))
    assert decoded["M.one"].value.tolist() == [7]
    assert decoded["M.n"].value.tolist() == [255]
    assert decoded["M.n"].quality.tolist() == [0]
    assert decoded["M.top"].quality.tolist() == [Quality.SENTINEL]


def test_decode_writes_what_is_a_value(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.dbc").write_text(
        'VERSION ""\n\nBU_: A\n\nBO_ 42 P: 8 A\n SG_ st : 0|8@1+ (1,0) [0|0] "" A\n'
        ' SG_ n : 8|8@1+ (1,0) [0|0] "" A\n SG_ travel : 16|16@1+ (0.01,0) [0|0] "mm" A\n'
        'VAL_ 42 st 0 "Error free" 1 "Error active" 2 "Error passive" ;\n'
        'VAL_ 42 n 0 "Fault not present" 1 "Fault present" ;\n'
        'VAL_ 42 travel 65533 "No signal" 65534 "Open circuit" 65535 "Short circuit" ;\n'
    )
    sent = ("0A00", "FDFF", "FEFF", "FFFF")
    lines = [f"({k}.0) can0 02A#0000{raw}00000000\n" for k, raw in enumerate(sent, 1)]
    (tmp_path / "x.log").write_text("".join(lines))
    assert run(["decode", str(tmp_path / "x.log"), "--dbc", str(tmp_path / "x.dbc")]) == 0
    rows = capsys.readouterr().out.splitlines()[1:]
    assert [row.partition(",P,")[2] for row in rows if "travel" not in row] == ["st,0,", "n,0,"] * 4
    assert [row for row in rows if "travel" in row] == ["1.000000000,P,travel,0.1,mm"]
