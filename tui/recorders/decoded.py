"""Makes a session from files with decoded channels, for `import --channels`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING

from dbc import counted, plural

from ..diagnostics import ExitCode, say
from ..output import Stage, print_session, progress

if TYPE_CHECKING:
    from daq import Run, Session
    from daq.bench.campaign import Step
    from daq.bench.channel_map import ChannelMap


def import_channels(
    channel_map: Path,
    files: Sequence[Path],
    singles: Sequence[tuple[tuple[str, str], Path]],
    runs: str | None,
    skip: int,
    out: Path,
    force: bool,
    json: bool,
) -> int:
    """Find or cut the runs in files of channels, and write a session.

    `files`: files with many runs each.  `singles`: instead of these, files of one run with mass
    state and excitation.  `runs`: kinds of the bumps in order, instead of those of the campaign.
    `skip`: number of bumps to leave out at the beginning.
    `force`: True to replace an existing session.
    """
    from daq import InputError, write_session
    from daq.bench.channel_map import load_channel_map
    from daq.files import refuse_existing
    from daq.session.from_frames import numbered, parse_runs, with_steps

    if bool(singles) == bool(files):
        what = "names both files and --run" if files else "names no file"
        raise InputError("import", what, "name files, or --run MASS_STATE:EXCITATION:FILE each")
    labels = [label for label, _ in singles]
    files = files or [path for _, path in singles]
    known = load_channel_map(channel_map)
    if known.runs and (labels or runs or skip or len(files) > 1):
        what = "states the times of its runs"
        advice = "name one file, and no --run, --runs or --skip"
        raise InputError(str(channel_map), what, advice)
    refuse_existing(out, replace=force, inputs=[channel_map, *files])
    stated = numbered(labels) if labels else parse_runs(runs) if runs else ()
    steps = stated or known.bench.campaign.steps
    known = replace(known, bench=with_steps(known.bench, steps))
    with progress("import") as stage:
        unread: list[str] = []
        session, bumps = _session(known, files, bool(labels), steps, skip, stage, unread)
        stage(1.0, "writing the session")
        write_session(out, session)
    print_session(out, session, json, bumps=bumps, planned=len(steps))
    for line in (
        *left_out_remarks(bumps, len(session.runs), 0 if known.runs else len(steps)),
        *sign_remarks(session),
        *unread,
    ):
        say(line)
    return ExitCode.DATA_LOST if unread else ExitCode.OK


def file_facts(path: Path) -> dict[str, str | int]:
    """Return the facts on an imported file that the session stores."""
    from daq.files import file_sha256

    return {"name": path.name, "bytes": path.stat().st_size, "sha256": file_sha256(path)}


def left_out_remarks(bumps: int, runs: int, planned: int) -> list[str]:
    """Return remarks on bumps that are not runs, and on planned runs without a bump."""
    remarks = []
    if bumps > runs:
        were = plural(bumps - runs, "was", "were")
        remarks.append(f"{bumps - runs} of {bumps} bumps {were} left out (see --runs and --skip)")
    if runs < planned:
        remarks.append(f"{runs} of {planned} planned runs {plural(runs, 'was', 'were')} found")
    return remarks


def sign_remarks(session: Session) -> list[str]:
    """Return remarks on the channels of imported runs whose sign is wrong, with advice."""
    from daq.check.signs import opposed_signs

    return [f"{f.text} ({f.advice})" for f in opposed_signs(session.runs, session.channels)]


def _session(
    known: ChannelMap,
    files: Sequence[Path],
    apart: bool,
    steps: Sequence[Step],
    skip: int,
    stage: Stage,
    unread: list[str],
) -> tuple[Session, int]:
    """Return the session that files contain, and the number of bumps in them.

    `unread`: gets what could not be read.
    """
    from importlib.metadata import version

    from daq import InputError
    from daq.formats.columns import read_columns
    from daq.session.from_columns import (
        bump_run,
        bumps_in,
        given_run,
        recording,
        session_from_columns,
    )

    runs: list[Run] = []
    about = {"software": f"bumpbench {version('bumpbench')}"}
    bumps = 0
    for number, path in enumerate(files):
        stage(number / len(files), f"{path.name}, {counted(bumps, 'bump')}")
        columns = read_columns(path, known.columns)
        unread += [f"{path} is not whole: {what}" for what in columns.unread]
        samples = recording(known, columns)
        about[f"source_{number + 1}"] = dumps({"format": "channels", "files": [file_facts(path)]})
        if known.runs:
            runs += [given_run(known, samples, given) for given in known.runs]
            continue
        onsets = bumps_in(known, samples)
        if not onsets and (apart or len(files) == 1):
            what = "no channel leaves its rest as a bump does"
            raise InputError(str(path), what, "see [trigger], or give the times in [[run]]")
        first = number if apart else bumps - skip
        for place, bump in enumerate(onsets[:1] if apart else onsets, start=first):
            if 0 <= place < len(steps):
                runs.append(bump_run(known, samples, steps[place], bump))
        bumps += len(onsets)
    if not runs:
        raise InputError("import", "no bump is left to be a run", "correct --skip or --runs")
    return session_from_columns(known, samples.channels, runs, about), bumps
