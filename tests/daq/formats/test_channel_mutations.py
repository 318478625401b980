"""The campaign of damaged files begins with whole ones, each of which is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from .channel_mutations import Case, cases, read, whole


@pytest.mark.filterwarnings("ignore")  # as the child does
@pytest.mark.parametrize("case", cases())
def test_a_whole_file_is_read(tmp_path: Path, case: Case) -> None:
    path = whole(case, tmp_path)
    assert read(case, path) == "read"
    path.write_bytes(path.read_bytes()[:-200])
    assert read(case, path) in ("read", "refused")
