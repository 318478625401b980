"""The Python interface as the README shows it, in a fresh interpreter."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from daq import write_session
from dbc import shipped_dbc
from tests.tui.batches import paper_session

_LINES = """
import daq, dbc, identify
session = daq.read_session("car.h5")
result = identify.identify(session)
e = result.parameters["m_s"]
assert e.low < e.value < e.high and 0 < e.std < 0.05 * e.value
assert list(result.parameters) == (
    "m_s I_yy I_xx m_uf m_ur k_sf k_sr k_tf k_tr c_sf c_sr a b t_f t_r".split()
)

import numpy as np
rate_hz = 100.0
after = [run.groups[0].time_s > 0.305 for run in session.runs]
records = [
    np.column_stack(list(run.groups[0].values.values()))[keep]
    for run, keep in zip(session.runs, after)
    if run.mass_state == "baseline"
]
modal = identify.identify_modes(records, rate_hz)
assert modal.shapes.shape == (7, len(modal.poles))
bounce = np.abs(modal.poles).min() / (2 * np.pi)
assert abs(bounce / 1.0511 - 1) < 0.05  # docs/method.md, "The vehicle"

model = identify.state_space(daq.FORD_GRANADA)
assert (model.M.shape, model.C.shape, model.K.shape, model.A.shape) == (*3 * [(7, 7)], (14, 14))
slowest = np.abs(np.linalg.eigvals(model.A)).min() / (2 * np.pi)
assert abs(slowest - 1.0511) < 1e-4

codec = dbc.load_codec("car.dbc")
layout = codec.message("HUB_Front")
values = {signal.name: np.zeros(1) for signal in layout.signals if "acc" in signal.name}
batch = dbc.FrameBatch(
    t_ns=np.array([0]), can_id=np.array([layout.can_id], np.uint32), flags=np.zeros(1, np.uint16),
    bus=np.zeros(1, np.uint8), length=np.array([layout.length], np.uint8),
    data=codec.encode("HUB_Front", values),
)
samples = codec.decode(batch)
assert all(name.startswith("HUB_Front.") for name in samples.samples)
import sys
assert not {"matplotlib", "textual", "typer"} & {name.split(".")[0] for name in sys.modules}
"""


def test_the_lines_of_the_design_work(tmp_path: Path) -> None:
    write_session(tmp_path / "car.h5", paper_session(1))
    (tmp_path / "car.dbc").write_text(shipped_dbc(), encoding="utf-8")
    subprocess.run([sys.executable, "-c", _LINES], cwd=tmp_path, check=True)
