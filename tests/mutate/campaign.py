"""Tries mutants on private trees, as many at a time as there are trees."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from time import sleep

from .mutant import Mutant
from .private_tree import PrivateTree
from .room_tests import RoomTests, room_tests
from .trial import Trial, load

PATIENCE = 3.0
"""A run is given up, and its mutant counted as killed, after this many times what the tests of
the room take without a mutant; two runs share the machine, and a loop without end never ends."""
LEAST_S = 20.0
"""And never before this, in seconds: starting is not in the room's time."""
POLL_S = 0.02


@dataclass(frozen=True, slots=True)
class Outcome:
    """What the tests made of a mutant."""

    mutant: Mutant
    killed: bool
    timed_out: bool
    seconds: float


@dataclass(frozen=True, slots=True)
class Job:
    """A run to do: files, after a change of one source file if any."""

    files: tuple[str, ...]
    limit_s: float
    path: str = ""
    source: bytes = b""


@dataclass(frozen=True, slots=True)
class Done:
    """A run that has ended."""

    job: Job
    code: int | None
    """Exit code of pytest; None if it was stopped at its limit."""
    seconds: float
    output: str
    file_seconds: dict[str, float]
    modules: list[str]


class Campaign:
    """Private trees side by side, and what is known of the tests."""

    def __init__(self, root: Path, trees: int) -> None:
        self._root = root
        self._folder = Path(mkdtemp(prefix="mutate"))
        self._trees = [PrivateTree(root, self._folder / str(n)) for n in range(trees)]
        self._seconds: dict[str, float] = {}

    def close(self) -> None:
        """Remove the private trees."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def measure(self, mutants: Sequence[Mutant], show: Callable[[str], None]) -> None:
        """Run the tests of all rooms as they are; leave out files that fail without a mutant."""
        files = sorted({file for m in mutants for file in room_tests(self._root, m).all})
        show(f"{len(files)} test files without a mutant ..")
        for last in (False, True):
            jobs = [Job((file,), float("inf")) for file in files]
            files = []
            for done in self._run(jobs):
                (file,) = done.job.files
                if done.code in {0, 5}:
                    self._seconds[file] = sum(done.file_seconds.values())
                    load(done.modules)
                elif last:
                    show(f"left out, it fails without a mutant: {file}\n{done.output}")
                else:
                    files.append(file)

    def outcomes(self, mutants: Iterable[Mutant]) -> Iterator[Outcome]:
        """Yield what becomes of each mutant, in the order in which they end."""
        jobs: dict[tuple[str, bytes], Mutant] = {}

        def work() -> Iterator[Job]:
            for mutant in mutants:
                source = mutant.applied((self._root / mutant.path).read_bytes())
                files = self._quickest_first(room_tests(self._root, mutant))
                limit_s = LEAST_S + PATIENCE * sum(self._seconds[file] for file in files)
                jobs[mutant.path, source] = mutant
                yield Job(files, limit_s, mutant.path, source)

        for done in self._run(work()):
            mutant = jobs.pop((done.job.path, done.job.source))
            yield Outcome(mutant, done.code not in {0, 5}, done.code is None, done.seconds)

    def _quickest_first(self, tests: RoomTests) -> tuple[str, ...]:
        return tuple(
            file
            for group in (tests.direct, tests.others)
            for file in sorted(set(group) & set(self._seconds), key=self._seconds.__getitem__)
        )

    def _run(self, jobs: Iterable[Job]) -> Iterator[Done]:
        waiting = iter(jobs)
        free, running = list(self._trees), list[tuple[Job, Trial]]()
        try:
            while True:
                while free and (job := next(waiting, None)) is not None:
                    running.append((job, self._start(free.pop(), job)))
                if not running:
                    return
                for job, trial in list(running):
                    done = self._ended(job, trial)
                    if done:
                        running.remove((job, trial))
                        free.append(trial.tree)
                        yield done
                sleep(POLL_S)
        finally:
            for job, trial in running:
                trial.stop()
                self._restore(job, trial.tree)

    def _start(self, tree: PrivateTree, job: Job) -> Trial:
        if job.path:
            tree.write(job.path, job.source)
        return Trial.start(tree, job.files)

    def _ended(self, job: Job, trial: Trial) -> Done | None:
        code = trial.ended()
        if code is None:
            if trial.seconds < job.limit_s:
                return None
            trial.stop()
        self._restore(job, trial.tree)
        seconds, modules = trial.measured() if code in {0, 5} else ({}, [])
        return Done(job, code, trial.seconds, trial.output(), seconds, modules)

    def _restore(self, job: Job, tree: PrivateTree) -> None:
        if job.path:
            tree.write(job.path, (self._root / job.path).read_bytes())
