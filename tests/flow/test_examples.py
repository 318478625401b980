"""The examples in docs/examples run, and what they print is right."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from daq.bench.config import bench_codec, default_bench_text, load_bench
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
TRIED = {"log_to_parameters.py", "modes_of_a_structure.py", "own_sensor.py", "recording.py"}


def printed(name: str, *arguments: Path) -> str:
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def candump(path: Path, frames: FrameBatch) -> Path:
    rows = zip(
        frames.t_ns.tolist(), frames.can_id.tolist(), frames.length, frames.data, strict=True
    )
    with path.open("w") as file:
        for t, can_id, length, data in rows:
            payload = data[:length].tobytes().hex().upper()
            file.write(f"({t // 10**9}.{t % 10**9 // 1000:06d}) can0 {can_id:03X}#{payload}\n")
    return path


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
    log = candump(tmp_path / "car.log", FrameBatch.concatenate(list(frames)))
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
