"""A guest reports what it needs of this machine before it boots."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from . import machine


@pytest.mark.parametrize(
    ("above", "own", "closed"),
    [
        (0o755, 0o755, None),
        (0o711, 0o755, None),
        (0o700, 0o755, "/home/me"),
        (0o750, 0o755, "/home/me"),
        (0o755, 0o751, "/home/me/checkout"),
        (0o755, 0o754, "/home/me/checkout"),
    ],
)
def test_a_folder_that_other_users_cannot_enter_is_found(
    monkeypatch: pytest.MonkeyPatch, above: int, own: int, closed: str | None
) -> None:
    modes = {"/home/me": above, "/home/me/checkout": own}

    def stat(path: Path) -> SimpleNamespace:
        return SimpleNamespace(st_mode=0o040000 | modes.get(str(path), 0o755))

    monkeypatch.setattr(Path, "stat", stat)
    found = machine.closed_to_others([Path("/usr"), Path("/home/me/checkout")])
    assert found == (None if closed is None else Path(closed))


def test_it_is_one_line_and_nothing_is_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(machine, "ROOT", Path("/checkout"))
    monkeypatch.setattr(shutil, "which", lambda _: "/nowhere/qemu")
    (closed := tmp_path / "closed").mkdir(mode=0o700)
    assert machine.run_guest("service", "", (), (), 1.0, {}, (closed,)) == 2
    out = capsys.readouterr().out
    assert out.startswith("Bail out! other users cannot enter ")
    assert out.count("\n") == 1
