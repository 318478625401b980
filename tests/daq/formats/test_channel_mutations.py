"""The campaign of damaged files begins with whole ones, each of which is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from .channel_files import WRITERS
from .channel_mutations import read, whole


@pytest.mark.filterwarnings("ignore")  # as the child does
@pytest.mark.parametrize("suffix", WRITERS)
def test_a_whole_file_is_read(tmp_path: Path, suffix: str) -> None:
    path = whole(suffix, tmp_path)
    assert read(path) == "read"
    path.write_bytes(path.read_bytes()[:-200])
    assert read(path) in ("read", "refused")
