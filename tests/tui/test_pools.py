"""Crews of workers: when fresh ones take over, and when a cluster counts as gone."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from importlib.metadata import version
from types import SimpleNamespace
from typing import Any, cast

import pytest

from dbc.errors import InputError
from tui.jobs import executors
from tui.jobs.executors import Cluster, Processes, as_finished, workers_of


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
    monkeypatch.setattr(executors, "Pool", Pool)
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


def test_no_worker_to_be_had_is_reported_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise OSError("AF_UNIX path too long")

    monkeypatch.setattr("multiprocessing.context.ForkServerProcess._Popen", refused)
    with pytest.raises(InputError) as caught, Processes(1) as crew:
        crew.submit(abs, -3)
    assert str(caught.value) == (
        "processes: no process can be started (AF_UNIX path too long) (end other programs, and try "
        "again)"
    )


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


# Connecting ---------------------------------------------------------------------------------------


class Scheduler:
    """A client of Dask, and its executor, that note what they are asked."""

    def __init__(self, workers: dict[str, object], waits: bool = False) -> None:
        self.workers, self.waits = workers, waits
        self.asked: list[object] = []
        self.gone = False

    def __call__(self, address: str, **options: object) -> Scheduler:
        self.asked.append((address, options))
        return self

    def wait_for_workers(self, count: int, timeout: float) -> None:
        """Wait for the first."""
        self.asked.append(("wait", count, timeout))
        if self.waits:
            raise TimeoutError

    def run(self, function: Callable[[str], str], name: str, on_error: str) -> dict[str, object]:
        """Return what the workers say of a package."""
        self.asked.append((function.__name__, name, on_error))
        return self.workers

    def get_executor(self, pure: bool) -> Scheduler:
        """Return what takes items."""
        self.asked.append(("executor", pure))
        return self

    def scheduler_info(self) -> dict[str, Any]:
        """Return what there is."""
        return {"workers": {"one": {"nthreads": 3}}}

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        """Do an item."""
        future: Future[Any] = Future()
        future.set_result(function(item))
        return future

    def shutdown(self, wait: bool) -> None:
        """End."""
        if self.gone:
            raise OSError("connection closed")
        self.asked.append(("shutdown", wait))

    def close(self, timeout: float) -> None:
        """Leave."""
        self.asked.append(("close", timeout))


ADDRESS = "tcp://host:8786"


@pytest.fixture
def dask(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Scheduler]]:
    """Return what puts a scheduler of a test in the place of Dask; its greeting may fail."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio")]
    levels = [logger.level for logger in loggers]

    def put(scheduler: Scheduler, greets: BaseException | None = None) -> Scheduler:
        async def greet(address: str) -> None:
            scheduler.asked.append(("greet", address))
            if greets is not None:
                raise greets

        monkeypatch.setattr(executors, "_greet", greet)
        monkeypatch.setitem(
            sys.modules, "distributed", cast(Any, SimpleNamespace(Client=scheduler))
        )
        return scheduler

    yield put
    for logger, level in zip(loggers, levels, strict=True):
        logger.setLevel(level)


def test_a_cluster_is_greeted_looked_at_and_left(dask: Callable[..., Scheduler]) -> None:
    own = version("bumpbench")
    scheduler = dask(Scheduler({"one": own, "two": own}))
    with workers_of(8, ADDRESS) as crew:
        assert crew.ahead == 6, "three threads"
        assert crew.submit(abs, -3).result() == 3
    assert scheduler.asked == [
        ("greet", ADDRESS),
        (ADDRESS, {"timeout": 4.0, "set_as_default": False}),
        ("wait", 1, 4.0),
        ("version", "bumpbench", "return"),
        ("executor", False),
        ("shutdown", False),
        ("close", 0.5),
    ]
    assert logging.getLogger("tornado").level > logging.CRITICAL
    scheduler.gone = True
    with workers_of(8, ADDRESS):
        pass


@pytest.mark.parametrize(
    ("scheduler", "why"),
    [
        (Scheduler({}, waits=True), f"{ADDRESS}: the scheduler has no workers"),
        (Scheduler({"one": "0.0.1"}), "worker one has bumpbench 0.0.1, here is "),
        (Scheduler({"two": ImportError()}), "worker two has no bumpbench (install one version"),
    ],
)
def test_a_cluster_that_is_of_no_use_is_left(
    scheduler: Scheduler, why: str, dask: Callable[..., Scheduler]
) -> None:
    dask(scheduler)
    with pytest.raises(InputError) as refused:
        workers_of(8, ADDRESS)
    assert why in str(refused.value)
    assert scheduler.asked[-1] == ("close", 0.5)


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (OSError("connection refused"), "connection refused"),
        (ValueError("no such protocol"), "no such protocol"),
        (OSError(), "something else listens there"),
        (KeyError("op"), "something else listens there"),
    ],
)
def test_who_listens_in_place_of_a_scheduler_is_said(
    error: Exception, why: str, dask: Callable[..., Scheduler]
) -> None:
    scheduler = dask(Scheduler({}), error)
    with pytest.raises(InputError) as refused:
        workers_of(8, ADDRESS)
    assert f"--scheduler {ADDRESS}: no Dask scheduler answers: {why}" in str(refused.value)
    assert scheduler.asked == [("greet", ADDRESS)]


def test_a_cluster_needs_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="needs Dask, which is not installed"):
        workers_of(8, ADDRESS)


def test_a_crew_is_looked_at_while_nothing_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[float] = []
    checked: list[int] = []
    future: Future[int] = Future()

    def wait_(running: Any, seconds: float, _: object) -> tuple[set[Any], set[Any]]:
        looks.append(seconds)
        if len(looks) < 3:
            return set(), set(running)
        future.set_result(1)
        return set(running), set()

    crew = SimpleNamespace(ahead=1, submit=lambda *_: future, check=lambda: checked.append(1))
    monkeypatch.setattr(executors, "wait", wait_)
    assert list(as_finished(cast(Any, crew), len, ["item"])) == [("item", future)]
    assert looks == [2.0] * 3
    assert checked == [1, 1]
