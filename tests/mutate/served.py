"""Mutants put into a process that has loaded and collected all: a fork and a few tests each.

A fault inside a function changes the code of that function and of those in it, nothing else: it is
given to the functions that live, and what was loaded stays.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from time import monotonic
from types import CodeType, FunctionType
from typing import Any

import pytest

from .mutant import Mutant
from .private_tree import PrivateTree
from .trial import Chosen, Trial, limit_cpu

COLLECTED_S = 600.0
"""Longest time that a process may take to load and collect its test files, s."""


class Served(Chosen):
    """A pytest plugin: in place of a run, forks one for each order that comes."""

    def __init__(self, orders: Connection[Any, Any]) -> None:
        super().__init__(())
        self.orders = orders

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep all."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> object:
        """Fork at each order; the fork goes on with the tests of the order."""
        by_name = {item.nodeid: item for item in session.items}
        self.orders.send("ready")
        while True:
            try:
                path, source, line, tests, cpu_s = self.orders.recv()
            except EOFError:
                return True
            pid = os.fork()
            if pid == 0:
                os.setsid()
                limit_cpu(cpu_s)
                put_in(path, source, line)
                session.items = [by_name[name] for name in tests if name in by_name]
                return None
            self.orders.send(pid)
            self.orders.send(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))


@dataclass(slots=True)
class ServedTrial(Trial):
    """The run of an order."""

    orders: Connection[Any, Any] | None = None

    def ended(self) -> bool:
        """Return whether it has come to its end."""
        if self.code is None and self.orders and self.orders.poll():
            self._kill_group()
            self.code = self.orders.recv()
        return self.code is not None

    def stop(self) -> None:
        """End it, with all that it started."""
        if self.code is None and self.orders:
            self._kill_group()
            self.orders.recv()


@dataclass(slots=True)
class Server:
    """A process that has collected some test files of a tree."""

    tree: PrivateTree
    files: tuple[str, ...]
    trial: Trial
    orders: Connection[Any, Any]

    @classmethod
    def start(cls, tree: PrivateTree, files: tuple[str, ...]) -> Server | None:
        """Collect; return None if that fails."""
        here, there = Pipe()
        trial = Trial.start(tree, files, partial(Served, there), "-x")
        there.close()
        try:
            if here.poll(COLLECTED_S) and here.recv() == "ready":
                return cls(tree, files, trial, here)
        except EOFError:
            pass
        trial.stop()
        return None

    def order(self, mutant: Mutant, tests: Sequence[str], cpu_s: float) -> ServedTrial:
        """Start the tests of a mutant."""
        path = str(self.tree.root / mutant.path)
        self.tree.forget()
        self.tree.apply(mutant)  # for processes that the tests start
        self.orders.send((path, Path(path).read_bytes(), mutant.line, tuple(tests), cpu_s))
        return ServedTrial(self.tree, self.orders.recv(), monotonic(), orders=self.orders)

    def stop(self) -> None:
        """End the process."""
        self.trial.stop()


def fits(mutant: Mutant, source: bytes) -> bool:
    """Return whether the fault leaves the closures of all functions as they are."""
    old, new = (_codes(text, mutant.path) for text in (source, mutant.applied(source)))
    around = {key: code for key, code in old.items() if key[1] <= mutant.line}
    return all(
        key in new and new[key].co_freevars == code.co_freevars for key, code in around.items()
    )


def put_in(path: str, source: bytes, line: int) -> None:
    """Give the functions that begin up to a line the code that they have in a source."""
    new = _codes(source, path)
    gc.unfreeze()  # `tests/conftest.py` froze what was loaded; frozen objects are not listed
    for function in gc.get_objects():
        if type(function) is FunctionType and function.__code__.co_filename == path:
            code = new.get(_key(function.__code__))
            if code and code.co_firstlineno <= line:
                function.__code__ = code


def _codes(source: bytes, path: str) -> dict[tuple[str, int], CodeType]:
    module = compile(source, path, "exec", dont_inherit=True)
    return {_key(code): code for code in _within(module)}


def _key(code: CodeType) -> tuple[str, int]:
    return code.co_qualname, code.co_firstlineno


def _within(code: CodeType) -> Iterator[CodeType]:
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield part
            yield from _within(part)
