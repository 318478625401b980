"""What `daq` offers by name, and what it loads for it."""

from __future__ import annotations

import subprocess
import sys

import pytest

import daq


@pytest.mark.parametrize("name", daq.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(daq, name) is not None
    assert name in dir(daq)


def test_a_name_that_is_not_there_is_refused() -> None:
    assert not hasattr(daq, "nothing")


def test_no_session_library_is_loaded_before_a_session_is_asked_for() -> None:
    code = (
        "import sys, daq, daq.control.messages; assert 'h5py' not in sys.modules; "
        "daq.read_session; assert 'h5py' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
