"""A Python without POSIX, as that of Windows, in the eyes of our packages alone.

On the path of a process and of its children.  The standard library and others stay as they are:
theirs is what such a system has in their place.
"""

from __future__ import annotations

import builtins
from types import ModuleType
from typing import Any

OURS = {"daq", "dbc", "identify", "tui"}
MODULES = {"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}
NAMES = {
    "os": {
        "chown", "fchmod", "fdatasync", "fork", "forkpty", "getegid", "geteuid", "getgid",
        "getloadavg", "getpriority", "getuid", "killpg", "mkfifo", "nice", "posix_fadvise", "pread",
        "pwrite", "sched_getaffinity", "setpriority", "setsid", "statvfs", "sysconf", "uname",
        "wait4", "O_CLOEXEC", "O_DIRECTORY", "O_DSYNC", "O_NOFOLLOW", "O_NONBLOCK", "WNOHANG",
    },
    "select": {"epoll", "poll"},
    "signal": {
        "ITIMER_REAL", "SIGALRM", "SIGCHLD", "SIGCONT", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT",
        "SIGTSTP", "SIGUSR1", "SIGWINCH", "alarm", "pthread_sigmask", "setitimer",
    },
    "socket": {"AF_CAN", "AF_UNIX", "PF_CAN", "SCM_RIGHTS", "SO_REUSEPORT"},
}  # fmt: skip
"""What the documentation of the standard library gives as available on Unix only."""
_whole_import = builtins.__import__


class _Lacking(ModuleType):
    """A module without some of its names."""

    def __init__(self, whole: ModuleType) -> None:
        super().__init__(whole.__name__)
        self.__dict__["whole"] = whole

    def __getattr__(self, name: str) -> Any:
        if name in NAMES[self.__name__]:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(self.whole, name)


def _import(name: str, *given: Any, **named: Any) -> ModuleType:
    """Import a module; `given`: globals, locals, names and level of the statement."""
    spec = (given[0] or {}).get("__spec__") if given else None
    level = given[3] if len(given) > 3 else named.get("level", 0)
    if level == 0 and spec is not None and spec.name.split(".")[0] in OURS:
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        if name in NAMES:
            return _Lacking(_whole_import(name))
    return _whole_import(name, *given, **named)


builtins.__import__ = _import
