"""A mistake in bench.toml is named with its line and the nearest name that there is."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.bench.config import load_bench, parse_bench
from daq.bench.toml_file import line_of
from daq.errors import InputError

TEXT = """\
[campaign]
repeats = 2

[[weight]]
mass_kg = 20.0
x_m = -1.0
y_m = 0.0

[[weight]]
mass_kg = 10.0
hub = "FL"

[vehicle.geometry]
a = 1.2
"""


@pytest.mark.parametrize(
    ("loc", "line"),
    [
        (("campaign", "repeats"), 2),
        (("campaign", "absent"), 1),
        (("weight", 0, "x_m"), 6),
        (("weight", 1, "hub"), 11),
        (("weight", 1, "absent"), 9),
        (("weight", 2), 0),
        (("vehicle", "geometry", "a"), 14),
        (("vehicle", "geometry", "GeometryTable", "a"), 14),
        (("absent",), 0),
        (("weight",), 4),
    ],
)
def test_line(loc: tuple[str | int, ...], line: int) -> None:
    assert line_of(TEXT, loc) == line


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[campaign]\nrepeat = 1\n",
            "b.toml:2: unknown key campaign.repeat"
            " (remove it or correct its name; did you mean repeats?)",
        ),
        (
            "\n[campain]\n",
            "b.toml:2: unknown key campain (remove it or correct its name; did you mean campaign?)",
        ),
        (
            "[campaign]\nrepeats = 2\nexcitations = [\n  'bounce', 'pich',\n]\n",
            "did you mean pitch?)",
        ),
        ("[campaign]\nrepeats = 'two'\n", "b.toml:2: campaign.repeats: must be a valid integer ("),
        (
            "\n[[weigh]]\nmass_kg = 1.0\n[[weigh]]\n",
            "b.toml:2: unknown key weigh (remove it or correct its name; did you mean weight?)",
        ),
        (
            "[[weight]]\nhub = 'FL'\nmass_kgg = 1.0\n",
            "b.toml:3: unknown key weight.0.mass_kgg"
            " (remove it or correct its name; did you mean mass_kg?)",
        ),
        ("[[weight]]\nhub = 'FL'\n", "b.toml:1: weight.0.mass_kg is missing (state it)"),
        (
            "[bus]\nchanel = 'can0'\n",
            "b.toml:2: unknown key bus.chanel"
            " (remove it or correct its name; did you mean channel?)",
        ),
        (
            "[campaign]\nhub = 'FL'\n",  # a key of another table
            "b.toml:2: unknown key campaign.hub (remove it: it has no meaning here)",
        ),
        ("[bus]\nchannel =\n", "b.toml:2: is not TOML: Invalid value, column 10 (correct"),
    ],
)
def test_the_line_and_the_nearest_name_are_said(text: str, said: str) -> None:
    with pytest.raises(InputError) as reported:
        parse_bench(text, "b.toml", Path())
    assert said in str(reported.value)


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ('\ndbc = "gone.dbc"', 2, "dbc: {}/gone.dbc: No such file or directory"),
        ('dbc = "folder"', 1, "dbc: {}/folder: not a file"),
        ('dbc = "layout:nix"', 1, "dbc: layout:nix: there is no such layout"),
        (
            '[[sensor]]\nname = "a"\ndbc = "a.dbc"\n\n[[sensor]]\nname = "b"\ndbc = "gone.dbc"',
            7,
            "sensor.1.dbc: {}/gone.dbc: No such file or directory",
        ),
        (
            '[[sensor]]\nname = "a"\nlayout = "nix"',
            3,
            "sensor.0.layout: layout:nix: there is no such layout",
        ),
        (
            '[[sensor]]\nname = "a"\ndbc = "layout:nix"',
            3,
            "sensor.0.dbc: layout:nix: there is no such layout",
        ),
    ],
)
def test_a_file_that_the_bench_names_and_that_cannot_be_read_is_named_with_its_line(
    tmp_path: Path, text: str, line: int, said: str
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.dbc").write_text('VERSION ""\n', "ascii")
    bench = tmp_path / "my.toml"
    bench.write_text(text, "ascii")
    with pytest.raises(InputError) as caught:
        load_bench(bench)
    assert str(caught.value).startswith(f"{bench}:{line}: {said.format(tmp_path)} (")
