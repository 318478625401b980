"""`bumpbench record`, `status`, `display` and `recover`: a folder's recorder, and its journal."""

from __future__ import annotations

import getpass
import sys
import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from .. import output
from ..options import (
    BenchFile,
    DisplayAt,
    DisplayControl,
    FaultName,
    Force,
    Interface,
    InterfaceChannel,
    JsonResult,
    Operator,
    RecorderFolder,
    shared_bench,
)
from ..output import ExitCode, say

if TYPE_CHECKING:
    from ..display.link import Served


def record(
    bench: BenchFile = None,
    out: Annotated[Path, Option(help="Folder for journal and sessions.")] = Path(),
    interface: Interface = None,
    channel: InterfaceChannel = None,
    keep_on: Annotated[bool, Option("--keep-on", help="Go on after a campaign: a daemon.")] = False,
    idle: Annotated[bool, Option("--idle", help="Arm nothing: a terminal gives orders.")] = False,
    log: Annotated[Path | None, Option(help="Log to this file; default: stderr.")] = None,
    display: DisplayAt = None,
    control: DisplayControl = False,
    json: JsonResult = False,
    # The last four are for `bumpbench tui`, which starts its recorder with them.
    demo: Annotated[bool, Option("--demo", hidden=True)] = False,
    fault: Annotated[FaultName | None, Option(hidden=True)] = None,
    replay: Annotated[Path | None, Option(hidden=True)] = None,
    speed: Annotated[float, Option(min=0.1, max=20.0, hidden=True)] = 1.0,
) -> int:
    """Record a campaign: each bump becomes a run, labelled in the order of the campaign.

    Ends when the campaign is complete; Ctrl-C or SIGTERM ends it earlier, without loss.
    With --keep-on only a signal ends it, within seconds, and it waits for a missing bus.
    """
    from daq.bus.interfaces import open_source
    from daq.control.address import lone_recorder

    from ..display.link import display_beside
    from ..recorders.daemon import Lifetime, record_campaign
    from ..recorders.lines import print_outcome
    from ..recorders.log import Log
    from ..recorders.traffic import Traffic, replayed_traffic, simulated_traffic

    if replay is not None:
        traffic = replayed_traffic(replay, speed)
    elif demo:
        traffic = simulated_traffic(bench, speed, fault or "")
    else:
        traffic = Traffic(shared_bench(bench, interface, channel), open_source)
    is_replay = replay is not None
    lifetime = Lifetime(arm=not idle, keep_on=keep_on, stay=is_replay, attended=demo or is_replay)
    with (
        lone_recorder(out),
        display_beside(out, display, "display", control) as served,
        Log(log) as lines,
        output.progress("record") as stage,
    ):
        if served is not None:
            served.write()
        last = record_campaign(traffic, out, lifetime, lines, stage)
    if keep_on:
        return ExitCode.DATA_LOST if last.disk.held_frames else ExitCode.OK
    return print_outcome(last, json)


def status(folder: RecorderFolder = Path(), json: JsonResult = False) -> int:
    """Print the status of a folder's recorder; exit code 1 if none runs there."""
    from daq.control.address import control_address, unreachable_words
    from daq.control.exchange import Client, OrderRefusedError, RecorderGoneError
    from daq.control.messages import STATUS, AskStatus

    from ..recorders.lines import status_lines

    reason = "the recorder has only just started"  # and has no status yet
    try:
        with closing(Client(control_address(folder), "status", control=False)) as client:
            status_now = client.ask(AskStatus()).status
        if status_now is not None:
            if json:
                output.print_json(STATUS.dump_python(status_now, mode="json"))
            else:
                for line in status_lines(status_now):
                    output.print_line(line)
            return ExitCode.OK
    except RecorderGoneError as error:
        reason = error.what
    except OrderRefusedError as error:
        reason = str(error)
    reason = unreachable_words(folder) or (reason if folder.exists() else "there is no such folder")
    if json:
        output.print_json({"folder": str(folder), "running": False, "error": reason})
    say(f"{folder}: {reason}")
    return ExitCode.ANSWER_IS_NO


def display(
    folder: RecorderFolder = Path(),
    address: DisplayAt = "here",
    control: DisplayControl = False,
    operator: Operator = "",
    json: Annotated[bool, Option("--json", help="Link as JSON; ends with stdin.")] = False,
) -> int:
    """Show the state of a folder's recorder in one word that fills a screen.

    The page only looks on unless --control is given, and is for this machine only unless --display
    is given.
    """
    from daq import InputError
    from daq.control.address import control_address, is_running, unreachable_words
    from daq.formats.reader import optional

    optional("aiohttp", "web")
    from ..display.server import run_display

    if not folder.is_dir():
        advice = "name the folder that the recorder was started in"
        raise InputError(str(folder), "is not a folder", advice)

    def end_with_stdin(end: Callable[[], object]) -> None:
        sys.stdin.read()
        end()

    def announce(served: Served, end: Callable[[], object]) -> None:
        served.write()
        if json:  # a program started it, which says the rest
            sys.stdout.write(dumps(asdict(served)) + "\n")
            sys.stdout.flush()
            threading.Thread(target=end_with_stdin, args=(end,), daemon=True).start()
        elif not is_running(control_address(folder)):
            why = unreachable_words(folder) or "no recorder runs there"
            say(f"{folder}: {why}; the page waits for one (bumpbench record)")

    run_display(folder, address or "here", operator or getpass.getuser(), control, announce)
    if not json:
        say("the display has ended; the recorder goes on")
    return ExitCode.OK


def recover(
    journal: Annotated[list[Path], Argument(help="Segments *.bbj, or their folders.")],
    out: Annotated[Path | None, Option(help="File or folder; default: beside the journal.")] = None,
    force: Force = False,
    json: JsonResult = False,
) -> int:
    """Build the session file of each recording from its journal, and list exactly what is lost."""
    from daq import InputError
    from daq.journal.reader import recordings_of, segments_in
    from daq.session.build import derive

    segments: list[Path] = []
    for path in journal:
        in_folder = segments_in(path) or segments_in(path / "journal")
        named = list(in_folder) if path.is_dir() else [path] if path.exists() else []
        if not named:
            reason = "has no journal_*.bbj" if path.is_dir() else "there is no such file or folder"
            raise InputError(str(path), reason, "name the recorder's folder")
        segments += named
    recordings = recordings_of(segments)
    # A recording without a run gives an empty session: that is intended only if it is the only one.
    wanted = [recording for recording in recordings if recording.bumps] or list(recordings)
    targets = [] if out is None or out.is_dir() else [out]
    for recording in wanted if not targets else []:
        folder = recording.segments[0].parent
        folder = folder.parent if folder.name == "journal" else folder
        targets.append((out or folder) / recording.head.session_name)
    if len(set(targets)) < len(wanted):
        advice = "name a folder, or recover them one by one, with another --out"
        raise InputError(str(targets[0]), "would be the session of two recordings", advice)
    documents: list[dict[str, Any]] = []
    code = ExitCode.OK
    for recording, target in zip(wanted, targets, strict=True):
        derived = derive(recording.segments, target, replacing=force)
        if json:
            document = output.session_document(target, derived.session)
            facts = {"recording": recording.head.recording, "frames_recorded": recording.frames}
            documents.append({**document, **facts, "loss": derived.loss})
        else:
            output.print_session(target, derived.session, json=False)
        if derived.loss:
            code = ExitCode.DATA_LOST
            say(f"{target.name}: the journal is not whole: {derived.loss}")
    if json:
        output.print_json(documents[0] if len(documents) == 1 else {"sessions": documents})
    return code
