"""Lets python-can write and read MF4, the peer of our own files, whatever was loaded before."""

import importlib

import can
import pytest


@pytest.fixture(scope="session", autouse=True)
def python_can_knows_mf4() -> None:
    """Load its module of MF4 again, with asammdf: `daq.python_can` loads it without."""
    importlib.reload(can.io.mf4)
