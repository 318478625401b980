"""Refuses to replace a session by one that is of another recording, or has less than it."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import InputError
from ..session import read_foreign_session, read_session


def refuse_less(target: Path, new: Path) -> None:
    """Raise InputError if there is a file that has something that a new session has not.

    `target`: the file that would be replaced.  `new`: the new session.  A journal whose segments
    were deleted or damaged gives fewer runs, or runs with fewer frames, than it did before.
    """
    if not os.path.lexists(target):
        return
    advice = "name another file with --out, or use --force"
    try:
        before = read_foreign_session(target)
    except InputError as error:
        raise InputError(str(target), "exists already, and is no session", advice) from error
    now = read_session(new)
    if before.provenance.get("uuid") != now.provenance["uuid"]:
        raise InputError(str(target), "exists already, of another recording", advice)
    left = {run.label: len(run.frames) for run in now.runs}
    less = [run.label for run in before.runs if left.get(run.label, -1) < len(run.frames)]
    if less:
        what = f"exists already, and has more of {', '.join(less)} than the journal now"
        raise InputError(str(target), what, advice)
