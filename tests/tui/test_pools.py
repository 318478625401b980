"""Crews of workers: when fresh ones take over, and when a cluster counts as gone."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace
from typing import Any

import pytest

from dbc.errors import InputError
from tui.jobs import executors
from tui.jobs.executors import Cluster, Processes


class Pool:
    """A pool that counts what it is given, and dies where a test wants."""

    made: list[Pool]

    def __init__(self, workers: int, *_: object) -> None:
        self.workers, self.given, self.shut = workers, 0, list[dict[str, bool]]()
        self.dies = False
        Pool.made.append(self)

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        """Do an item."""
        if self.dies:
            raise BrokenProcessPool("a worker died")
        self.given += 1
        future: Future[Any] = Future()
        future.set_result(function(item))
        return future

    def shutdown(self, **options: bool) -> None:
        """End."""
        self.shut.append(options)


@pytest.fixture
def pools(monkeypatch: pytest.MonkeyPatch) -> list[Pool]:
    made: list[Pool] = []
    monkeypatch.setattr(Pool, "made", made, raising=False)
    monkeypatch.setattr(executors, "ProcessPoolExecutor", Pool)
    return made


def test_workers_make_room_for_fresh_ones_after_two_hundred_items_each(pools: list[Pool]) -> None:
    with Processes(2) as crew:
        assert crew.ahead == 4
        for number in range(401):
            assert crew.submit(abs, -number).result() == number
            assert len(pools) == (1 if number < 400 else 2)
    assert [pool.given for pool in pools] == [400, 1]
    assert [pool.workers for pool in pools] == [2, 2]
    assert pools[0].shut == [{"wait": False}], "what it has begun it finishes"
    assert pools[1].shut == [{"cancel_futures": True}]


def test_a_pool_that_has_died_is_replaced_and_counts_anew(pools: list[Pool]) -> None:
    with Processes(1) as crew:
        crew.submit(abs, -1)
        pools[0].dies = True
        assert crew.submit(abs, -2).result() == 2
        assert [pool.given for pool in pools] == [1, 1]
        for _ in range(199):
            crew.submit(abs, 0)
        assert len(pools) == 2
        crew.submit(abs, 0)
        assert len(pools) == 3


def cluster(threads: list[int] | None) -> tuple[Cluster, SimpleNamespace]:
    """Return a cluster whose scheduler says what a test wants; None: it does not answer."""
    said = SimpleNamespace(threads=threads)

    def scheduler_info() -> dict[str, Any]:
        if said.threads is None:
            raise OSError("connection refused")
        return {"workers": {str(n): {"nthreads": t} for n, t in enumerate(said.threads)}}

    made = Cluster.__new__(Cluster)
    made._address = "tcp://host:8786"
    made._client = SimpleNamespace(scheduler_info=scheduler_info)
    made._threads, made._asked_s, made._seen_s = 1, float("-inf"), float("-inf")
    return made, said


def test_a_cluster_is_as_large_as_its_workers_and_gone_after_a_minute_without_any(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = [100.0]
    monkeypatch.setattr(executors, "monotonic", lambda: clock[0])
    crew, said = cluster([2, 3])
    assert crew.ahead == 10
    said.threads = [4]
    clock[0] = 102.0
    assert crew.ahead == 10, "it is asked every two seconds"
    clock[0] = 102.1
    assert crew.ahead == 8
    said.threads = []
    clock[0] = 162.1
    crew.check()
    assert crew.ahead == 2, "some may come"
    clock[0] = 162.2
    with pytest.raises(InputError, match="all its workers have gone"):
        crew.check()
    said.threads = [1]
    crew.check()
    said.threads = None
    with pytest.raises(InputError, match="the scheduler has gone"):
        crew.check()
