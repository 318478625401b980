"""`bumpbench recover`: builds session files from a journal, after a crash or again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..diagnostics import ExitCode
from ..options import Force, JsonSummary

if TYPE_CHECKING:
    from collections.abc import Sequence

    from daq.journal.reader import RecordingInfo

_WHAT_TO_NAME = "name the recorder's folder"


def recover(
    journal: Annotated[
        list[Path], typer.Argument(help="Segments journal_*.bbj, or a folder with segments.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Session file or folder to write; default: session_NNNN.h5 next to the journal."
        ),
    ] = None,
    force: Force = False,
    json: JsonSummary = False,
) -> int:
    """Build the session file of each recording from its journal, and list exactly what is lost."""
    from daq.journal.reader import recordings_of
    from daq.session.build import derive

    from ..diagnostics import say
    from ..output import print_json
    from ..recorders.recording import print_summary, summary

    segments = _segments(journal)
    found = recordings_of(segments)
    # A recording without a run gives an empty session: that is intended only if it is the only one.
    wanted = [info for info in found if info.bumps] or list(found)
    documents: list[dict[str, Any]] = []
    lost = False
    for info, target in zip(wanted, _targets(wanted, out), strict=True):
        derived = derive(info.segments, target, replacing=force)
        if json:
            account = {"recording": info.head.recording, "frames_recorded": info.frames}
            documents.append({**summary(target, derived.session), **account, "loss": derived.loss})
        else:
            print_summary(target, derived.session)
        if derived.loss:
            lost = True
            say(f"{target.name}: the journal is not whole: {derived.loss}")
    if json:
        print_json(documents[0] if len(documents) == 1 else {"sessions": documents})
    return ExitCode.DATA_LOST if lost else ExitCode.OK


def _segments(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Return the named segments, and those in named folders."""
    from daq import InputError
    from daq.journal.reader import segments_in

    segments: list[Path] = []
    for path in paths:
        if not path.is_dir():
            if not path.exists():
                raise InputError(str(path), "there is no such file or folder", _WHAT_TO_NAME)
            segments.append(path)
            continue
        inside = segments_in(path) or segments_in(path / "journal")
        # What Bumpbench 0.1 has recorded is refused in its own words.
        inside = inside or tuple(path.glob("**/journal_*.mcap"))
        if not inside:
            raise InputError(str(path), "has no journal_*.bbj", _WHAT_TO_NAME)
        segments += inside
    return tuple(segments)


def _targets(recordings: Sequence[RecordingInfo], out: Path | None) -> list[Path]:
    """Return a session file for each recording."""
    from daq import InputError

    if out is not None and not out.is_dir():
        if len(recordings) == 1:
            return [out]
        what = f"there are {len(recordings)} recordings for one file"
        raise InputError(str(out), what, "name a folder that is there, or segments of one")
    targets = []
    for info in recordings:
        first = info.segments[0]
        folder = first.parent.parent if first.parent.name == "journal" else first.parent
        targets.append((out or folder) / info.session_name)
    for target in targets:
        if targets.count(target) > 1:
            what = "would be the session of two recordings"
            raise InputError(str(target), what, "recover them one by one, with another --out")
    return targets
