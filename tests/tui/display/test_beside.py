"""A display beside a terminal: started with it, ended with it."""

from __future__ import annotations

import urllib.error
import urllib.request
from pathlib import Path

import pytest

from daq.errors import InputError
from tui.display.start import display_beside_recorder, display_beside_terminal


def test_it_is_served_until_the_terminal_ends(tmp_path: Path) -> None:
    with display_beside_terminal(tmp_path, "here", "MK", control=True) as display:
        assert display is not None
        assert display.code == (), "this machine's browsers need no camera"
        link = display.lines[0].removeprefix("display: open ")
        assert display.lines[1].startswith("control: type ")
        with urllib.request.urlopen(link) as answer:
            assert answer.status == 200
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(link)


def test_without_one_nothing_is_started(tmp_path: Path) -> None:
    with display_beside_terminal(tmp_path, None, "MK", control=False) as display:
        assert display is None
    with (
        pytest.raises(InputError, match="needs a display"),
        display_beside_recorder(tmp_path, None, control=True),
    ):
        pass
    with (
        pytest.raises(InputError, match="every address"),
        display_beside_recorder(tmp_path, "0.0.0.0", control=False),
    ):
        pass
