"""What the packages offer by name, and what they load for it."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import pytest


@pytest.mark.parametrize("face", ["dbc", "daq", "identify"])
def test_every_public_name_is_there(face: str) -> None:
    module = import_module(face)
    for name in module.__all__:
        assert getattr(module, name) is not None


def test_the_recorder_does_not_load_the_library_of_session_files() -> None:
    code = "import sys, daq.recorder.recorder; assert 'h5py' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
