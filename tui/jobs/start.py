"""Starts worker processes that share loaded libraries, ignore Ctrl-C and end with their parent."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing import get_all_start_methods, get_context, parent_process
from multiprocessing.connection import wait
from multiprocessing.context import BaseContext
from multiprocessing.util import get_temp_dir
from threading import Thread

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


def end_with_parent() -> None:
    """Make a worker end when its parent is killed; otherwise it would wait for work for ever."""
    parent = parent_process()
    assert parent is not None  # a worker has a parent

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    Thread(target=watch, daemon=True).start()
