"""Decoded channels from files of other tools: text tables of every style, MF4, MATLAB, Parquet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.io import savemat

from daq.formats.columns import read_columns
from daq.runs import RunStatus
from daq.session.from_columns import bump_run, bumps_in, recording
from dbc.words import InputError

from .channel_files import WRITERS, Tables, mapped

Expected = dict[str, tuple[str, list[float]]]
nan = float("nan")
TABLES: dict[str, tuple[str, Expected]] = {
    "comma": ("a,b\n1.5,2\n3,4\n", {"a": ("", [1.5, 3]), "b": ("", [2, 4])}),
    "semicolon, decimal comma": ("a;b\n1,5;2\n3;4\n", {"a": ("", [1.5, 3]), "b": ("", [2, 4])}),
    "semicolon, decimal point": ("a;b\n1.5;2\n3;4\n", {"a": ("", [1.5, 3]), "b": ("", [2, 4])}),
    "no digit before it": ("a;b\n,5;-,25\n1;2\n", {"a": ("", [0.5, 1]), "b": ("", [-0.25, 2])}),
    "no head": ("1,2\n3,4\n", {"column 1": ("", [1, 3]), "column 2": ("", [2, 4])}),
    "an empty name": (
        "a,,c\n1,2,3\n4,5,6\n",
        {"a": ("", [1, 4]), "column 2": ("", [2, 5]), "c": ("", [3, 6])},
    ),
    "a name twice": ("a,b,a\n1,2,3\n", {"a": ("", [1]), "b": ("", [2]), "a:3": ("", [3])}),
    "units in brackets": (
        "t [s],x (mm), y ( g )\n1,2,3\n",
        {"t": ("s", [1]), "x": ("mm", [2]), "y": (" g ", [3])},
    ),
    "brackets within": ("x (front) [mm],y\n1,2\n", {"x (front)": ("mm", [1]), "y": ("", [2])}),
    "a line of units": ("t,x\ns,mm\n1,2\n", {"t": ("s", [1]), "x": ("mm", [2])}),
    "a unit beside one in a name": (
        "t [s],x\ng,mm\n1,2\n",
        {"t [s]": ("g", [1]), "x": ("mm", [2])},
    ),
    "no line of units": ("Logger,7a\nt,x\n1,2\n", {"t": ("", [1]), "x": ("", [2])}),
    "one separator more in the data": (
        "t;x\n1;2;\n3;4;\n",
        {"t": ("", [1, 3]), "x": ("", [2, 4]), "column 3": ("", [nan, nan])},
    ),
    "one separator more in the head": ("t;x;\n1;2\n3;4\n", {"t": ("", [1, 3]), "x": ("", [2, 4])}),
    "gaps": (
        "t,x,y\n1,2,\n3,,4\n5,nan,\n",
        {"t": ("", [1, 3, 5]), "x": ("", [2, nan, nan]), "y": ("", [nan, 4, nan])},
    ),
    "gaps before the first full line": (
        "t,x\n1,\n,2\n3,4\n",
        {"t": ("", [1, nan, 3]), "x": ("", [nan, 2, 4])},
    ),
    "words among numbers": ("t,x\n1,2\n3,overload\n", {"t": ("", [1, 3]), "x": ("", [2, nan])}),
    "quotes": ('"t","x, y"\n"1","2"\n', {"t": ("", [1]), "x, y": ("", [2])}),
    "dates": (
        "when,x\n1970-01-01 00:00:01,2\n1970-01-01T00:00:02.5,3\n,4\n",
        {"when": ("ns", [1e9, 2.5e9, nan]), "x": ("", [2, 3, 4])},
    ),
    "mostly numbers": (
        "a,b,c\n1,2,on\n3,4,off\n",
        {"a": ("", [1, 3]), "b": ("", [2, 4]), "c": ("", [nan, nan])},
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table(tmp_path: Path, name: str) -> None:
    text, expected = TABLES[name]
    (tmp_path / "a.csv").write_text(text)
    held = read_columns(tmp_path / "a.csv", ()).columns
    assert {each: column.unit for each, column in held.items()} == (
        {each: unit for each, (unit, _) in expected.items()}
    )
    for each, (_, values) in expected.items():
        np.testing.assert_array_equal(held[each].values.astype(float), values)


def _named(path: Path, names: str, wanted: str) -> str:
    """Return the full name of a column of a table with these names."""
    cells = ",".join("1" for _ in names.split(","))
    path.write_text(f"{names}\n{cells}\n{cells}\n")
    return read_columns(path, [wanted]).columns[wanted].name


NAMES = "IMU/az,IMU/ax,HUB/az,HUB,speed"


@pytest.mark.parametrize(
    ("names", "wanted", "said"),
    [
        (NAMES, "az", ["2 columns", "IMU/az, HUB/az"]),
        (NAMES, "x", ["no column 'x'", "it has IMU/az, IMU/ax, HUB/az, HUB, speed"]),
        (NAMES, "U/az", ["no column 'U/az'"]),
        (NAMES, "x" * 101, ["has no column '" + "x" * 97 + "...'"]),
        (",".join(f"g{n}/x" for n in range(6)), "x", ["write one of g0/x, g1/x, g2/x, g3/x)"]),
    ],
)
def test_a_column_that_is_not_there_once(
    tmp_path: Path, names: str, wanted: str, said: list[str]
) -> None:
    with pytest.raises(InputError) as refused:
        _named(tmp_path / "a.csv", names, wanted)
    assert all(words in str(refused.value) for words in said)


def test_the_decimal_mark_is_that_of_the_whole_table(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    whole = "".join(f"{n};{n}\n" for n in range(100))
    path.write_text(f"t;x\n{whole}100,5;3,25\n")
    held = read_columns(path, ("t", "x"))
    assert (held.columns["x"].values[-1], held.unread) == (3.25, ())
    path.write_text(f"t;x\n{whole}100,5;3,25\n101.5;1\n")
    held = read_columns(path, ("t", "x"))
    assert np.isnan(held.columns["x"].values[100])
    assert held.unread == ("2 cells are no numbers, the first in line 102, column t",)


def test_rows_with_a_field_too_many_and_cells_that_are_no_numbers_are_counted(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,x,y\n0,1,2\n1,1,5,2\n2,1,2\n4,,-\n5,fault,2\n6,NaN,2\n")
    held = read_columns(path, ("t", "x", "y"))
    assert held.columns["t"].values.tolist() == [0, 2, 4, 5, 6]
    assert held.unread == (
        "1 row has a field too many, the first in line 3",
        "1 cell is no number, the first in line 6, column x",
    )
    path.write_text("t,x,y\n0,1,2\n1,1,2,3,4\n")
    with pytest.raises(InputError, match="Expected 4 fields in line 3, saw 5"):
        read_columns(path, ("t",))


def test_a_long_table_is_known_by_its_first_lines(tmp_path: Path) -> None:
    head = "t;x\n"
    rows = [f"{n:060};{n},5\n" for n in range(2000)]
    (tmp_path / "a.csv").write_text(head + "".join(rows), "utf-8")
    assert (tmp_path / "a.csv").stat().st_size > 1 << 17
    held = read_columns(tmp_path / "a.csv", ["x"]).columns
    assert list(held) == ["x"]
    np.testing.assert_array_equal(held["x"].values, np.arange(2000) + 0.5)


@pytest.mark.parametrize("rows", [1, 2100])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_table_has_the_encoding_of_its_head(tmp_path: Path, encoding: str, rows: int) -> None:
    text = "Höhe;rate\nµm;°/s\n" + "".join(f"{n:060};{n}\n" for n in range(rows))
    (tmp_path / "a.csv").write_bytes((text + "µ\n" * (rows > 1)).encode(encoding))
    held = read_columns(tmp_path / "a.csv", ()).columns
    assert {each: column.unit for each, column in held.items()} == {"Höhe": "µm", "rate": "°/s"}


def test_a_column_by_its_name_or_its_end(tmp_path: Path) -> None:
    for wanted, full in {"IMU/az": "IMU/az", "ax": "IMU/ax", "HUB": "HUB"}.items():
        assert _named(tmp_path / "a.csv", NAMES, wanted) == full


# Channels of MDF, Parquet, MATLAB and CSV files: what is read, and what ---------------------------


if TYPE_CHECKING:
    import asammdf

HUB = """
[[channel]]
name = "hub_fl"
signal = "fl"
quantity = "hub_acceleration"
corner = "FL"
"""
T = np.arange(400) / 200.0
FL = np.sin(9.0 * T)


@pytest.mark.parametrize("suffix", WRITERS)
def test_channels_come_back_digit_for_digit(tmp_path: Path, suffix: str) -> None:
    tables: Tables = {}
    rng, path = np.random.default_rng(1), tmp_path / f"car{suffix}"
    for group, rate_hz, names in (("HUB", 200.0, ("fl", "fr")), ("IMU", 50.0, ("az", "pitch"))):
        time_s = np.arange(700) / rate_hz + 1e-5 * rng.random(700)
        tables[group] = time_s, {name: rng.standard_normal(700) for name in names}
    time_column, write = WRITERS[suffix]
    write(tables, path)
    for group, (time_s, columns) in tables.items():
        times = time_column.format(group=group)
        held = read_columns(path, [*columns, *[times] * bool(times)])
        for name, values in columns.items():
            column = held.columns[name]
            found_s = held.columns[times].values if times else held.times_s[column.clock]
            is_sampled = ~np.isnan(column.values)
            assert_array_equal(found_s[is_sampled], time_s)
            assert_array_equal(column.values[is_sampled], values)


BUMPS = """
[trigger]
level = 3.0
pre_s = 0.5
post_s = 1.0
rest_s = 0.2
"""


def test_the_trigger_finds_the_bumps(tmp_path: Path) -> None:
    import pandas as pd

    t = np.arange(4000) / 500.0
    value = np.zeros(4000)
    for onset in (700, 2700):  # 1.4 s, 5.4 s; the second sample is the second away from rest
        value[onset : onset + 100] = 20.0 * np.sin(np.arange(100) / 5.0 + 0.5)
    path = tmp_path / "a.csv"
    pd.DataFrame({"fl": value, "fr": value}).to_csv(path, index=False)
    known = mapped(path, f'{BUMPS}[time]\nrate_hz = 500.0\n{HUB}signal_unit = "m/s2"\n')
    found = recording(known, read_columns(path, known.columns))
    onsets = bumps_in(known, found)
    assert [event.t_ns for event in onsets] == [1_400_000_000, 5_400_000_000]
    step = known.campaign.steps[0]
    run = bump_run(known, found, step, onsets[1])
    assert (run.t0_ns, run.status) == (4_900_000_000, RunStatus.ACCEPTED)
    assert run.groups[0].time_s[[0, -1]] == pytest.approx([0.0, 1.498], abs=1e-9)
    assert t[2450] == 4.9
    assert_array_equal(run.groups[0].values["hub_fl"], value[2450:3200])
    early = replace(onsets[0], t_ns=200_000_000)
    assert bump_run(known, found, step, early).reasons == (
        "table 500 Hz reaches only from 0.30 to 1.50 s of 1.50 s",
    )


def test_clocks_that_begin_in_different_seconds_since_1970_stay_together(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,fl,u,fr\n1700000000.75,0.75,1700000001.25,1.25\n")
    front_left = f'{HUB}signal_unit = "m/s2"\ntime_column = "t"\n'
    front_right = front_left.replace("fl", "fr").replace("FL", "FR").replace('"t"', '"u"')
    known = mapped(path, front_left + front_right)
    for group in recording(known, read_columns(path, known.columns)).groups:
        (value,) = group.values.values()
        assert group.time_s == value
        assert group.t_ns - 1_700_000_000_000_000_000 == 1e9 * value


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", r"channel hub_fl: fl has no times in .*state column or rate_hz"),
        ('[time]\ncolumn = "fl"\n', "do not increase after 0.999991 s"),
        ('[time]\ncolumn = "t"\nunit = "g"\n', "its times t are in 'g'"),
        ('[time]\ncolumn = "u"\n', r"has no column 'u' .*it has t, fl"),
        ('[time]\ncolumn = "t"\nrate_hz = 5\n', "either column or rate_hz"),
        (
            '[[run]]\nmass_state="x"\nexcitation="roll"\nstart_s=0\nstop_s=1\n',
            "run.1.mass_state: must be 'baseline'",
        ),
        ("[[run]]\nstart_s=1\nstop_s=1\n", "run.1.mass_state"),
        ('dbc = "a.dbc"\n', "unknown key dbc"),
    ],
)
def test_what_a_map_gets_wrong_is_said(tmp_path: Path, text: str, why: str) -> None:
    import pandas as pd

    path = tmp_path / "a.csv"
    pd.DataFrame({"t": T, "fl": FL}).to_csv(path, index=False)

    def imported() -> object:
        known = mapped(path, f'{text}{HUB}signal_unit = "m/s2"\n')
        return recording(known, read_columns(path, known.columns))

    with pytest.raises(InputError, match=why):
        imported()


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(10 << 30)


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda p: p.write_bytes(b""), "is empty"),
        (lambda p: p.write_text("nothing but\nwords here\n"), "is not a table of numbers"),
        (lambda p: p.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(500)), "is not a table of numbers"),
        (_sparse, "is not a table of numbers"),
        (lambda p: p.write_bytes(b"UnFinMF 4.10"), "was not finished by its logger"),
        (lambda p: p.write_bytes(b"\x89HDF\r\n\x1a\n"), "is HDF5"),
        (lambda p: p.write_text("a\n1\n2\n"), "is not a table of numbers"),
        (lambda p: p.write_text("1,x,y\n2,x,y\n"), "is not a table of numbers"),
        (lambda p: p.write_text("2026-01-01 10:00,x\n"), "is not a table of numbers"),
        (lambda p: p.write_text("a b\n1 2\n"), "is not a table of numbers"),
        (lambda p: p.mkdir(), "is a directory"),
    ],
)
def test_what_is_no_table_is_refused(
    tmp_path: Path, make: Callable[[Path], object], why: str
) -> None:
    path = tmp_path / "a.csv"
    make(path)
    with pytest.raises(InputError, match=why):
        read_columns(path, ())


@pytest.mark.parametrize(("last", "fits"), [(4_102_444_799.0, True), (4_102_444_800.0, False)])
def test_times_after_2100_are_in_another_unit(tmp_path: Path, last: float, fits: bool) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"t,fl [g]\n{last - 2.0!r},1\n{last - 1.0!r},2\n{last!r},3\n")
    known = mapped(path, f'[time]\ncolumn = "t"\n{HUB}')
    if fits:
        found = recording(known, read_columns(path, known.columns))
        assert found.start_ns == round(last - 2.0) * 1_000_000_000
        return
    with pytest.raises(InputError, match=r"its times t reach 4.1.*after 2100 \(state their unit"):
        recording(known, read_columns(path, known.columns))


def test_a_unit_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,fl [mm]\n0,1\n1,2\n")
    known = mapped(path, f'[time]\ncolumn = "t"\n{HUB}')
    with pytest.raises(InputError, match=r"fl has unit 'mm' in .*a.csv; hub_acceleration needs"):
        recording(known, read_columns(path, known.columns))


# Columns by the libraries -------------------------------------------------------------------------

X = np.arange(3.0)


def _signal(name: str, values: Any = X, start_s: float = 0.0, **more: Any) -> asammdf.Signal:
    import asammdf

    values = np.asarray(values)
    return asammdf.Signal(values, start_s + np.arange(len(values)) / 4, name=name, **more)


def _write(path: Path, groups: Sequence[tuple[str, list[asammdf.Signal]]]) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as mdf:
        mdf.header.start_time = datetime(2026, 5, 31, 10, 0, 0, 250_001, UTC)
        for name, signals in groups:
            mdf.append(signals, acq_name=name, common_timebase=True)
        mdf.save(path, overwrite=True)


def test_channels_have_the_name_and_the_times_of_their_group(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    _write(
        path,
        [
            ("IMU", [_signal("az", unit="g"), _signal("ax")]),
            ("", [_signal("az", start_s=1.0)]),
            ("IMU", [_signal("az", start_s=2.0)]),
        ],
    )
    held = read_columns(path, ())
    assert held.start_ns == 1_780_221_600_250_001_000
    found = {name: (c.unit, float(held.times_s[c.clock][0])) for name, c in held.columns.items()}
    assert found == {
        "IMU/az": ("g", 0.0),
        "IMU/ax": ("", 0.0),
        "group 1/az": ("", 1.0),
        "IMU (group 2)/az": ("", 2.0),
    }
    assert held.times_s[held.columns["IMU/az"].clock].tolist() == [0.0, 0.25, 0.5]


BEGAN = datetime(2026, 5, 31, 10, tzinfo=UTC)
BEGAN_NS = 1_780_221_600_000_000_000


def test_columns_of_parquet(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    arrays = {
        "f8": (pa.array([1.5, 2.5]), [1.5, 2.5]),
        "f2": (pa.array(np.array([1.5, 2.5], "f2")), [1.5, 2.5]),
        "i4": (pa.array([1, 2], pa.int32()), [1, 2]),
        "u1": (pa.array([1, 255], pa.uint8()), [1, 255]),
        "holes": (pa.array([1, None], pa.int64()), [1.0, np.nan]),
        "second": (pa.array([BEGAN, BEGAN], pa.timestamp("s", "UTC")), [BEGAN_NS] * 2),
        "micro": (pa.array([BEGAN, BEGAN], pa.timestamp("us")), [BEGAN_NS] * 2),
        "text": (pa.array(["a", "b"]), None),
        "flag": (pa.array([True, False]), None),
    }
    about = {
        "f8": {"unit": "g"},
        "f2": {"units": "mm"},
        "i4": {"Unit": "V"},
        "micro": {"unit": "s"},
    }
    fields = [pa.field(n, a.type, metadata=about.get(n)) for n, (a, _) in arrays.items()]
    table = pa.table([a for a, _ in arrays.values()], schema=pa.schema(fields))
    parquet.write_table(table, tmp_path / "a.parquet")
    held = read_columns(tmp_path / "a.parquet", ()).columns
    assert list(held) == [name for name, (_, values) in arrays.items() if values is not None]
    for name, column in held.items():
        np.testing.assert_array_equal(column.values, np.array(arrays[name][1]))
        assert column.clock == "table"
    units = {name: column.unit for name, column in held.items() if column.unit}
    assert units == {"f8": "g", "f2": "mm", "i4": "V", "second": "ns", "micro": "ns"}


ROW = np.arange(300.0)
DATASETS: dict[str, tuple[Any, dict[str, float]]] = {
    "one dimension": (ROW, {"x": 1}),
    "a row": (ROW.reshape(1, -1), {"x": 1}),
    "a column": (ROW.reshape(-1, 1), {"x": 1}),
    "a pile": (ROW.reshape(1, -1, 1), {"x": 1}),
    "a tall table": (np.column_stack([ROW, -ROW]), {"x:1": 1, "x:2": -1}),
    "a broad table": (np.stack([ROW, -ROW]), {"x:1": 1, "x:2": -1}),
    "a square": (np.array([[1.0, 2.0], [3.0, 4.0]]), {"x:1": 3, "x:2": 4}),
    "whole numbers": (np.arange(5, dtype="i4"), {"x": 1}),
    "unsigned": (np.arange(5, dtype="u1"), {"x": 1}),
    "big-endian": (np.arange(5, dtype=">f4"), {"x": 1}),
    # A table has 256 columns at most, and an image is none.
    "wide": (np.tile(ROW[:, None], 256), {f"x:{n}": 1 for n in range(1, 257)}),
    "wider": (np.zeros((300, 257)), {}),
    "a cube": (np.zeros((2, 2, 2)), {}),
}


@pytest.mark.parametrize("name", DATASETS)
def test_columns_of_matlab(tmp_path: Path, name: str) -> None:
    values, expected = DATASETS[name]
    savemat(tmp_path / "a.mat", {"x": values, "y": ROW})
    held = read_columns(tmp_path / "a.mat", ()).columns
    assert {n: float(column.values[1]) for n, column in held.items()} == expected | {"y": 1.0}


def test_structs_of_matlab(tmp_path: Path) -> None:
    savemat(
        tmp_path / "a.mat",
        {
            "rec": {"t": ROW, "x": -ROW, "deep": {"s": ROW}},
            "list": [{"v": ROW}, {"Name": "rear", "v": ROW}],
            "words": "text",
            "one": 5.0,
        },
    )
    held = read_columns(tmp_path / "a.mat", ()).columns
    expected = {
        "rec/t": "rec",
        "rec/x": "rec",
        "rec/deep/s": "rec/deep",
        "list/1/v": "list/1",
        "list/rear/v": "list/rear",
    }
    assert {name: column.clock for name, column in held.items()} == expected


def test_a_channel_without_a_unit_has_that_of_its_conversion(tmp_path: Path) -> None:
    from asammdf.blocks.conversion_utils import from_dict

    rule = from_dict({"a": 2.0, "b": 0.0})
    rule.unit = "m/s2"
    path = tmp_path / "a.mf4"
    _write(path, [("IMU", [_signal("az", conversion=rule), _signal("ax")])])
    units = {name: column.unit for name, column in read_columns(path, ()).columns.items()}
    assert units == {"IMU/az": "m/s2", "IMU/ax": ""}


def test_values_that_are_invalid_are_missing(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    bits = np.array([False, True, False])
    _write(path, [("g", [_signal("x", invalidation_bits=bits), _signal("y")])])
    held = read_columns(path, ()).columns
    np.testing.assert_array_equal(held["g/x"].values, [0.0, np.nan, 2.0])
    np.testing.assert_array_equal(held["g/y"].values, X)
