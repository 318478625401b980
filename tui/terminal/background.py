"""Starts work of a screen that runs in parallel with its messages."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

from textual.dom import DOMNode
from textual.worker import WorkType


def begin(
    node: DOMNode,
    work: Callable[[], Coroutine[Any, Any, None]],
    group: str = "default",
    exclusive: bool = False,
) -> None:
    """Start work of a screen; `exclusive`: end the earlier work of the group.

    The coroutine is created when the work begins, so it is not created for work that ends before.
    """
    made: WorkType[None] = work
    node.run_worker(made, group=group, exclusive=exclusive)
