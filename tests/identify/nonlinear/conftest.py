"""Fixtures of the nonlinear room."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from .scripted import play


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Return a function that searches for a car by a script (`scripted.play`)."""
    return partial(play, monkeypatch)
