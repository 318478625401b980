"""One run of test files on one private tree, in a process forked from this one.

What this process has loaded of foreign libraries need not be loaded again; what it has loaded of
the tree is dropped, and loaded anew from the copy.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from math import ceil
from pathlib import Path
from time import monotonic
from typing import Any, Protocol

import pytest
from hypothesis import Phase, settings

from . import probe
from .private_tree import PrivateTree
from .sources import OF_THE_TREE

HERE = str(Path(__file__).parents[2])
PASSED = (0, 5)
"""Exit codes of pytest: all passed, nothing collected."""
OPTIONS = (
    *("-q", "--tb=short", "--no-header", "-p", "no:cacheprovider", "-p", "no:xdist"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # plugins are loaded before the fork
)


class Plugin(Protocol):
    """A pytest plugin with a result."""

    def found(self) -> dict[str, Any]:
        """Return what it has found, for JSON."""


@dataclass(slots=True, eq=False)  # pytest keeps its plugins in sets
class Chosen:
    """Runs chosen tests only, in their order, until one fails."""

    tests: Sequence[str]
    failed: str = ""

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep the chosen tests."""
        by_name = {item.nodeid: item for item in items}
        items[:] = [by_name[name] for name in self.tests if name in by_name]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the name of the first test that fails."""
        if report.failed:
            self.failed = self.failed or report.nodeid

    def found(self) -> dict[str, Any]:
        """Return the test that failed."""
        return {"failed": self.failed}


@dataclass(slots=True)
class Trial:
    """A process that runs test files on a private tree."""

    tree: PrivateTree
    pid: int
    started: float
    code: int | None = None

    @classmethod
    def start(
        cls,
        tree: PrivateTree,
        files: Sequence[str],
        plugin: Callable[[], Plugin],
        *options: str,
        cpu_s: float = 0.0,
    ) -> Trial:
        """Fork, and run the files, with a limit of CPU time unless that is 0."""
        sys.stdout.flush()
        tree.forget()
        pid = os.fork()
        if pid == 0:
            status = 3
            try:
                if cpu_s:
                    limit_cpu(cpu_s)
                status = _run(tree, files, plugin, options)
            except BaseException:
                traceback.print_exc()
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(status)
        return cls(tree, pid, monotonic())

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

    def found(self) -> dict[str, Any] | None:
        """Return what its plugin has found; None if the process died before."""
        if not self.tree.found.is_file():
            return None
        found: dict[str, Any] = json.loads(self.tree.found.read_text("utf-8"))
        return found

    def _kill_group(self) -> None:
        try:
            os.killpg(self.pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            return


def limit_cpu(cpu_s: float) -> None:
    """Let the system end this process, and each that it starts, after so much CPU time."""
    seconds = ceil(cpu_s)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))


def load(modules: Sequence[str]) -> None:
    """Load foreign modules here, for all processes that are forked later."""
    for name in modules:
        try:
            import_module(name)
        except Exception:  # of use only if it loads; the tests load it where they need it
            continue


def _run(
    tree: PrivateTree, files: Sequence[str], plugin: Callable[[], Plugin], options: Sequence[str]
) -> int:
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
    sys.modules["mutate_probe"] = probe
    made = plugin()
    places = [f"--rootdir={tree.root}", f"--basetemp={tree.root.parent / 'tmp'}"]
    code = int(pytest.main([*OPTIONS, *options, *places, *files], plugins=[made]))
    loaded = {name: Path(str(getattr(m, "__file__", ""))) for name, m in sys.modules.items()}
    tests = [path for path in loaded.values() if tree.root / "tests" in path.parents]
    found = {
        **made.found(),
        "foreign": [name for name, path in loaded.items() if "site-packages" in path.parts],
        "modules": sorted(path.relative_to(tree.root).as_posix() for path in tests),
    }
    tree.found.write_text(json.dumps(found), "utf-8")
    sys.stdout.flush()
    return code


def _output(tree: PrivateTree) -> Path:
    return tree.root.parent / "output.txt"
