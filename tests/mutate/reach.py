"""A pytest plugin: which blocks each test runs, its CPU time, and whether it passes.

What a shared fixture or a cached function runs counts for each test that uses it, as if the test
ran alone; its time is kept apart, since it is taken once only where several of them run.
"""

from __future__ import annotations

import functools
import json
import os
import signal
from collections import defaultdict
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha1
from pathlib import Path
from typing import Any, NoReturn

import pytest

from . import probe
from .sources import OF_THE_TREE

LRU_CACHE = functools.lru_cache
LONGEST_S = 60.0
"""CPU time after which a test is stopped and left out: within the cap it is the last to run."""


def _cpu_s() -> float:
    """Return the CPU time of this process and of those that it has waited for, s."""
    return sum(os.times()[:4])


def _too_long(number: int, frame: object) -> NoReturn:
    raise TimeoutError


@dataclass(slots=True)
class Cost:
    """Holds the blocks that a test or fixture ran, and its CPU time."""

    name: str = ""
    """Of what several tests share: the same in every process."""
    seconds: float = 0.0
    """Without what it shares with others."""
    blocks: set[str] = field(default_factory=set)
    uses: list[Cost] = field(default_factory=list)
    """What it shares with others."""

    @property
    def shared(self) -> dict[str, float]:
        """Return the time of each thing that it shares, and of what these share, by name."""
        found: dict[str, float] = {}
        for used in self.uses:
            found |= {used.name: used.seconds} | used.shared
        return found


@dataclass(slots=True, eq=False)  # pytest keeps its plugins in sets
class Reach:
    """Records the tests of this process."""

    folder: Path = field(default_factory=lambda: Path.cwd().parent / "reached")
    """Where processes that a test starts leave what they have run."""
    tests: dict[str, Cost] = field(default_factory=lambda: defaultdict(Cost))
    failed: set[str] = field(default_factory=set)
    fixtures: dict[str, Cost] = field(default_factory=dict)
    imported: set[str] = field(default_factory=set)
    """Blocks that ran before the first test, for all of them."""
    now: str = ""
    """The test that runs."""
    used: list[Cost] = field(default_factory=list)
    """What this test uses of what others use too."""
    apart_s: float = 0.0
    """CPU time of what was made meanwhile and others use too."""

    def __post_init__(self) -> None:
        self.folder.mkdir(exist_ok=True)
        for path in self.folder.iterdir():
            path.unlink()
        self._start("")
        probe.record_children(self.folder)
        signal.signal(signal.SIGPROF, _too_long)
        vars(functools).update(
            lru_cache=self._lru_cache, cache=lambda function: self._lru_cache(None)(function)
        )

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Collect what a test runs."""
        self._start(item.nodeid)
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
        start_s = _cpu_s()
        result = yield
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        for name in getattr(item, "fixturenames", ()):
            self._use(self.fixtures.get(name))
        cost = self.tests[item.nodeid]
        cost.blocks |= probe.seen.union(self.imported, *(used.blocks for used in self.used))
        cost.seconds, cost.uses = _cpu_s() - start_s - self.apart_s, self.used
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[object]
    ) -> Generator[None, object, object]:
        """Collect what a fixture runs that several tests share."""
        if fixturedef.scope == "function":
            return (yield)
        with self._apart(f"fixture {fixturedef.argname}") as cost:
            result = yield
        self.fixtures[fixturedef.argname] = cost
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a test that fails."""
        if report.failed:
            self.failed.add(report.nodeid)

    def found(self) -> dict[str, Any]:
        """Return the record of the tests that passed, with what their processes ran."""
        for path in self.folder.glob("*.json"):
            test, blocks = json.loads(path.read_text("utf-8"))
            if test in self.tests:
                self.tests[test].blocks.update(blocks)
        return {
            "failed": sorted(self.failed),
            "imported": sorted(self.imported),
            "tests": {
                test: [round(cost.seconds, 4), sorted(cost.blocks), cost.shared]
                for test, cost in self.tests.items()
                if test not in self.failed
            },
        }

    def _start(self, test: str) -> None:
        if not self.now:
            self.imported |= probe.seen
        probe.seen.clear()
        self.now, self.used, self.apart_s = test, [], 0.0
        (self.folder / probe.CURRENT).write_text(test, "utf-8")

    def _use(self, cost: Cost | None) -> None:
        if cost and not any(cost is used for used in self.used):
            self.used.append(cost)

    @contextmanager
    def _apart(self, name: str) -> Iterator[Cost]:
        """Yield the cost of what runs meanwhile."""
        before, cost, start_s = set(probe.seen), Cost(name), _cpu_s()
        outer_s, self.apart_s, first = self.apart_s, 0.0, len(self.used)
        probe.seen.clear()
        try:
            yield cost
        finally:
            taken_s = _cpu_s() - start_s
            cost.uses = self.used[first:]
            cost.blocks = probe.seen.union(*(used.blocks for used in cost.uses))
            cost.seconds, self.apart_s = taken_s - self.apart_s, outer_s + taken_s
            probe.seen.update(before)

    def _lru_cache(self, *options: Any, **named: Any) -> Any:
        """Return what `lru_cache` does; in the tree, with what each result has cost."""
        if options and callable(options[0]):
            return self._lru_cache()(options[0])

        def decorate(function: Callable[..., Any]) -> Any:
            cache: Callable[[Any], Any] = LRU_CACHE(*options, **named)
            if function.__module__.split(".")[0] not in OF_THE_TREE:
                return cache(function)
            costs: dict[object, Cost] = {}

            def made(*given: Any, **by_name: Any) -> Any:
                arguments = given, tuple(by_name.items())
                digest = sha1(repr(arguments).encode()).hexdigest()
                name = f"{function.__module__}.{function.__qualname__} {digest}"
                with self._apart(name) as costs[arguments]:
                    return function(*given, **by_name)

            kept = cache(made)

            @functools.wraps(function)
            def looked_up(*given: Any, **by_name: Any) -> Any:
                result = kept(*given, **by_name)
                self._use(costs.get((given, tuple(by_name.items()))))
                return result

            for name in ("cache_info", "cache_clear", "cache_parameters"):
                setattr(looked_up, name, getattr(kept, name))
            return looked_up

        return decorate
