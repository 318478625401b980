"""Draw small faults in the sources (cosmic-ray) and list those that no test of their room finds.

``python -m tests.house.mutate --count 200 --seed 1 [FILE ...]``: exit code 1 below 85 % killed.
"""

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

import attrs
from cosmic_ray.commands import init
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, WorkResult

ROOT = Path(__file__).parents[2]
PACKAGES = ("dbc", "daq", "identify", "tui")
KILLED_AT_LEAST = 0.85
TIMEOUT_S = 600.0
WITHOUT_MEANING = ("BitOr", "RemoveDecorator")
"""Operators left out: `|` is mostly a union of types; a class without its decorator fails."""


def draw(sources: list[Path], count: int, seed: int) -> list[MutationSpec]:
    """Return `count` mutations: a file drawn by its lines, then one mutation of the file."""
    rng = random.Random(seed)
    lines = [len(path.read_text("utf-8").splitlines()) for path in sources]
    drawn: list[MutationSpec] = []
    while len(drawn) < count:
        path = rng.choices(sources, lines)[0]
        with use_db(":memory:", WorkDB.Mode.create) as database:
            init([path], database, {})
            offered = [
                mutation
                for item in database.work_items
                for mutation in item.mutations
                if not any(name in mutation.operator_name for name in WITHOUT_MEANING)
            ]
        if offered:
            drawn.append(rng.choice(sorted(offered, key=lambda m: (m.operator_name, m.occurrence))))
    return drawn


def tests_of(source: Path) -> list[str]:
    """Return the tests that judge a source file: those of its room, then those of the commands."""
    package, *rooms = source.parent.parts
    places = [Path("tests", package, *rooms[:depth]) for depth in range(len(rooms), -1, -1)]
    named = Path("tests", package, *rooms, f"test_{source.stem}.py")
    existing = [str(place) for place in (named, *places) if (ROOT / place).exists()]
    return [*existing[:2], "tests/flow"]


def judge(mutation: MutationSpec, copy: Path) -> WorkResult:
    """Return what the tests say of one mutation, made in a copy of the tree."""
    source = mutation.module_path.relative_to(ROOT)
    command = f"env PYTHONPATH={copy} {sys.executable} -m pytest -q -x -p no:cacheprovider"
    tests = [str(copy / place) for place in tests_of(source)]
    moved = attrs.evolve(mutation, module_path=copy / source)
    return mutate_and_test([moved], " ".join([command, *tests]), TIMEOUT_S)


def main() -> int:
    """Judge the drawn mutations side by side, print the survivors, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("files", type=Path, nargs="*")
    options = parser.parse_args()
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    files = [ROOT / name for name in tracked.stdout.splitlines()]
    sources = [ROOT / name for name in options.files] or [
        path
        for path in files
        if path.suffix == ".py" and path.relative_to(ROOT).parts[0] in PACKAGES
    ]
    mutations = draw(sources, options.count, options.seed)
    survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        for number in range(options.jobs):
            for path in files:
                target = Path(folder, str(number), path.relative_to(ROOT))
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, target)
            copies.put(Path(folder, str(number)))

        def run(mutation: MutationSpec) -> WorkResult:
            copy = copies.get()
            try:
                return judge(mutation, copy)
            finally:
                copies.put(copy)

        with ThreadPoolExecutor(options.jobs) as pool:
            for number, result in enumerate(pool.map(run, mutations), 1):
                survivors += not result.is_killed
                print(f"{number} {'killed' if result.is_killed else 'SURVIVED'}", flush=True)
                if not result.is_killed:
                    print(result.diff or result.output, flush=True)
    share = 1.0 - survivors / len(mutations)
    print(f"{len(mutations) - survivors} of {len(mutations)} killed ({100.0 * share:.1f} %)")
    return 0 if share >= KILLED_AT_LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
