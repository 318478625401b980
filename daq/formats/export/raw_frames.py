"""Collects the raw frames of a session's runs to one log."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, FrameFlag
from dbc.words import counted

from ...errors import InputError
from ...sessions import Session
from ..description import FrameSpan


def session_frames(session: Session) -> FrameBatch:
    """Return all raw frames of a session in order of time; frames in two runs only once.

    Raises InputError if the session has none.
    """
    batches = [run.frames for run in session.runs if len(run.frames)]
    if not batches:
        what = "its runs hold no raw frames"
        raise InputError("session", what, "export the decoded channels: mf4, mat, csv, parquet")
    frames = FrameBatch.concatenate(batches).by_time()
    spans = sorted((int(batch.t_ns.min()), int(batch.t_ns.max())) for batch in batches)
    if any(first[1] >= second[0] for first, second in pairwise(spans)):
        frames = frames.select(_first_of_each(frames))
    return frames


def frame_spans(session: Session, frames: FrameBatch) -> Mapping[str, FrameSpan]:
    """Return the span of each run in these frames, by label; without runs that have no frames.

    `frames`: as `session_frames` returns them.
    """
    spans = {}
    for run in session.runs:
        if len(run.frames):
            first_ns, last_ns = int(run.frames.t_ns.min()), int(run.frames.t_ns.max())
            first = int(np.searchsorted(frames.t_ns, first_ns, "left"))
            stop = int(np.searchsorted(frames.t_ns, last_ns, "right"))
            spans[run.label] = FrameSpan(first, stop - first, first_ns)
    return spans


def _first_of_each(frames: FrameBatch) -> NDArray[np.intp]:
    columns = (frames.t_ns, frames.can_id, frames.flags, frames.bus, frames.length)
    rows = [column.reshape(-1, 1).view(np.uint8) for column in columns]
    whole = np.ascontiguousarray(np.hstack([*rows, frames.data]))
    keys = whole.view(np.dtype((np.void, whole.shape[1]))).ravel()
    return np.sort(np.unique(keys, return_index=True)[1])


def frames_left_out(session: Session) -> tuple[str, ...]:
    """Return the note on raw frames for a format that holds only decoded channels."""
    count = sum(len(run.frames) for run in session.runs)
    frames = counted(count, "raw frame is", "raw frames are")
    return (f"{frames} left out: use mf4, blf, asc or log",) if count else ()


def has(frames: FrameBatch, flag: FrameFlag) -> NDArray[np.bool_]:
    """Return a mask of the frames that have a flag, (n,)."""
    return np.asarray(frames.flags & flag != 0, np.bool_)
