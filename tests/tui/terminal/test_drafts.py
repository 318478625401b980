"""Drafts: one is written at a time, the newest comes last, and none after its removal."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tui.terminal import context
from tui.terminal.context import DraftWriter
from tui.terminal.state.drafts import read_draft, write_draft


class Held:
    """Holds every write until it is let go, and notes what begins (its text) and ends (None)."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.log: list[object] = []
        self.go = threading.Event()
        monkeypatch.setattr(context, "write_draft", self._write)

    def _write(self, path: Path, values: Mapping[str, Any]) -> str:
        self.log.append(values["text"])
        assert self.go.wait(60.0)
        failure = write_draft(path, values)
        self.log.append(None)
        return failure

    async def begun(self) -> None:
        while not self.log:
            await asyncio.sleep(0.001)


async def test_texts_typed_during_a_write_follow_it_as_the_newest_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, warned = Held(monkeypatch), list[str]()
    draft = DraftWriter(tmp_path / "draft.json", warned.append)
    async with asyncio.TaskGroup() as group:
        group.create_task(draft.write({"text": "S"}))
        await held.begun()
        for text in ("SN", "SN-", "SN-0042"):
            group.create_task(draft.write({"text": text}))
            await asyncio.sleep(0)
        held.go.set()
    assert held.log == ["S", None, "SN-0042", None]
    assert read_draft(tmp_path / "draft.json") == {"text": "SN-0042"}
    assert warned == []


async def test_nothing_is_written_after_the_removal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = Held(monkeypatch)
    draft = DraftWriter(tmp_path / "draft.json", lambda _: None)
    async with asyncio.TaskGroup() as group:
        group.create_task(draft.write({"text": "S"}))
        await held.begun()
        group.create_task(draft.write({"text": "SN"}))
        await asyncio.sleep(0)
        group.create_task(draft.remove())
        await asyncio.sleep(0)
        held.go.set()
    assert held.log == ["S", None]
    assert not (tmp_path / "draft.json").exists()


async def test_a_failure_is_said_once(tmp_path: Path) -> None:
    warned: list[str] = []
    draft = DraftWriter(tmp_path / "absent" / "draft.json", warned.append)
    await draft.write({"text": "S"})
    await draft.write({"text": "SN"})
    assert warned == ["draft draft.json cannot be written: No such file or directory"]
    (tmp_path / "absent").mkdir()
    await draft.write({"text": "SN-"})
    (tmp_path / "absent" / "draft.json").unlink()
    (tmp_path / "absent").rmdir()
    await draft.write({"text": "SN-0"})
    assert len(warned) == 2
