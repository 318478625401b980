"""The demo as its users run it, and what can be done with what it leaves behind."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import daq
from daq.journal.folder import recordings
from daq.journal.reader import read_journal
from tui.cli import run


def _json(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert run([*arguments, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert isinstance(document, dict)
    return document


def test_demo(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "demo"
    result = _json(capsys, "demo", "--seed", "11", "--out", str(out))
    assert result["verdict"] == "ok", result["reasons"]
    assert 0.9 < result["chi2_per_n"] < 1.1
    assert len(result["parameters"]) == 15
    for name, estimate in result["parameters"].items():
        assert abs(estimate["value"] / result["truth"][name] - 1) < 0.02
        assert estimate["low"] < estimate["value"] < estimate["high"]
        assert estimate["std"] > 0
        assert estimate["unit"]
    # docs/method.md, "The vehicle": of the car without and with the shipped weights.
    frequencies = [mode["frequency_hz"] for mode in result["modes"]["baseline"]]
    expected = [1.0511, 1.3078, 1.6516, 10.7678, 10.7712, 11.2859, 11.2881]
    np.testing.assert_allclose(frequencies, expected, rtol=0.005)
    assert len(result["modes"]["added"]) == 7

    session = Path(result["session"])
    again = _json(capsys, "identify", str(session))
    assert again == {key: result[key] for key in again}  # digit for digit

    runs = _json(capsys, "inspect", str(session))["runs"]
    assert len(runs) == 12
    assert all(not any(run["losses"].values()) for run in runs)

    # Every frame that the car sent is in the journal, and those of a run are in the session.
    campaign, *_ = recordings(out / "journal")  # what follows it is on the bus afterwards
    journal = read_journal(campaign.segments)
    assert not journal.lost.any
    first = daq.read_session(session).runs[0].frames
    start = int(np.searchsorted(journal.frames.t_ns, first.t_ns[0]))
    same = journal.frames.select(slice(start, start + len(first)))
    np.testing.assert_array_equal(same.data, first.data)


def test_a_session_without_its_added_mass_is_refused_with_the_reason(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(600) / 200.0
    records = {name: (t, rng.standard_normal(600)) for name in ("z_s", "theta", "phi")}
    session = daq.session_from_arrays([("baseline", "bounce", records)])
    path = tmp_path / "half.h5"
    daq.write_session(path, session)
    assert run(["identify", str(path), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["verdict"] == "refused"
    assert "added mass" in document["reasons"][0]
    assert document["parameters"] == {}
    assert document["chi2_per_n"] is None
