"""A mistake in bench.toml is named with its line and the nearest name that there is."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.bench.config import parse_bench
from daq.bench.mistakes import line_of
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
        ("[campaign]\nrepeats = 'two'\n", "b.toml:2: campaign.repeats: "),
    ],
)
def test_the_line_and_the_nearest_name_are_said(text: str, said: str) -> None:
    with pytest.raises(InputError) as reported:
        parse_bench(text, "b.toml", Path())
    assert said in str(reported.value)
