"""Writes the draft of a form in parallel with the messages of its screen."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from .state.drafts import remove_draft, write_draft


class DraftWriter:
    """Writes one draft at a time; of the waiting drafts, only the newest.

    A thread cannot be ended: two at once would write to one file, and the older could come last.

    `path`: file of the draft.  `warn`: shows the operator why a draft could not be written, once
    for each reason.
    """

    def __init__(self, path: Path, warn: Callable[[str], None]) -> None:
        self._path, self._warn = path, warn
        self._one_at_a_time = asyncio.Lock()
        self._newest: Mapping[str, Any] | None = None
        self._failure = ""

    async def write(self, values: Mapping[str, Any]) -> None:
        """Write a draft, unless a newer one or its removal was requested meanwhile."""
        self._newest = values
        async with self._one_at_a_time:
            if self._newest is not values:
                return
            failure = await asyncio.to_thread(write_draft, self._path, values)
        if failure and failure != self._failure:
            self._warn(failure)
        self._failure = failure

    async def remove(self) -> None:
        """Remove the draft, and those that wait to be written."""
        self._newest = None
        async with self._one_at_a_time:
            await asyncio.to_thread(remove_draft, self._path)
