"""Ends a command by a signal as by an exception: what it was writing is removed."""

from __future__ import annotations

import signal
import sys
from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer, current_thread, main_thread

_AGAIN_S = 0.01
"""Time after which a signal is repeated whose exception Python has dropped, s."""


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Turn SIGTERM in the body into an exception, as Ctrl-C is one, so that nothing is half done.

    The exit code is that of a process that the signal ends.  Python drops an exception that a
    signal raises while an object is deleted, after a traceback: the signal then comes again.
    """
    if current_thread() is not main_thread():  # only the main thread handles signals
        yield
        return

    def end(number: int, _: object) -> None:
        sys.exit(128 + number)

    def dropped(what: sys.UnraisableHookArgs) -> None:
        for kind, number in ((SystemExit, signal.SIGTERM), (KeyboardInterrupt, signal.SIGINT)):
            if issubclass(what.exc_type, kind):
                Timer(_AGAIN_S, _again, (number,)).start()
                return
        hook(what)

    before, hook = signal.signal(signal.SIGTERM, end), sys.unraisablehook
    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = hook
        signal.signal(signal.SIGTERM, before)


def _again(number: signal.Signals) -> None:
    """Send a signal to the main thread; it ends a wait there, as the first would have."""
    thread = main_thread().ident
    if hasattr(signal, "pthread_kill") and thread is not None:
        signal.pthread_kill(thread, number)
    else:  # Windows
        interrupt_main(number)
