"""Value tables: codes that are no measurement become NaN, all else is scaled."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from dbc import UNUSABLE, InputError, Quality, parse_codec, shipped_dbc, to_si
from dbc.database import names_no_value
from tui.cli import run

from .databases import block

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
    "": (1.0, "1"),
    # As public databases write them.
    "m.s-2": (1.0, "m/s2"),
    "Unit_MeterPerSeconSquar": (1.0, "m/s2"),
    "Unit_ForceOfGravi": (9.80665, "m/s2"),
    "degrees/sec": (math.pi / 180, "rad/s"),
    "Unit_MilliMeter": (0.001, "m"),
    "Unit_None": (1.0, "1"),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_factors_are_exact_in_every_spelling(spelling: str) -> None:
    factor, unit = SPELLINGS[spelling]
    known = to_si(spelling)
    assert (known.unit, known.offset) == (unit, 0.0)
    assert math.isclose(known.factor, factor, rel_tol=1e-15)


@pytest.mark.parametrize("spelling", ["m/s²", "°/s", "°", "µm", "°C"])
def test_utf8_that_was_read_as_windows_text_is_recognised(spelling: str) -> None:
    misread = spelling.encode("utf-8").decode("cp1252")
    assert misread != spelling
    assert to_si(misread) == to_si(spelling)


@pytest.mark.parametrize("unit", ["furlong", "M/S2", "m/s3", "deg/h", "\x1b[31m", "\ud800", "°x"])
def test_an_unknown_unit_is_refused_and_not_guessed(unit: str) -> None:
    with pytest.raises(InputError, match="not known") as refusal:
        to_si(unit)
    assert str(refusal.value).isprintable()


def test_every_unit_of_the_shipped_database_is_known() -> None:
    units = {s.unit for m in parse_codec(shipped_dbc(), "shipped").messages for s in m.signals}
    assert {to_si(unit).unit for unit in units} == {"1", "m/s2", "rad/s", "m"}


SI = {
    "1": {"1": 1.0, "%": 0.01},
    "m/s2": {"mm/s2": 0.001},
    "rad/s": {"mrad/s": 0.001},
    "rad/s2": {"rad/s2": 1.0},
    "rad": {"rad": 1.0, "deg": 0.017453292519943295},
    "m": {"in": 0.0254},
    "m/s": {"m/s": 1.0, "mm/s": 0.001, "kph": 0.2777777777777778},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "Hz": {"Hz": 1.0, "kHz": 1000.0},
    "N": {"N": 1.0, "kN": 1000.0},
    "kg": {"kg": 1.0},
    "V": {"V": 1.0, "mV": 0.001},
    "A": {"A": 1.0, "mA": 0.001},
    "Pa": {"bar": 1e5, "kPa": 1000.0, "Pa": 1.0},
    "K": {"K": 1.0},
}


def test_each_unit_is_that_of_the_si() -> None:
    for si, units in SI.items():
        for unit, factor in units.items():
            known = to_si(unit)
            assert known.factor == pytest.approx(factor, rel=1e-15)
            assert (known.offset, known.unit) == (0.0, si)


def test_degrees_celsius_have_their_zero_at_273_15_kelvin() -> None:
    celsius = to_si("degC")
    assert celsius.factor * 20 + celsius.offset == pytest.approx(293.15, rel=1e-15)
    assert celsius.unit == "K"


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


@pytest.mark.parametrize("label", NO_VALUE.split("|"))
def test_names_that_say_there_is_no_value(label: str) -> None:
    assert names_no_value(label)


@pytest.mark.parametrize("label", A_VALUE.split("|"))
def test_names_that_do_not(label: str) -> None:
    assert not names_no_value(label)


def text(line: str, tail: str) -> str:
    return f'VERSION ""\n\nBU_: A\n\nBO_ 5 M: 4 A\n SG_ s : {line} A\n\n{tail}\n'


def test_a_sentinel_is_nan_and_marked_and_the_rest_is_scaled() -> None:
    line = '0|16@1+ (0.01,-40) [-40|600] "degC"'
    table = 'VAL_ 5 s 65535 "Signal not available" 65534 "error" 65000 "Max" 0 "Min" ;'
    codec = parse_codec(text(line, table), "x.dbc")
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
    codec = parse_codec(text(line, f"VAL_ 5 s {table} ;"), "x.dbc")
    samples = codec.decode(block([bytes([sentinel]) * 4, bytes([number[0]]) * 4], 5))["M.s"]
    assert samples.quality.tolist() == [Quality.SENTINEL, 0]
    assert samples.value[1] == number[1]


def test_a_table_that_names_every_value_is_an_enumeration_and_stays_a_number() -> None:
    table = 'VAL_ 5 s 0 "Off" 1 "On" 2 "Error" 3 "SNA" ;'
    sent = [bytes([raw]) * 4 for raw in range(4)]
    whole = parse_codec(text('0|2@1+ (1,0) [0|0] ""', table), "x.dbc").decode(block(sent, 5))
    assert whole["M.s"].value.tolist() == [0, 1, 2, 3]
    assert not whole["M.s"].quality.any()
    partly = parse_codec(text('0|3@1+ (1,0) [0|0] ""', table), "x.dbc").decode(block(sent, 5))
    assert partly["M.s"].quality.tolist() == [0, 0, Quality.SENTINEL, Quality.SENTINEL]


def test_floats_and_64_bits_have_sentinels_too() -> None:
    single = text('0|32@1- (0.5,0) [0|0] ""', 'SIG_VALTYPE_ 5 s : 1;\nVAL_ 5 s -999 "invalid" ;')
    sent = [np.float32(value).tobytes() for value in (-999, -999.5, np.nan)]
    samples = parse_codec(single, "x.dbc").decode(block(sent, 5))["M.s"]
    assert samples.quality.tolist() == [Quality.SENTINEL, 0, 0]
    assert samples.value[1] == -499.75
    wide = text('0|64@1+ (1,0) [0|0] ""', f'VAL_ 5 s {2**64 - 1} "SNA" ;').replace("M: 4", "M: 8")
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
