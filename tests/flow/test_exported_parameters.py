"""A campaign exported, imported again and identified: the same 15 parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from daq.bench.config import load_bench
from daq.formats.description import sidecar_of
from daq.formats.export import export_session, format_of
from daq.formats.exported import exported_session
from daq.sessions import Session

from .coverage import simulated_session
from .decoded import parameters

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def session() -> Session:
    bench = load_bench(None)
    about = {"bench_toml": bench.text, "dbc": bench.dbc_text}
    return replace(simulated_session(bench, 1), provenance=about)


@pytest.fixture(scope="module")
def expected(session: Session) -> NDArray[np.float64]:
    return parameters(session)


@pytest.mark.parametrize(
    ("suffix", "rtol"),
    [
        (".blf", 0.0),
        (".mf4", 0.0),
        (".mat", 0.0),
        (".parquet", 0.0),
        (".csv", 0.0),
        (".uff", 0.0),
        # These two keep whole microseconds, so that the times of the samples move a little.
        (".asc", 1e-5),
        (".log", 1e-5),
    ],
)
def test_an_export_gives_the_same_parameters(
    tmp_path: Path, session: Session, expected: NDArray[np.float64], suffix: str, rtol: float
) -> None:
    path = tmp_path / f"car{suffix}"
    export_session(session, path, format_of(path))
    found = exported_session(sidecar_of(path) if suffix == ".csv" else path)
    assert found is not None
    assert len(expected) == 15
    assert_allclose(parameters(found), expected, rtol=rtol, atol=0.0)
