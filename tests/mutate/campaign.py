"""Records the tests, and tries mutants on private trees, as many at a time as there are trees."""

from __future__ import annotations

import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from signal import SIGKILL, SIGXCPU
from tempfile import mkdtemp
from time import sleep
from typing import Any

from .choice import Choice, Chooser
from .mutant import Mutant
from .private_tree import PrivateTree, snapshot
from .reach import Reach
from .records import RecordedTest, Records, blocks_of
from .room_tests import room_tests, users_tests
from .served import Server, fits
from .sources import PACKAGES, sources
from .trial import PASSED, Chosen, Plugin, Trial, load

PATIENCE = 4.0
"""A process is ended, and its mutant counted as killed, after this many times the CPU time that its
tests took when they were recorded: a loop without end never ends."""
LEAST_CPU_S = 120.0
"""CPU time, s, before which no process is ended: all has to be loaded, and perhaps compiled."""
LONGEST_S = 900.0
"""Seconds after which the trial of a mutant is stopped, and the mutant counted as killed: a process
that waits for ever takes no CPU time."""
RECORD_S = 900.0
"""Seconds after which the recording of one test file is stopped, and the file left out."""
POLL_S = 0.02


@dataclass(frozen=True, slots=True)
class Outcome:
    """States whether a mutant was killed, and by which test."""

    mutant: Mutant
    killed: bool
    by: str
    """The test that failed; `timeout`, or how many tests passed."""
    seconds: float


@dataclass(frozen=True, slots=True)
class Job:
    """A mutant to try, or a test file to record."""

    files: tuple[str, ...]
    plugin: Callable[[], Plugin]
    limit_s: float
    cpu_s: float = 0.0
    """Limit of its CPU time; 0 for none."""
    mutant: Mutant | None = None
    served_by: tuple[str, ...] = ()
    """The test files that a process has to collect to take the mutant as it is, if any can."""


@dataclass(frozen=True, slots=True)
class Done:
    """A job that has ended."""

    job: Job
    code: int | None
    """Exit code; None if the run was stopped at its limit."""
    found: dict[str, Any]
    seconds: float
    output: str


