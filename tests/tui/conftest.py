"""Commands and screens without a process for each file that they read."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _in_this_process(request: pytest.FixtureRequest) -> None:
    """Read session files and DBCs here."""
    request.getfixturevalue("without_children")
