"""What sources, tests and pages cite is in the repository: pages, their sections, files."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted(ROOT.glob("docs/**/*.md"))]
CODE = sorted(
    path
    for room in ("dbc", "daq", "identify", "tui", "tests")
    for path in ROOT.glob(f"{room}/**/*.py")
)
PAGE = re.compile(r"docs/[a-z_/-]+\.md")
SECTION = re.compile(r'(docs/[a-z_/-]+\.md),\s+"([^"\n]+(?:\n[^"\n]+)?)"')
LINK = re.compile(r"\]\(([^)\s]+)\)")
NAMED_FILE = re.compile(r"`((?:dbc|daq|identify|tui|tests|docs)/[\w./-]*)`")


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _headings(page: Path) -> list[str]:
    return re.findall(r"^#+ (.+)$", page.read_text("utf-8"), re.MULTILINE)


def _anchor(heading: str) -> str:
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


def _wrong_in_code(text: str) -> Iterator[str]:
    yield from (page for page in PAGE.findall(text) if not (ROOT / page).is_file())
    for page, section in SECTION.findall(text):
        # A citation that goes on in the next line of a comment or docstring is one all the same.
        title = re.sub(r"\s*\n\s*#?\s*", " ", section)
        if (ROOT / page).is_file() and title not in _headings(ROOT / page):
            yield f'{page}, "{title}"'


def _wrong_in_page(page: Path) -> Iterator[str]:
    text = page.read_text("utf-8")
    for target in LINK.findall(text):
        where, _, anchor = target.partition("#")
        if ":" in where:
            continue
        linked = (page.parent / where).resolve() if where else page
        found = linked.exists() and (not anchor or anchor in map(_anchor, _headings(linked)))
        if not found:
            yield target
    yield from (name for name in NAMED_FILE.findall(text) if not (ROOT / name).exists())


@pytest.mark.parametrize("path", PAGES, ids=_name)
def test_what_a_page_names_exists(path: Path) -> None:
    assert not list(_wrong_in_page(path))


def _steps(page: Path) -> Iterator[Path]:
    """Yield the files and folders of the repository to which a page leads."""
    text = page.read_text("utf-8")
    for target in LINK.findall(text):
        if ":" not in target:
            yield (page.parent / target.partition("#")[0]).resolve()
    yield from (ROOT / name for name in NAMED_FILE.findall(text))


def _unreachable(start: Path, wanted: set[Path]) -> set[Path]:
    """Return the files to which no chain of links leads, by pages and folders."""
    seen: set[Path] = set()
    ahead = [start.resolve()]
    while ahead:
        here = ahead.pop()
        if here not in seen:
            seen.add(here)
            if here.suffix == ".md":
                ahead += _steps(here)
            elif here.is_dir():
                ahead += here.glob("*.md")
    return {path for path in wanted if not seen & {path, *path.parents}}


def test_every_page_and_example_is_reached_from_the_readme() -> None:
    wanted = {path for path in ROOT.glob("docs/**/*") if path.is_file()}
    wanted = {path for path in wanted if "__pycache__" not in path.parts}
    assert len(wanted) > 20
    assert not {_name(path) for path in _unreachable(ROOT / "README.md", wanted)}


def test_a_page_without_a_link_is_seen(tmp_path: Path) -> None:
    for name in ("README.md", "a.md", "b.md", "lost.md"):
        (tmp_path / name).write_text("")
    (tmp_path / "README.md").write_text("[a](a.md) and [away](https://example.org)")
    (tmp_path / "a.md").write_text("[b](b.md#part)")
    found = _unreachable(tmp_path / "README.md", set(tmp_path.glob("*.md")))
    assert {path.name for path in found} == {"lost.md"}


def test_what_the_code_cites_exists() -> None:
    wrong = {_name(path): list(_wrong_in_code(path.read_text("utf-8"))) for path in CODE}
    assert not {name: cited for name, cited in wrong.items() if cited}


def test_a_citation_that_leads_nowhere_is_seen() -> None:
    page, missing = "docs" + "/method.md", "docs" + "/methods.md"
    assert not list(_wrong_in_code(f'{page}, "Noise\n    and the bound"'))
    assert list(_wrong_in_code(f'{page}, "Noise\n# and bound"')) == [f'{page}, "Noise and bound"']
    assert list(_wrong_in_code(missing)) == [missing]
