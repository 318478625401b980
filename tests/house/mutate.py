"""Draw small faults in the sources (cosmic-ray) and list those that no test finds.

``python -m tests.house.mutate --count 200 --seed 1 [FILE ...]``: exit code 1 below 85 % killed.
"""

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from queue import SimpleQueue

import attrs
from cosmic_ray.commands import init
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, WorkResult
from coverage import CoverageData

ROOT = Path(__file__).parents[2]
PACKAGES = ("dbc", "daq", "identify", "tui")
KILLED_AT_LEAST = 0.85
TIMEOUT_S = 600.0
WITHOUT_MEANING = ("BitOr", "RemoveDecorator")
"""Operators left out: `|` is mostly a union of types; a class without its decorator fails."""


@cache
def mutations_of(path: Path) -> list[MutationSpec]:
    """Return all mutations of a file, in a fixed order."""
    with use_db(":memory:", WorkDB.Mode.create) as database:
        init([path], database, {})
        offered = [mutation for item in database.work_items for mutation in item.mutations]
    kept = [m for m in offered if not any(name in m.operator_name for name in WITHOUT_MEANING)]
    return sorted(kept, key=lambda m: (m.operator_name, m.occurrence))


def draw(sources: list[Path], count: int, seed: int) -> list[MutationSpec]:
    """Return `count` mutations: a file drawn by its lines, then one mutation of the file."""
    rng = random.Random(seed)
    lines = [len(path.read_text("utf-8").splitlines()) for path in sources]
    drawn: list[MutationSpec] = []
    while len(drawn) < count:
        if offered := mutations_of(rng.choices(sources, lines)[0]):
            drawn.append(rng.choice(offered))
    return drawn


def passing_tests(data: Path) -> CoverageData:
    """Run all tests once, and return which of them pass through which line of the sources."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "auto"]
    measured = [f"--cov={package}" for package in PACKAGES]
    subprocess.run(
        [*command, *measured, "--cov-context=test", "--cov-report="],
        cwd=ROOT,
        env=os.environ | {"COVERAGE_FILE": str(data)},
        check=False,  # a test that the tracing slows too much is named by pytest
    )
    coverage = CoverageData(data)
    coverage.read()
    return coverage


def tests_of(source: Path, line: int, coverage: CoverageData) -> list[str]:
    """Return the tests that judge a line, those of its room first.

    They are those that pass through it, or through the last traced line above it; of a line that
    runs at the import those of its file, of a file of compiled functions those of its room.
    """
    room = str(Path("tests", *source.parent.parts))
    traced = coverage.contexts_by_lineno(str(ROOT / source))
    above = max((number for number in traced if number <= line), default=line)
    passing = set(traced.get(above, ())) - {""} or set().union(*traced.values()) - {""}
    # What a fixture passes through serves all tests of its file; the values of a test are left out.
    tests = {re.split(r"[\[|]" if name.endswith("|run") else "::", name)[0] for name in passing}
    return sorted(tests, key=lambda test: (not test.startswith(room), test)) or [room]


def judge(mutation: MutationSpec, copy: Path, coverage: CoverageData) -> WorkResult:
    """Return what the tests say of one mutation, made in a copy of the tree."""
    source = mutation.module_path.relative_to(ROOT)
    command = f"env PYTHONPATH={copy} {sys.executable} -m pytest -q -x -p no:cacheprovider"
    tests = [str(copy / test) for test in tests_of(source, mutation.start_pos[0], coverage)]
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
        coverage = passing_tests(Path(folder, "coverage"))
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
                return judge(mutation, copy, coverage)
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
