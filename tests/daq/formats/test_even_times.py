"""Universal files with an even abscissa, where it is asked for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyuff
from numpy.testing import assert_allclose, assert_array_equal

from daq.errors import InputError
from daq.formats.export import export_session, format_of, with_even_times
from daq.formats.exported import exported_session
from daq.runs import SampleGroup
from daq.sessions import Session

from ..small_session import small_session


@pytest.fixture(scope="module")
def session() -> Session:
    """Return a session with one run of two channels at uneven times, one sample missing."""
    whole = small_session()
    rng = np.random.default_rng(2)
    time_s = -0.0123456789 + np.cumsum(rng.uniform(0.004, 0.006, 400))
    values = {"hub_fl": np.sin(20.0 * time_s), "hub_fr": np.cos(20.0 * time_s)}
    values["hub_fr"][100] = np.nan
    t_ns = np.rint(time_s * 1e9).astype(np.int64)
    group = SampleGroup("HUB_Front", time_s, t_ns, values, np.zeros(400, np.uint8))
    return replace(whole, runs=(replace(whole.runs[0], groups=(group,)),))


@pytest.mark.parametrize("rate_hz", [200.0, 300.0])
def test_records_are_even_and_hold_the_signal(
    tmp_path: Path, session: Session, rate_hz: float
) -> None:
    path = tmp_path / "car.uff"
    even = with_even_times(session, rate_hz)
    export_session(even, path, format_of(path))
    records = [one for one in pyuff.UFF(str(path)).read_sets() if one["type"] == 58]
    assert [one["abscissa_spacing"] for one in records] == [1, 1]
    for one, signal in zip(records, (np.sin, np.cos), strict=True):
        assert_allclose(np.diff(one["x"]), 1.0 / rate_hz, rtol=1e-5)
        assert_allclose(one["data"], signal(20.0 * one["x"]), atol=1e-4)
    measured = session.runs[0].groups[0].time_s
    assert measured[0] <= records[0]["x"][0] < measured[0] + 1.0 / rate_hz
    assert measured[-1] - 1.0 / rate_hz < records[0]["x"][-1] <= measured[-1]
    found = exported_session(path)
    assert found is not None
    assert_array_equal(found.runs[0].groups[0].time_s, even.runs[0].groups[0].time_s)


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan"), float("inf"), 1e9])
def test_what_is_no_rate(session: Session, rate_hz: float) -> None:
    with pytest.raises(InputError, match="--rate"):
        with_even_times(session, rate_hz)
