"""Starts work of a screen that goes on beside its messages."""

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
    """Start work of a screen; `exclusive`: it ends what the group did before.

    Its coroutine is made when the work begins: one that is ended before is never made.
    """
    made: WorkType[None] = work
    node.run_worker(made, group=group, exclusive=exclusive)
