"""Tries mutants on private trees, as many at a time as there are trees."""

from __future__ import annotations

import shutil
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from time import sleep

from .mutant import Mutant
from .private_tree import PrivateTree, snapshot
from .room_tests import room_tests
from .trial import PASSED, Report, Trial, load

PATIENCE = 4.0
"""A run is stopped, and its mutant counted as killed, after this many times what its files took in
runs before; two runs share the machine, and a loop without end never ends."""
LEAST_S = 30.0
"""Seconds before which no run is stopped."""
UNKNOWN_S = 30.0
"""Seconds that a file may take of which no run is known."""
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
    """A mutant to try, or one test file to run without any."""

    mutant: Mutant | None = None
    file: str = ""


@dataclass(frozen=True, slots=True)
class Done:
    """A job that has ended."""

    job: Job
    report: Report | None
    """None if the run was stopped at its limit."""
    seconds: float
    output: str


class Campaign:
    """Private trees side by side, and what is known of the tests."""

    def __init__(self, root: Path, trees: int, show: Callable[[str], None]) -> None:
        self._show = show
        self._folder = Path(mkdtemp(prefix="mutate"))
        self.source = snapshot(root, self._folder / "source")
        self._trees = [PrivateTree(self.source, self._folder / str(n)) for n in range(trees)]
        self._seconds: dict[str, float] = {}
        self._sound: set[str] = set()
        self._broken: set[str] = set()
        self._jobs: deque[Job] = deque()

    def close(self) -> None:
        """Remove the private trees."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def outcomes(self, mutants: Sequence[Mutant]) -> Iterator[Outcome]:
        """Yield what becomes of each mutant, in the order in which they end.

        A file that fails with a mutant is run once without: only then the mutant is killed.  One
        that fails twice without is left out from then on.
        """
        failed_once: set[str] = set()
        unsure: defaultdict[str, list[Outcome]] = defaultdict(list)
        self._jobs = deque(Job(mutant) for mutant in mutants)
        for done in self._run():
            if done.report:
                self._learn(done.report)
            mutant = done.job.mutant
            if mutant is None:
                file = done.job.file
                again = [outcome.mutant for outcome in unsure[file]]
                if done.report and done.report.code in PASSED:
                    self._sound.add(file)
                    if file in failed_once:  # by chance, so perhaps by chance with a mutant, too
                        self._jobs.extend(map(Job, again))
                    else:
                        yield from unsure[file]
                elif file not in failed_once:
                    failed_once.add(file)
                    self._jobs.appendleft(Job(file=file))
                    continue
                else:
                    self._broken.add(file)
                    self._show(f"left out, it fails without a mutant: {file}\n{done.output}")
                    self._jobs.extend(map(Job, again))
                del unsure[file]
            elif done.report and done.report.code in PASSED:
                yield Outcome(mutant, False, False, done.seconds)
            elif done.report and done.report.failed not in self._sound:
                if done.report.failed not in unsure:
                    self._jobs.appendleft(Job(file=done.report.failed))
                unsure[done.report.failed].append(Outcome(mutant, True, False, done.seconds))
            else:
                yield Outcome(mutant, True, done.report is None, done.seconds)

    def _learn(self, report: Report) -> None:
        load(report.modules)
        for file, seconds in report.seconds.items():
            if file != report.failed:
                self._seconds[file] = seconds

    def _files(self, mutant: Mutant) -> tuple[str, ...]:
        """Return the test files of a mutant, the quickest first, those of its module before all."""
        tests = room_tests(self.source, mutant)
        return tuple(
            file
            for group in (tests.direct, tests.others)
            for file in sorted(group, key=lambda file: (self._seconds.get(file, 0.0), file))
            if file not in self._broken
        )

    def _run(self) -> Iterator[Done]:
        """Yield the jobs as they end; jobs may be added meanwhile."""
        free, running = list(self._trees), list[tuple[Job, Trial]]()
        try:
            while self._jobs or running:
                while free and self._jobs:
                    job = self._jobs.popleft()
                    files = self._files(job.mutant) if job.mutant else (job.file,)
                    if not files:
                        report = Report(PASSED[1], "", {}, ())
                        yield Done(job, report, 0.0, "no test file is left")
                        continue
                    running.append((job, self._start(free.pop(), job, files)))
                for job, trial in list(running):
                    done = self._ended(job, trial)
                    if done:
                        running.remove((job, trial))
                        free.append(trial.tree)
                        yield done
                sleep(POLL_S)
        finally:
            for _, trial in running:
                trial.stop()

    def _start(self, tree: PrivateTree, job: Job, files: tuple[str, ...]) -> Trial:
        if job.mutant:
            tree.apply(job.mutant)
        return Trial.start(tree, files)

    def _ended(self, job: Job, trial: Trial) -> Done | None:
        ended = trial.ended()
        if not ended:
            known = sum(self._seconds.get(file, UNKNOWN_S) for file in trial.files)
            if trial.seconds < LEAST_S + PATIENCE * known:
                return None
            trial.stop()
        trial.tree.restore()
        report = trial.report() if ended else None
        return Done(job, report, trial.seconds, trial.output())
