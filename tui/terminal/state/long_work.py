"""State of long work for a screen: a fold over the lines of the worker."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from daq.errors import printable

from ...jobs.lines import Done, Item, Line, Progress, Trouble
from .glyphs import Glyphs


class Stage(StrEnum):
    """Stages of the work."""

    IDLE = "idle"
    BUILDING = "building the session file"
    WORKING = "working"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class LongWork:
    """The state of the work."""

    stage: Stage = Stage.IDLE
    session: str = ""
    """Session file that is being processed."""
    share: float = 0.0
    """Share of the work that is done, 0..1."""
    begun: tuple[str, ...] = ()
    """The parts that were begun, in order."""
    trouble: Trouble | None = None
    """Why it failed."""
    answer: dict[str, Any] = field(default_factory=dict)
    """The worker's answer."""


def after(work: LongWork, line: Line) -> LongWork:
    """Return the state after a line."""
    match line:
        case Progress(share, text):
            begun = work.begun if text in work.begun else (*work.begun, text)
            # Two processes report in any order, but a bar never goes back.
            share = max(work.share, min(1.0, share))
            return replace(work, stage=Stage.WORKING, share=share, begun=begun)
        case Done(body):
            return replace(work, stage=Stage.DONE, share=1.0, answer=body)
        case Trouble():
            return replace(work, stage=Stage.FAILED, trouble=line)
        case Item():
            return work


def bar_line(share: float, width: int, glyphs: Glyphs) -> str:
    """Return a bar with its figure."""
    cells = max(8, min(60, width - 10))
    full = round(share * cells)
    return f"[{glyphs.full * full}{glyphs.empty * (cells - full)}] {share:4.0%}"


def work_text(work: LongWork, glyphs: Glyphs, width: int) -> list[str]:
    """Return bar and stages, or the error and what to do."""
    if work.stage is Stage.FAILED and work.trouble is not None:
        trouble = work.trouble
        return [
            f"{glyphs.bad} FAILED  {printable(trouble.what, 400)}",
            f"  {printable(trouble.where)}",
            f"  What to do: {printable(trouble.advice, 300)}",
        ]
    lines = [bar_line(work.share, width, glyphs), ""]
    for i, text in enumerate(work.begun):
        done = work.stage is Stage.DONE or i < len(work.begun) - 1
        lines.append(f"  {glyphs.good if done else glyphs.now} {printable(text)}")
    return lines
