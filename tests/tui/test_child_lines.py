"""Lines of a worker's process, and the row of one session in a batch."""

from __future__ import annotations

import asyncio
import io
import os
import signal
from typing import Any

import pytest

from tui.jobs.lines import Done, Line, ListTask, Progress, Trouble, line_bytes, task_text
from tui.jobs.worker import lines_of

TASK = ListTask("/bench")


class Child:
    """A process that is only noted."""

    pid = 4711

    def __init__(self, *lines: bytes, code: int = 0) -> None:
        self.stdout, self.code = io.BytesIO(b"".join(lines)), code
        self.commands: list[tuple[Any, ...]] = []
        self.killed = 0

    def __call__(self, command: list[str], **options: Any) -> Child:
        self.commands.append((command, options))
        return self

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        """Its pipes are closed."""

    def wait(self) -> int:
        """Return its exit code."""
        return self.code

    def kill(self) -> None:
        """Note it."""
        self.killed += 1


def heard(child: Any, monkeypatch: pytest.MonkeyPatch) -> list[Line]:
    monkeypatch.setattr("tui.jobs.worker.subprocess.Popen", child)

    async def listen() -> list[Line]:
        return [line async for line in lines_of(TASK, "the list")]

    return asyncio.run(listen())


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Return the process groups that were ended, and how."""
    seen: list[tuple[int, int]] = []
    monkeypatch.setattr("tui.jobs.worker.os.killpg", lambda *given: seen.append(given))
    return seen


def test_what_is_no_line_is_passed_over_and_the_answer_is_the_last(
    ended: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines: tuple[Line, ...] = (
        Progress(0.5, "reading"),
        Done({"count": 1}),
        Progress(1.0, "too late"),
    )
    child = Child(b"warning: odd\n", *map(line_bytes, lines))
    assert heard(child, monkeypatch) == list(lines[:2])
    ((command, options),) = child.commands
    assert command[1:] == ["-m", "tui.jobs.work", task_text(TASK)]
    assert options["start_new_session"] is True
    assert ended == [(4711, signal.SIGKILL)]
    assert child.killed == 0


def test_a_process_that_ends_without_an_answer_is_trouble(
    ended: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    *_, last = heard(Child(line_bytes(Progress(0.5, "reading")), code=3), monkeypatch)
    assert isinstance(last, Trouble)
    assert last.where == "the list"
    assert "3" in last.what
    assert len(ended) == 1


def test_where_there_are_no_groups_of_processes_the_child_is_killed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(os, "killpg")
    child = Child(line_bytes(Done({})))
    heard(child, monkeypatch)
    assert child.killed == 1


def test_a_process_that_cannot_be_started_is_trouble(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    (only,) = heard(refused, monkeypatch)
    assert only == Trouble(
        "the list",
        "no process can be started (Resource temporarily unavailable)",
        "end other programs, and try again",
    )
