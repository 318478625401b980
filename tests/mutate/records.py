"""Reads and writes what is known of the tests: build/mutate/, one file for a test file.

A record holds as long as the test file, the modules of `tests` that it loads, and the functions of
the sources that it runs are what they were.
"""

from __future__ import annotations

import json
import pickle
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha1
from pathlib import Path
from typing import Any

from .blocks import Blocks

FOLDER = Path("build", "mutate")
_FORM = b"2"
"""Of a record: one of another form does not hold."""


@dataclass(frozen=True, slots=True)
class RecordedTest:
    """One test that passed."""

    name: str
    """Node of pytest."""
    own_s: float
    """CPU time that it took, without what it shares with other tests."""
    blocks: frozenset[str]
    shared_s: Mapping[str, float]
    """CPU time of each thing that it shares with other tests, by name."""

    @property
    def alone_s(self) -> float:
        """CPU time that it takes alone."""
        return self.own_s + sum(self.shared_s.values())

    @property
    def file(self) -> str:
        """The file in which it is."""
        return self.name.split("::")[0]


def blocks_of(root: Path, source: Path, paths: Iterable[str]) -> list[Blocks]:
    """Return the blocks of some files, kept until they or `Blocks` change."""
    kept_in = root / FOLDER / "blocks.pickle"
    maker = Path(sys.modules[Blocks.__module__].__file__ or "").read_bytes()
    kept = pickle.loads(kept_in.read_bytes()) if kept_in.is_file() else {}
    now: dict[str, tuple[bytes, Blocks]] = {}
    for path in paths:
        text = (source / path).read_bytes()
        state = sha1(maker + text).digest()
        before = kept.get(path)
        now[path] = before if before and before[0] == state else (state, Blocks(path, text))
    kept_in.parent.mkdir(parents=True, exist_ok=True)
    kept_in.write_bytes(pickle.dumps(now))
    return [blocks for _, blocks in now.values()]


class Records:
    """The recorded tests of a tree."""

    def __init__(self, root: Path, source: Path, functions: Mapping[str, str]) -> None:
        self._folder = root / FOLDER
        self._source = source
        self._functions = functions
        self._known: dict[str, tuple[RecordedTest, ...]] = {}
        self.imported: set[str] = set()
        """Blocks that run when a test file is imported."""

    def tests(self, file: str) -> tuple[RecordedTest, ...]:
        """Return the tests of a file that is known."""
        return self._known[file]

    def knows(self, file: str) -> bool:
        """Return whether there is a record of a test file that still holds."""
        if file not in self._known and self._path(file).is_file():
            record = json.loads(self._path(file).read_text("utf-8"))
            if record["state"] == self._state(record["modules"], record["functions"]):
                self._keep(file, record)
        return file in self._known

    def keep(self, file: str, found: Mapping[str, Any]) -> None:
        """Keep what a recording has found, here and on disk."""
        keys = sorted({key for _, keys, _ in found["tests"].values() for key in keys})
        number = {key: n for n, key in enumerate(keys)}
        functions = sorted({key.rpartition(":")[0] for key in keys})
        record = {
            "state": self._state(found["modules"], functions),
            "modules": found["modules"],
            "functions": functions,
            "blocks": keys,
            "imported": found["imported"],
            "tests": {
                name: [own_s, [number[key] for key in used], shared_s]
                for name, (own_s, used, shared_s) in found["tests"].items()
            },
        }
        self._folder.mkdir(parents=True, exist_ok=True)
        self._path(file).write_text(json.dumps(record), "utf-8")
        self._keep(file, record)

    def _keep(self, file: str, record: Mapping[str, Any]) -> None:
        keys = record["blocks"]
        self.imported.update(record.get("imported", ()))
        self._known[file] = tuple(
            RecordedTest(name, own_s, frozenset(keys[n] for n in used), shared_s)
            for name, (own_s, used, shared_s) in record["tests"].items()
        )

    def _path(self, file: str) -> Path:
        return self._folder / f"{file.replace('/', '.')}.json"

    def _state(self, modules: list[str], functions: list[str]) -> str:
        digest = sha1(_FORM + sys.version.encode())
        for name in modules:
            path = self._source / name
            digest.update(path.read_bytes() if path.is_file() else b"-")
        for name in functions:
            digest.update(self._functions.get(name, "-").encode())
        return digest.hexdigest()
