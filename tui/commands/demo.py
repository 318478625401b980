"""`bumpbench demo` and `notebook`: the whole job with a simulated car; a worked example."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from typer import Option

from .. import output
from ..options import Force, JsonResult, Seed
from ..output import ExitCode


def demo(
    out: Annotated[Path, Option(help="Folder for journal and session.")] = Path("bumpbench-demo"),
    seed: Seed = 1,
    json: JsonResult = False,
) -> int:
    """Bump a simulated car, record it, identify it and compare with the truth."""
    from daq import InputError
    from daq.control.address import lone_recorder
    from daq.control.messages import Status
    from daq.files import file_sha256
    from daq.journal.reader import recordings
    from daq.sim.car import SimulatedCar
    from identify import identify as identify_session

    from ..recorders.daemon import Lifetime, record_campaign
    from ..recorders.lines import recorded_session
    from ..recorders.log import Log
    from ..recorders.process import LOG
    from ..recorders.traffic import simulated_traffic
    from ..result import print_identification

    campaigns = [each for each in recordings(out / "journal") if each.head.campaign]
    if campaigns and not campaigns[-1].ended:  # the recorder would go on in the middle of it
        raise InputError(str(out), "holds a campaign that was interrupted", "name another --out")
    traffic = simulated_traffic(None, 20.0, "", seed)  # times real time; without a fault
    lifetime = Lifetime(arm=True, keep_on=False)

    def follow(status: Status) -> None:
        if traffic.follow is not None:
            traffic.follow(status)
        if status.halted:  # the recorder waits for a decision, and no person is here
            lifetime.end.set()

    with lone_recorder(out), Log(out / LOG) as log, output.progress("record") as stage:
        last = record_campaign(replace(traffic, follow=follow), out, lifetime, log, stage)
    path, session = recorded_session(last)
    with output.progress("identify") as stage:
        result = identify_session(session, stage)
    truth = asdict(SimulatedCar().parameters)
    if json:
        document = result.document(file_sha256(path))
        output.print_json({**document, "truth": truth, "session": str(path)})
    else:
        output.print_session(path, session, json=False)
        output.print_line()
        print_identification(result, truth)
        output.print_line()
        output.print_line("Next, to paste:")
        for command in next_commands(path):
            output.print_line(f"  {command}")
    return ExitCode.ANSWER_IS_NO if result.quality.verdict == "refused" else ExitCode.OK


def next_commands(session: Path) -> tuple[str, str, str]:
    """Return what a new user does with the session of a demonstration, as lines for a shell."""
    program = Path(sys.executable).with_name("bumpbench")
    paths = (program, session, session.with_suffix(".pdf"))
    name, where, pdf = (shlex.quote(str(path)) for path in paths)
    return (
        f"{name} report {where} --pdf {pdf}",
        f"{name} plan --from {where}",
        f"{name} tui --demo --out bumpbench-tui",
    )


def notebook(
    out: Annotated[Path, Option(help="Notebook to write.")] = Path("bump_test.ipynb"),
    force: Force = False,
    json: JsonResult = False,
) -> None:
    """Write a notebook that leads from arrays and session files to parameters and figures."""
    from daq.files import refuse_existing, write_named

    source = files("identify") / "notebook" / "bump_test.ipynb"
    refuse_existing(out, replace=force)
    write_named(out, source.read_bytes())
    if json:
        output.print_json({"files": [str(out)]})
        return
    output.print_line(f"{out} (open it with: jupyter lab {out})")
