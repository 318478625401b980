"""Pool of processes that reports in one line that none can be started."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
Result = TypeVar("Result")


class Pool(ProcessPoolExecutor):
    """Processes of this machine; as ProcessPoolExecutor, but for its errors."""

    def submit(
        self, fn: Callable[P, Result], /, *args: P.args, **kwargs: P.kwargs
    ) -> Future[Result]:
        """Hand over one piece of work.  Raises InputError if no process can be started."""
        from dbc import InputError

        try:
            return super().submit(fn, *args, **kwargs)
        except (OSError, EOFError) as error:
            what = f"no process can be started ({error})"
            raise InputError("processes", what, "end other programs, and try again") from error
