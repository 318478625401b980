"""Text tables of every style: separators, decimal marks, heads, units, dates, and what is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.errors import InputError
from daq.formats import columns
from daq.formats.columns import read_columns

Expected = dict[str, tuple[str, list[float]]]
nan = float("nan")
TABLES: dict[str, tuple[str, Expected]] = {
    "comma": ("a,b\n1.5,2\n3,4\n", {"a": ("", [1.5, 3]), "b": ("", [2, 4])}),
    "semicolon, decimal comma": ("a;b\n1,5;2\n3;4\n", {"a": ("", [1.5, 3]), "b": ("", [2, 4])}),
    "semicolon, decimal point": ("a;b\n1.5;2\n3;4\n", {"a": ("", [1.5, 3]), "b": ("", [2, 4])}),
    "a comma without digits before it": (
        "a;b\n,5;-,25\n1;2\n",
        {"a": ("", [0.5, 1]), "b": ("", [-0.25, 2])},
    ),
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
        "when,x\n1970-01-01 00:00:01,2\n1970-01-01T00:00:02.5,3\n",
        {"when": ("ns", [1e9, 2.5e9]), "x": ("", [2, 3])},
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


@pytest.mark.parametrize(
    "text",
    [
        "a\n1\n2\n",
        "a,b\nx,y\n",
        "1,x\n2,y\n",
        "1,x,y\n2,x,y\n",
        "2026-01-01 10:00,x\n2026-01-01 10:01,y\n",
        "a b\n1 2\n",
    ],
)
def test_what_is_no_table(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match="not a table of numbers"):
        read_columns(tmp_path / "a.csv", ())


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_names_in_any_encoding(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.csv").write_bytes("Höhe [µm];b\n1;2\n".encode(encoding))
    held = read_columns(tmp_path / "a.csv", ()).columns
    assert [(each, column.unit) for each, column in held.items()] == [("Höhe", "µm"), ("b", "")]


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
        (NAMES, "x", ["no column 'x'", "among 5"]),
        (NAMES, "spede", ["no column 'spede'", "among 5: speed"]),
        (NAMES, "aax", ["no column 'aax'", "IMU/ax"]),
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
    path.write_text("t,x,y\n0,1,2\n1,1,5,2\n2,1,2\n3,1,1,1,1,1\n4,,-\n5,fault,2\n6,NaN,2\n")
    held = read_columns(path, ("t", "x", "y"))
    assert held.columns["t"].values.tolist() == [0, 2, 4, 5, 6]
    assert held.unread == (
        "2 rows have a field too many, the first in line 3",
        "1 cell is no number, the first in line 7, column x",
    )


def test_a_long_table_is_known_by_its_first_lines(tmp_path: Path) -> None:
    head = "t;x\n"
    rows = [f"{n};{n},5\n" for n in range(30_000)]
    (tmp_path / "a.csv").write_text(head + "".join(rows), "utf-8")
    assert (tmp_path / "a.csv").stat().st_size > 1 << 18
    held = read_columns(tmp_path / "a.csv", ["x"]).columns
    assert list(held) == ["x"]
    np.testing.assert_array_equal(held["x"].values, np.arange(30_000) + 0.5)


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
def test_a_long_table_has_the_encoding_of_its_head(tmp_path: Path, encoding: str) -> None:
    text = "t;rate\ns;°/s\n" + "".join(f"{n};{n}\n" for n in range(30_000)) + "µ\n"
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    held = read_columns(tmp_path / "a.csv", ()).columns
    assert [(each, column.unit) for each, column in held.items()] == [("t", "s"), ("rate", "°/s")]


@pytest.mark.parametrize(
    ("wanted", "full"),
    [("IMU/az", "IMU/az"), ("ax", "IMU/ax"), ("HUB", "HUB"), ("speed", "speed")],
)
def test_a_column_by_its_name_or_its_end(tmp_path: Path, wanted: str, full: str) -> None:
    assert _named(tmp_path / "a.csv", NAMES, wanted) == full


def test_a_table_is_read_up_to_the_largest_number_of_values(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Two columns of three lines are six values; a column not asked for does not count."""
    monkeypatch.setattr(columns, "MAX_VALUES", 6)
    path = tmp_path / "a.csv"
    path.write_text("a,b,c\n" + "1,2,3\n" * 3)
    assert [len(c.values) for c in read_columns(path, "ab").columns.values()] == [3, 3]
    path.write_text("a,b,c\n" + "1,2,3\n" * 4)
    with pytest.raises(InputError, match="has 8 values"):
        read_columns(path, "ab")
