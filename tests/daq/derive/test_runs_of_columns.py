"""Columns to channels and runs: clocks, units, which samples belong together, what a run lacks."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from daq.bench.campaign import Step
from daq.bench.channel_map import ChannelMap, GivenRun, load_channel_map
from daq.derive.from_columns import Recording, given_run, recording
from daq.runs import Excitation, RunStatus, SampleGroup
from daq.samples.columns import Column, Columns

nan = float("nan")
S = 1_000_000_000
T0_S = 1_780_221_600


@cache
def _map(text: str = "", channels: tuple[str, ...] = ("fl",)) -> ChannelMap:
    """Return a map with an acceleration of each hub that is named."""
    parts = [text]
    for name in channels:
        parts.append(f'[[channel]]\nname = "{name}"\nsignal = "{name}"\n')
        parts.append(f'quantity = "hub_acceleration"\ncorner = "{name.upper()}"\n')
    with TemporaryDirectory() as folder:
        path = Path(folder) / "map.toml"
        path.write_text("".join(parts))
        return load_channel_map(path)


def _file(
    columns: Mapping[str, Any],
    *,
    times_s: Mapping[str, Any] | None = None,
    start_ns: int = 0,
    clocks: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> Columns:
    held = {
        name: Column(
            name,
            (units or {}).get(name, "" if name.startswith("t") else "m/s2"),
            (clocks or {}).get(name, "table"),
            np.asarray(values),
        )
        for name, values in columns.items()
    }
    own = {name: np.asarray(values, float) for name, values in (times_s or {}).items()}
    return Columns("a.csv", start_ns, held, own)


BY_COLUMN = '[time]\ncolumn = "t"\n'


def _times(values: Any, unit: str = "", stated: str = "") -> tuple[int, list[float]]:
    """Return the zero and the times of a channel whose times are these."""
    text = BY_COLUMN + (f'unit = "{stated}"\n' if stated else "")
    file = _file({"t": values, "fl": np.zeros(len(values))}, units={"t": unit, "fl": "m/s2"})
    found = recording(_map(text), file)
    return found.start_ns, found.groups[0].time_s.tolist()


@pytest.mark.parametrize(
    ("values", "unit", "stated", "start_ns", "times_s"),
    [
        ([0.5, 1.5], "", "", 0, [0.5, 1.5]),
        ([500, 1500], "ms", "", 0, [0.5, 1.5]),
        ([500, 1500], "ms", "us", 0, [0.0005, 0.0015]),
        ([99_999_999.5, 99_999_999.75], "s", "", 0, [99_999_999.5, 99_999_999.75]),
        ([100_000_000.0, 100_000_000.5], "s", "", 100_000_000 * S, [0.0, 0.5]),
        ([T0_S + 0.25, T0_S + 1.5], "", "", T0_S * S, [0.25, 1.5]),
        ([nan, T0_S + 0.25], "", "", T0_S * S, [0.25]),
        (np.array([T0_S * S + 250, T0_S * S + S]), "ns", "", T0_S * S, [250e-9, 1.0]),
        (np.array([T0_S * 1000 + 250], "i8"), "", "ms", T0_S * S, [0.25]),
        ([nan, 0.5], "", "", 0, [0.5]),
    ],
)
def test_times_of_a_column(
    values: Any, unit: str, stated: str, start_ns: int, times_s: list[float]
) -> None:
    found_ns, found_s = _times(np.asarray(values), unit, stated)
    assert found_ns == start_ns
    assert_allclose(found_s, times_s, rtol=1e-15, atol=1e-12)


def _groups(fl: Any, fr: Any) -> list[SampleGroup]:
    file = _file({"fl": fl, "fr": fr}, times_s={"table": np.arange(len(fl))})
    return list(recording(_map("", ("fl", "fr")), file).groups)


@pytest.mark.parametrize(("missing", "together"), [(1, True), (2, False)])
def test_channels_that_fill_nine_of_ten_rows_together_are_one_group(
    missing: int, together: bool
) -> None:
    holed = np.where(np.arange(10) < missing, nan, 1.0)
    for pair in ((np.ones(10), holed), (holed, np.ones(10))):
        groups = _groups(*pair)
        assert len(groups) == (1 if together else 2)
        if together:
            assert groups[0].quality.tolist() == [32] * missing + [0] * (10 - missing)
        else:
            assert [group.quality.any() for group in groups] == [False, False]
            assert len({group.name for group in groups}) == 2


STEP = Step("baseline", Excitation.ROLL, 2)


def _found(rate_hz: float = 10.0, length_s: float = 10.0, start_ns: int = T0_S * S) -> Recording:
    time_s = np.arange(round(rate_hz * length_s)) / rate_hz
    file = _file({"fl": time_s * 2}, times_s={"table": time_s}, start_ns=start_ns)
    return recording(_map(), file)


@pytest.mark.parametrize(
    ("start_s", "stop_s", "good"),
    [
        (0.0, 10.0, True),
        (-0.24, 5.0, True),  # two samples of 0.1 s and 0.05 s
        (-0.26, 5.0, False),
        (5.0, 10.14, True),  # the last sample is at 9.9 s
        (5.0, 10.16, False),
    ],
)
def test_a_run_is_covered_by_its_samples(start_s: float, stop_s: float, good: bool) -> None:
    run = given_run(_map(), _found(), GivenRun(STEP, start_s, stop_s))
    assert run.status is (RunStatus.ACCEPTED if good else RunStatus.REJECTED)
    assert len(run.reasons) == (0 if good else 1)
