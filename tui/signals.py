"""Ends a command by a signal as by an exception: what it was writing is removed."""

from __future__ import annotations

import signal
import sys
from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread, current_thread, main_thread
from time import sleep
from traceback import walk_stack
from types import CodeType

_AGAIN_S = 0.01
"""Least time after which a signal is repeated whose exception Python has dropped, s."""


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
                Thread(target=_again, args=(number, dropped.__code__), daemon=True).start()
                return
        hook(what)

    before, hook = signal.signal(signal.SIGTERM, end), sys.unraisablehook
    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = hook
        signal.signal(signal.SIGTERM, before)


def _again(number: signal.Signals, hook: CodeType) -> None:
    """Send a signal to the main thread; it ends a wait there, as the first would have.

    What it raises within the hook would be dropped as well: it comes after that.
    """
    main = main_thread().ident
    assert main is not None, "it runs"
    sleep(_AGAIN_S)
    while any(frame.f_code is hook for frame, _ in walk_stack(sys._current_frames().get(main))):
        sleep(_AGAIN_S)
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main, number)
    else:  # Windows
        interrupt_main(number)
