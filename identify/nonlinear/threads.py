"""Evaluates the runs of a problem side by side: machine code and BLAS release the interpreter."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, TypeVar

T = TypeVar("T")


def for_each_run(function: Callable[..., T], *arguments: Iterable[Any]) -> tuple[T, ...]:
    """Return what a function returns for each run, in their order; as `map` does."""
    return tuple(_threads(os.getpid()).map(function, *arguments))


@cache
def _threads(process: int) -> ThreadPoolExecutor:
    """Return the threads of a process: one that was forked has none of its parent's."""
    return ThreadPoolExecutor(os.cpu_count(), f"runs of {process}")
