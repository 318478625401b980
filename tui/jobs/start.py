"""Starts worker processes that share loaded libraries, ignore Ctrl-C and end with their parent."""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_all_start_methods, get_context, parent_process
from multiprocessing.connection import wait
from multiprocessing.context import BaseContext
from multiprocessing.util import get_temp_dir
from threading import Thread, current_thread, main_thread

_LONGEST_FOLDER = 70
"""Longest path of a folder, bytes, in which multiprocessing can have its sockets: it adds 32 bytes,
and macOS takes 103, Linux 107."""


def preloaded(modules: Sequence[str]) -> BaseContext:
    """Return a context that starts processes with these modules, which are loaded once for all."""
    if "forkserver" not in get_all_start_methods():  # Windows: each process loads its own
        return get_context("spawn")
    _place_sockets()
    context = get_context("forkserver")
    context.set_forkserver_preload(list(modules))
    return context


def _place_sockets() -> None:
    """Place the sockets of processes in /tmp if that of temporary files has too long a path."""
    if len(os.fsencode(tempfile.gettempdir())) <= _LONGEST_FOLDER:
        return
    before, tempfile.tempdir = tempfile.tempdir, "/tmp"
    try:
        with suppress(OSError):  # the start of a process reports it
            get_temp_dir()  # made once, and kept for this process
    finally:
        tempfile.tempdir = before


@contextmanager
def ignoring_interrupts() -> Iterator[None]:
    """Make processes that are started in the body ignore Ctrl-C: they inherit the signal mask."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def sigterm_deferred() -> Iterator[None]:
    """Let SIGTERM wait for the end of the body.

    Only then does the parent know a process that is started in the body: a parent that ended before
    would leave a process behind, which then prints a traceback because its locks are gone.
    """
    if current_thread() is not main_thread():  # only the main thread handles signals
        yield
        return
    came: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
        for number in came[:1]:
            signal.raise_signal(number)


def end_with_parent() -> None:
    """Make a worker end when its parent is killed; otherwise it would wait for work for ever."""
    parent = parent_process()
    assert parent is not None  # a worker has a parent

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    Thread(target=watch, daemon=True).start()
