"""One run of test files on one private tree, in a process forked from this one.

What this process has loaded of foreign libraries need not be loaded again; what it has loaded of
the tree is dropped, and loaded anew from the copy.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import sys
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from time import monotonic

import pytest
from hypothesis import Phase, settings

from .private_tree import PrivateTree

HERE = str(Path(__file__).parents[2])
OF_THE_TREE = frozenset({"dbc", "daq", "identify", "tui", "tests"})
PASSED = (0, 5)
"""Exit codes of pytest: all passed, nothing collected."""
OPTIONS = (
    *("-q", "-x", "--tb=short", "--no-header", "-p", "no:cacheprovider", "-p", "no:xdist"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # plugins are loaded before the fork
)


@dataclass(frozen=True, slots=True)
class Report:
    """What a run has left behind."""

    code: int
    """Exit code of pytest, or of the process."""
    failed: str
    """The file of the first failure; empty if there is none."""
    seconds: Mapping[str, float]
    """How long each file took."""
    modules: Sequence[str]
    """Foreign modules that were loaded."""


@dataclass(slots=True, eq=False)  # pytest keeps its plugins in sets
class Measured:
    """A pytest plugin: how long each file took, and which failed."""

    seconds: dict[str, float] = field(default_factory=dict)
    failed: str = ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add a phase of a test to its file."""
        path = report.nodeid.split("::")[0]
        self.seconds[path] = self.seconds.get(path, 0.0) + report.duration
        if report.failed:
            self.failed = self.failed or path

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note a file that cannot be loaded."""
        if report.failed:
            self.failed = self.failed or report.nodeid.split("::")[0]


@dataclass(slots=True)
class Trial:
    """A process that runs test files on a private tree."""

    tree: PrivateTree
    files: tuple[str, ...]
    pid: int
    started: float
    code: int | None = None

    @classmethod
    def start(cls, tree: PrivateTree, files: tuple[str, ...]) -> Trial:
        """Fork, and run the files in this order until one fails."""
        sys.stdout.flush()
        _record(tree).unlink(missing_ok=True)
        pid = os.fork()
        if pid == 0:
            status = 3
            try:
                status = _run(tree, files)
            except BaseException:
                traceback.print_exc()
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(status)
        return cls(tree, files, pid, monotonic())

    @property
    def seconds(self) -> float:
        """Return how long it has run."""
        return monotonic() - self.started

    def ended(self) -> bool:
        """Return whether it has come to its end."""
        if self.code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self._kill_group()
                self.code = os.waitstatus_to_exitcode(status)
        return self.code is not None

    def stop(self) -> None:
        """End it, with all that it started."""
        if self.code is None:
            self._kill_group()
            os.waitpid(self.pid, 0)

    def output(self) -> str:
        """Return the last lines that pytest printed."""
        text = _output(self.tree).read_text("utf-8", errors="replace")
        return "\n".join(text.splitlines()[-4:])

    def report(self) -> Report:
        """Return what it has left behind.

        A process that died leaves its code only, and pytest may fail before any test: either
        counts as a failure of the first file.
        """
        assert self.code is not None
        if not _record(self.tree).is_file():
            return Report(self.code or 1, self.files[0], {}, ())
        failed, seconds, modules = json.loads(_record(self.tree).read_text("utf-8"))
        if self.code not in PASSED:
            failed = failed or self.files[0]
        return Report(self.code, failed, seconds, modules)

    def _kill_group(self) -> None:
        try:
            os.killpg(self.pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            return


def load(modules: Sequence[str]) -> None:
    """Load foreign modules here, for all processes that are forked later."""
    for name in modules:
        try:
            import_module(name)
        except Exception:  # of use only if it loads; the tests load it where they need it
            continue


def _run(tree: PrivateTree, files: Sequence[str]) -> int:
    os.setsid()
    output = os.open(_output(tree), os.O_CREAT | os.O_TRUNC | os.O_WRONLY, 0o644)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(tree.root)
    for name in [name for name in sys.modules if name.split(".")[0] in OF_THE_TREE]:
        del sys.modules[name]
    sys.path[:] = [str(tree.root), *(p for p in sys.path if p and p != HERE)]
    sys.meta_path[:] = [
        finder for finder in sys.meta_path if "editable" not in getattr(finder, "__module__", "")
    ]
    sys.executable = str(tree.python)
    multiprocessing.set_executable(sys.executable)
    os.environ["PATH"] = f"{tree.python.parent}{os.pathsep}{os.environ['PATH']}"
    settings.register_profile("mutate", phases=[Phase.explicit, Phase.reuse, Phase.generate])
    settings.load_profile("mutate")  # no search for a simpler example: the first failure kills
    measured = Measured()
    code = int(
        pytest.main(
            [*OPTIONS, f"--rootdir={tree.root}", f"--basetemp={tree.root.parent / 'tmp'}", *files],
            plugins=[measured],
        )
    )
    foreign = [
        name
        for name, module in sys.modules.items()
        if "site-packages" in str(getattr(module, "__file__", ""))
    ]
    _record(tree).write_text(json.dumps([measured.failed, measured.seconds, foreign]), "utf-8")
    sys.stdout.flush()
    return code


def _output(tree: PrivateTree) -> Path:
    return tree.root.parent / "output.txt"


def _record(tree: PrivateTree) -> Path:
    return tree.root.parent / "measured.json"
