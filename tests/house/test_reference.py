"""`make docs`: the reference builds without a warning, and has every public name."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import daq
import dbc
import identify

ROOT = Path(__file__).parents[2]
FACES = {"dbc": dbc, "daq": daq, "identify": identify}
NAMES = [(face, name) for face, module in FACES.items() for name in module.__all__]
PLAIN = {"ADDED", "BASELINE", "FORD_GRANADA", "UNUSABLE"}
"""Values: their type has the docstring."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("reference")
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--quiet"]
    done = subprocess.run(
        [*command, str(ROOT / "docs" / "reference"), str(target)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return target


@pytest.mark.long
def test_every_public_name_is_in_the_reference(pages: Path) -> None:
    text = "".join((pages / f"{face}.html").read_text("utf-8") for face in FACES)
    shown = set(re.findall(r'<dt class="sig sig-object py" id="([\w.]+)"', text))
    written = {name.rsplit(".", maxsplit=1)[-1] for name in shown}
    assert not {name for _, name in NAMES} - written - PLAIN
    assert "identify.Estimate.std" in shown  # fields, too


@pytest.mark.long
def test_the_pages_load_nothing_from_elsewhere(pages: Path) -> None:
    for page in pages.rglob("*.html"):
        assert not re.findall(r'(?:src|<link[^>]* href)="(?:https?:)?//', page.read_text("utf-8"))


@pytest.mark.parametrize(("face", "name"), NAMES)
def test_every_public_name_says_what_it_is(face: str, name: str) -> None:
    if name not in PLAIN:
        first = (getattr(FACES[face], name).__doc__ or "").strip().split("\n")[0]
        assert len(first) > 15
        assert not first.startswith(f"{name}(")  # what `dataclass` writes by itself
