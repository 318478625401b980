"""Samples as CSV: which characters may separate, what stands in the file, and what is read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.errors import InputError
from daq.formats.export import CsvStyle
from daq.formats.export.csv_files import read_csv, write_csv
from daq.runs import SampleGroup

GROUP = SampleGroup(
    "HUB",
    np.array([0.0, 0.1]),
    np.zeros(2, np.int64),
    {"fl": np.array([1.5, np.nan]), "n, 1": np.array([-1e-07, 1 / 3])},
    np.array([0, 34], np.uint8),
)
UNITS = {"fl": "m/s2", "n, 1": ""}


@pytest.mark.parametrize(
    ("separator", "decimal", "option"),
    [
        (",", ".", ""),
        (";", ".", ""),
        (";", ",", ""),
        ("\t", ",", ""),
        ("|", ".", ""),
        (",", ",", "--separator"),
        (";", ";", "--decimal"),
        (";", "", "--decimal"),
        ("", ".", "--separator"),
        (";;", ".", "--separator"),
        *((bad, ".", "--separator") for bad in '"\r\n.-+eE0579 '),
    ],
)
def test_characters_that_separate(separator: str, decimal: str, option: str) -> None:
    if not option:
        assert CsvStyle(separator, decimal).separator == separator
        return
    with pytest.raises(InputError) as refused:
        CsvStyle(separator, decimal)
    assert refused.value.where == option


def test_what_stands_in_the_file(tmp_path: Path) -> None:
    write_csv(GROUP, UNITS, tmp_path / "a.csv", CsvStyle())
    assert (tmp_path / "a.csv").read_bytes().decode() == (
        'time_s,fl [m/s2],"n, 1",quality\r\n0.0,1.5,-1e-07,0\r\n0.1,,0.3333333333333333,34\r\n'
    )
    write_csv(GROUP, UNITS, tmp_path / "b.csv", CsvStyle(";", ","))
    assert (tmp_path / "b.csv").read_bytes().decode() == (
        "time_s;fl [m/s2];n, 1;quality\r\n0,0;1,5;-1e-07;0\r\n0,1;;0,3333333333333333;34\r\n"
    )


@pytest.mark.parametrize("style", [CsvStyle(), CsvStyle(";", ","), CsvStyle("\t")])
def test_numbers_are_read_back_exactly(tmp_path: Path, style: CsvStyle) -> None:
    path = tmp_path / "a.csv"
    write_csv(GROUP, UNITS, path, style)
    time_s, values = read_csv(path, style, ["fl", "n, 1"])
    np.testing.assert_array_equal(time_s, GROUP.time_s)
    assert list(values) == ["fl", "n, 1"]
    for name in values:
        np.testing.assert_array_equal(values[name], GROUP.values[name])


@pytest.mark.parametrize(
    ("text", "channels"),
    [
        ("time_s,a,b,quality\n", ["a"]),
        ("time_s,a,quality\n", ["a", "b"]),
        ("t,a,quality\n", ["a"]),
        ("", ["a"]),
    ],
)
def test_a_file_with_other_columns_is_refused(
    tmp_path: Path, text: str, channels: list[str]
) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ValueError, match=r"a\.csv"):
        read_csv(tmp_path / "a.csv", CsvStyle(), channels)


def test_a_file_without_a_row_has_no_samples(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time_s,a,quality\n")
    time_s, values = read_csv(tmp_path / "a.csv", CsvStyle(), ["a"])
    assert (len(time_s), len(values["a"])) == (0, 0)
