"""`bumpbench demo` and `notebook`: the whole job with a simulated car; a worked example."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode
from ..options import Force, JsonResult, Seed

if TYPE_CHECKING:
    from threading import Event

    from daq import Status
    from daq.bench import Step

_PATIENCE_S = 10.0
"""Seconds without a further frame after which the recorder has taken all sent frames."""
_LOOK_S = 0.02
"""Seconds between two looks at the status."""


def demo(
    out: Annotated[Path, typer.Option(help="Folder for journal and session.")] = Path(
        "bumpbench-demo"
    ),
    seed: Seed = 1,
    json: JsonResult = False,
) -> int:
    """Bump a simulated car, record it on a virtual bus, identify it and compare with the truth."""
    import os
    import threading
    import time
    from dataclasses import replace

    import identify as method
    from daq import bench_codec, file_sha256, load_bench, open_source
    from daq.bench import Origin, on_bus
    from daq.bus import open_bus
    from daq.control import Phase, lone_recorder
    from daq.replay import play
    from daq.sim import SimulatedCar, campaign_frames, present_parameters

    from ..output import print_json, print_line, progress
    from ..recorders.daemon import Lifetime
    from ..recorders.log import Log
    from ..recorders.process import LOG
    from ..recorders.recording import (
        OpenedAtStart,
        print_summary,
        record_campaign,
        recorded_session,
    )
    from ..result import print_identification

    bench = on_bus(load_bench(None), "virtual", f"bumpbench-demo-{os.getpid()}")
    bench = replace(bench, origin=Origin.SIMULATED)
    simulated = SimulatedCar()
    armed, stop = threading.Event(), threading.Event()
    latest: list[Status] = []

    def follow(status: Status) -> None:
        latest[:] = [status]
        if status.phase is not Phase.IDLE:
            armed.set()

    lifetime = Lifetime(True, False, None, lambda: bench, follow)

    def drive() -> None:
        armed.wait()
        with open_bus(bench.bus) as bus:
            codec, steps = bench_codec(bench), due_bumps(lambda: latest[-1], stop)
            frames = campaign_frames(bench, codec, simulated, seed, time.time_ns(), steps)
            for _ in play(frames, bus, None):
                if stop.is_set():
                    return
        lifetime.end.set()  # it is complete, or the recorder waits for a decision

    driver = threading.Thread(target=drive, name="simulated car")
    with lone_recorder(out), Log(out / LOG) as lines, progress("record") as stage:
        source = OpenedAtStart(bench, open_source)
        driver.start()
        try:
            last = record_campaign(bench, source, out, lifetime, lines, stage)
        finally:
            stop.set()
            armed.set()
            driver.join()
    path, session = recorded_session(last)
    with progress("identify") as stage:
        result = method.identify(session, stage)
    truth, document = present_parameters(simulated), result.document()
    if json:
        document["source"]["file_sha256"] = file_sha256(path)
        print_json({**document, "truth": truth, "session": str(path)})
    else:
        print_summary(path, session)
        print_line()
        print_identification(document, truth)
        print_line()
        print_line("Next, to paste:")
        for command in next_commands(path):
            print_line(f"  {command}")
    return ExitCode.ANSWER_IS_NO if document["verdict"] == "refused" else ExitCode.OK


def next_commands(session: Path) -> tuple[str, str, str]:
    """Return what a new user does after a demonstration, as lines for a shell.

    `session`: its session file.  The program's name is its path where the shell does not find it.
    """
    import os
    import shlex
    import shutil
    import sys

    program = Path(sys.executable).with_name("bumpbench")
    if shutil.which(program.name):
        program = Path(program.name)
    elif program.is_relative_to(Path.cwd()):
        program = program.relative_to(Path.cwd())
    name, where = shlex.quote(str(program)), shlex.quote(os.fspath(session))
    pdf = shlex.quote(os.fspath(session.with_suffix(".pdf")))
    return (
        f"{name} report {where} --pdf {pdf}",
        f"{name} plan --from {where}",
        f"{name} tui --demo --out bumpbench-tui",
    )


def due_bumps(latest: Callable[[], Status], stop: Event) -> Iterator[Step]:
    """Yield the bump that is due as soon as the recorder has judged the one before.

    So a rejected run is repeated, as an operator repeats it.  Ends when the campaign is complete,
    the recorder has stopped the run loop, or it does not judge a run although it has all frames.

    `latest`: newest status of the recorder.  `stop`: ends the wait for it.
    """
    for bumped in count():
        status = _judged(latest, bumped, stop)
        if status is None or status.due is None or status.halted:
            return
        yield status.due.step


def _judged(latest: Callable[[], Status], bumped: int, stop: Event) -> Status | None:
    """Return the status when so many runs are judged; None if the recorder takes no more frames.

    On a busy machine it lags behind the car.
    """
    from daq.runlog import LoggedStatus

    t_ns, waited_s = -1, 0.0
    while waited_s < _PATIENCE_S:
        status = latest()
        if sum(run.status is not LoggedStatus.OPEN for run in status.runs) >= bumped:
            return status
        waited_s = waited_s + _LOOK_S if status.t_ns == t_ns else 0.0
        t_ns = status.t_ns
        if stop.wait(_LOOK_S):
            return None
    return None


def notebook(
    out: Annotated[Path, typer.Option(help="Notebook to write.")] = Path("bump_test.ipynb"),
    force: Force = False,
    json: Annotated[bool, typer.Option("--json", help="Print the file as JSON.")] = False,
) -> None:
    """Write a notebook that leads from arrays and session files to parameters and figures."""
    from importlib.resources import files

    from daq.files import refuse_existing, write_named

    from ..output import print_json, print_line

    source = files("identify") / "notebook" / "bump_test.ipynb"
    refuse_existing(out, replace=force)
    write_named(out, source.read_bytes())
    if json:
        print_json({"files": [str(out)]})
        return
    print_line(f"{out} (open it with: jupyter lab {out})")
