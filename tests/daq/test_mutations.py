"""Every format reads its whole file, and refuses or reads damaged ones in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from .mutations import _END, attempt, mutants, seeds, session


@pytest.mark.filterwarnings("ignore")
def test_whole_and_damaged_files_of_every_format(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for name, (raw, reader) in seeds(tmp_path).items():
        path.write_bytes(raw)
        if reader is not session:
            assert attempt(reader, path).startswith("read"), name
        for damaged in [raw[: len(raw) // 2], *mutants(raw, 8, 1, _END * (reader is session))]:
            path.write_bytes(damaged)
            assert attempt(reader, path) in ("read", "read with losses", "refused"), name
