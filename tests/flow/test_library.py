"""The Python interface as the README shows it, the shipped notebook, and docs/examples."""

from __future__ import annotations

import io
import re
import runpy
import subprocess
import sys
import warnings
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from daq import write_session
from daq.bench.config import bench_codec, default_bench_text, load_bench
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch, shipped_dbc
from tests.tui.batches import paper_session
from tests.tui.test_import import write_log
from tui.cli import run

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


def test_the_notebook_runs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import nbformat
    from nbclient import NotebookClient

    out = tmp_path / "example.ipynb"
    assert run(["notebook", "--out", str(out)]) == 0
    assert str(out) in capsys.readouterr().out
    assert run(["notebook", "--out", str(out)]) == 2  # never over somebody's work
    assert "exists" in capsys.readouterr().err

    read: Any = nbformat.read
    notebook = read(out, as_version=4)
    assert not [cell for cell in notebook.cells if cell.get("outputs")]  # shipped clean
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the client; the kernel has its own
        NotebookClient(
            notebook, timeout=60, resources={"metadata": {"path": str(tmp_path)}}
        ).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    kinds = [kind for output in outputs for kind in output.get("data", {})]
    assert kinds.count("image/png") == 4
    said = "".join(output.get("text", "") for output in outputs)
    assert "verdict: ok" in said
    assert "sprung mass 13" in said  # the paper's 1380 kg, to a few
    assert not [output for output in outputs if output.get("name") == "stderr"]


# docs/examples ------------------------------------------------------------------------------------

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
TRIED = {"log_to_parameters.py", "modes_of_a_structure.py", "own_sensor.py", "recording.py"}


def printed(name: str, *arguments: Path) -> str:
    """Run an example as a script in this process; return what it printed."""
    script = str(EXAMPLES / name)
    said = io.StringIO()
    with mock.patch.object(sys, "argv", [script, *map(str, arguments)]), redirect_stdout(said):
        runpy.run_path(script, run_name="__main__")
    return said.getvalue()


def short_bench(folder: Path, excitations: str) -> Path:
    text = re.sub(r"(?m)^excitations = .*$", f"excitations = {excitations}", default_bench_text())
    text = re.sub(r"(?m)^repeats = .*$", "repeats = 1", text)
    text = re.sub(r'(?m)^channel = "bumpbench"$', f'channel = "{folder.name}"', text)
    (folder / "bench.toml").write_text(text, "utf-8")
    return folder / "bench.toml"


def test_every_example_is_tried() -> None:
    assert {path.name for path in EXAMPLES.glob("*.py")} == TRIED


def test_a_log_to_parameters(tmp_path: Path) -> None:
    path = short_bench(tmp_path, '["bounce", "pitch", "roll"]')
    bench = load_bench(path)
    frames = campaign_frames(bench, bench_codec(bench), SimulatedCar(), 1, 1_700_000_000 * 10**9)
    log = write_log(tmp_path / "car.log", FrameBatch.concatenate(list(frames)))
    lines = printed("log_to_parameters.py", log, path).splitlines()
    assert lines[:6] == [
        f"{state}_{kind}_1 accepted"
        for state in ("baseline", "added")
        for kind in ("bounce", "pitch", "roll")
    ]
    assert lines[6] == "verdict: ok"
    (m_s,) = (line.split() for line in lines if line.startswith("m_s"))
    assert abs(float(m_s[1]) / 1380.0 - 1.0) < 0.02
    assert m_s[2] == "kg"


def test_modes_of_a_structure() -> None:
    _, *rows = printed("modes_of_a_structure.py").splitlines()
    for row in rows:
        found, damping, _, truth, true_damping, *_ = row.split()
        assert abs(float(found) / float(truth) - 1.0) < 1e-3
        assert abs(float(damping) / float(true_damping) - 1.0) < 0.02
    # A frame of three equal storeys: omega = 2 sqrt(k/m) sin((2 j - 1) pi / 14).
    assert [row.split()[3] for row in rows] == ["3.1676", "8.8755", "12.8255"]


def test_a_sensor_of_your_own() -> None:
    lines = printed("own_sensor.py").splitlines()
    assert lines[0] == "0.000 s  +0.0000 m"  # at rest
    assert lines[-1] == "0.050 s  +0.0300 m"  # 30 mm of compression count positive


def test_a_recording_in_ten_lines(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    lines = printed("recording.py", out, short_bench(tmp_path, '["bounce"]')).splitlines()
    assert lines == [
        str(out / "session_0001.h5"),
        "  2 runs",
        "  baseline_bounce_1",
        "  added_bounce_1",
    ]
    source = (EXAMPLES / "recording.py").read_text("utf-8")
    ten = source.partition("# Ten lines ...\n")[2].partition("    # ... and the end.")[0]
    assert len(ten.splitlines()) == 10
