"""The shipped notebook runs, and shows what it promises."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest

from tui.cli import run


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
    assert kinds.count("image/png") == 5
    assert kinds.count("text/html") == 2  # identification, modes
    said = "".join(output.get("text", "") for output in outputs)
    assert "sprung mass 13" in said  # the paper's 1380 kg, to a few
    assert not [output for output in outputs if output.get("name") == "stderr"]