class Campaign:
    """Private trees side by side, and what is known of the tests."""

    def __init__(self, root: Path, trees: int, show: Callable[[str], None]) -> None:
        self._show = show
        self._folder = Path(mkdtemp(prefix="mutate"))
        self.source = snapshot(root, self._folder / "source")
        self._blocks = blocks_of(root, self.source, sources(self.source, [*PACKAGES]))
        functions = {key: text for file in self._blocks for key, text in file.functions.items()}
        self._records = Records(root, self.source, functions)
        self._names = [str(n) for n in range(trees)]

    def close(self) -> None:
        """Remove the private trees."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def outcomes(self, mutants: Sequence[Mutant]) -> Iterator[Outcome]:
        """Yield what becomes of each mutant, in the order in which they end."""
        files = {mutant: room_tests(self.source, mutant.path) for mutant in mutants}
        self._record(sorted({file for of_one in files.values() for file in of_one}))
        chooser = Chooser(self.source, self._blocks)
        choices = {mutant: chooser.choice(mutant, self._tests(files[mutant])) for mutant in mutants}
        unrun = [mutant for mutant in mutants if not choices[mutant].tests]
        if unrun:
            every = users_tests(self.source)
            self._record(every)
            files |= dict.fromkeys(unrun, every)
            choices |= {mutant: chooser.choice(mutant, self._tests(every)) for mutant in unrun}
        jobs = []
        for mutant in mutants:
            choice = choices[mutant]
            if not choice.tests:
                yield Outcome(mutant, False, "no test runs it", 0.0)
                continue
            plugin = partial(Chosen, tuple(test.name for test in choice.tests))
            cpu_s = LEAST_CPU_S + PATIENCE * choice.seconds
            source = (self.source / mutant.path).read_bytes()
            block = chooser.block(mutant)
            can = block and block not in self._records.imported and fits(mutant, source)
            collected = {test.file for test in self._tests(files[mutant])} if can else ()
            served_by = tuple(sorted(collected))
            jobs.append(Job(choice.files, plugin, LONGEST_S, cpu_s, mutant, served_by))
        jobs.sort(key=lambda job: job.served_by)
        trees = [PrivateTree(self.source, self._folder / name) for name in self._names]
        for done in self._run(jobs, trees):
            if not done.job.mutant:
                continue
            mutant = done.job.mutant
            if done.code in PASSED:
                yield Outcome(mutant, False, _tried(choices[mutant]), done.seconds)
            else:
                slow = done.code in (None, -SIGKILL, -SIGXCPU)
                by = "timeout" if slow else done.found.get("failed") or "on import"
                yield Outcome(mutant, True, str(by), done.seconds)

    @cached_property
    def _marked(self) -> list[PrivateTree]:
        trees = [PrivateTree(self.source, self._folder / f"record{name}") for name in self._names]
        for tree in trees:
            tree.mark(self._blocks)
        return trees

    def _tests(self, files: Iterable[str]) -> list[RecordedTest]:
        known = (file for file in files if self._records.knows(file))
        return [test for file in known for test in self._records.tests(file)]

    def _record(self, files: Sequence[str]) -> None:
        """Record the test files of which nothing is known, or of which too much has changed."""
        left = [file for file in files if not self._records.knows(file)]
        if not left:
            return
        jobs = [Job((file,), Reach, RECORD_S) for file in left]
        for n, done in enumerate(self._run(jobs, self._marked), start=1):
            (file,) = done.job.files
            tests = done.found.get("tests", {})
            self._show(
                f"recorded {n}/{len(left)} {done.seconds:5.1f} s  {file}: {len(tests)} tests"
            )
            for name in done.found.get("failed", ()):
                self._show(f"left out, it fails without a mutant, or takes long: {name}")
            if not tests:
                self._show(f"left out, nothing in it passes: {file}\n{done.output}")
                continue
            self._records.keep(file, done.found)

    def _run(self, jobs: Sequence[Job], trees: list[PrivateTree]) -> Iterator[Done]:
        """Yield the jobs as they end."""
        waiting, free, running = deque(jobs), list(trees), list[tuple[Job, Trial]]()
        servers: dict[PrivateTree, Server | None] = {}
        try:
            while waiting or running:
                while free and waiting:
                    running.append(_started(free.pop(), waiting.popleft(), servers))
                for job, trial in list(running):
                    done = _ended(job, trial)
                    if done:
                        running.remove((job, trial))
                        free.append(trial.tree)
                        load(done.found.get("foreign", ()))
                        yield done
                sleep(POLL_S)
        finally:
            for _, trial in running:
                trial.stop()
            for server in servers.values():
                if server:
                    server.stop()


def _started(
    tree: PrivateTree, job: Job, servers: dict[PrivateTree, Server | None]
) -> tuple[Job, Trial]:
    # Only for a mutant: the plugin of a recording begins to record where it is made.
    plugin = job.plugin() if job.mutant and job.served_by else None
    if job.mutant and isinstance(plugin, Chosen):
        server = servers.get(tree)
        if not server or server.files != job.served_by:
            if server:
                server.stop()
            server = servers[tree] = Server.start(tree, job.served_by)
        if server:
            return job, server.order(job.mutant, plugin.tests, job.cpu_s)
    if job.mutant:
        tree.apply(job.mutant)
    options = ["-x"] if job.mutant else []
    return job, Trial.start(tree, job.files, job.plugin, *options, cpu_s=job.cpu_s)


def _ended(job: Job, trial: Trial) -> Done | None:
    ended = trial.ended()
    if not ended:
        if trial.seconds < job.limit_s:
            return None
        trial.stop()
    trial.tree.restore()
    found = trial.found() or {}
    return Done(job, trial.code if ended else None, found, trial.seconds, trial.output())


def _tried(choice: Choice) -> str:
    text = f"{len(choice.tests)} tests pass"
    return f"{text}, {choice.left_out} not tried: cap reached" if choice.left_out else text
