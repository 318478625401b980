"""What packages and rooms offer by name, and what they load for it."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FACES = [
    ".".join(path.relative_to(ROOT).parent.parts)
    for package in ("daq", "identify")
    for path in sorted((ROOT / package).rglob("__init__.py"))
    if "lazy(__name__)" in path.read_text("utf-8")
]


@pytest.mark.parametrize("face", FACES)
def test_every_public_name_is_there(face: str) -> None:
    module = import_module(face)
    for name in module.__all__:
        assert getattr(module, name) is not None
        assert name in dir(module)


def test_the_packages_themselves_are_faces() -> None:
    assert {"daq", "identify"} < set(FACES)


def test_a_name_that_is_not_there_is_refused() -> None:
    module = import_module("daq.bus")
    assert module.__all__ == ["FrameSource", "open_bus", "open_buses"]
    with pytest.raises(AttributeError, match=r"module 'daq.bus' has no attribute 'open_buss'"):
        assert module.open_buss


def test_a_name_replaced_in_its_file_is_replaced_in_the_face(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = import_module("daq.bus")
    monkeypatch.setattr("daq.bus.interfaces.open_bus", len)
    assert module.open_bus is len


def test_the_recorder_does_not_load_the_library_of_session_files() -> None:
    code = (
        "import sys, daq, daq.recorder.recorder; assert 'h5py' not in sys.modules; "
        "daq.read_session; assert 'h5py' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_file_is_loaded_when_its_name_is_asked_for() -> None:
    code = (
        "import sys, daq.bus; daq.bus.FrameSource; "
        "assert 'daq.bus.source' in sys.modules; assert 'daq.bus.interfaces' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
