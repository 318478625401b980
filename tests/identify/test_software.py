"""The hash of the software: names and contents of its modules, and nothing else."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

from identify.document import hash_of, software_sha256


def test_it_is_over_names_sizes_and_contents_in_order(tmp_path: Path) -> None:
    for name, text in (("b.py", "y"), ("a.py", "x = 1"), ("c.pyc", "compiled"), ("in/d.toml", "")):
        (tmp_path / "p" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "p" / name).write_text(text)
    whole = b"p/a.py\x005\x00x = 1" + b"p/b.py\x001\x00y" + b"p/in/d.toml\x000\x00"
    assert hash_of([tmp_path / "p"]) == sha256(whole).hexdigest()


def test_an_edit_in_place_shows(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("LIMIT = 1.5")
    before = hash_of([tmp_path])
    (tmp_path / "a.py").write_text("LIMIT = 1.6")
    assert hash_of([tmp_path]) != before
    assert len(software_sha256()) == 64
