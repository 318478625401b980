"""`bumpbench demo`: does the whole job with a simulated car, through a bus and the recorder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode
from ..options import CarName

if TYPE_CHECKING:
    from threading import Event

_PATIENCE_S = 10.0
"""Seconds without a further frame after which the recorder has taken all sent frames."""


def demo(
    out: Annotated[Path, typer.Option(help="Folder for journal and session.")] = Path(
        "bumpbench-demo"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of noise and sensor errors.")] = 1,
    car: CarName = "granada",
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> int:
    """Bump a simulated car, record it on a virtual bus, identify it and compare with the truth."""
    import os
    import threading
    import time
    from dataclasses import replace

    import identify as method
    from daq import Status, bench_codec, file_sha256, load_bench, open_source
    from daq.bench import Origin, on_bus, parse_bench, with_vehicle
    from daq.bus import open_bus
    from daq.control import Phase, lone_recorder
    from daq.replay import play
    from daq.sim import GRANADA, campaign_frames, named_car, present_parameters

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

    chosen = named_car(car)
    described = load_bench(None)
    if car != GRANADA:
        text = with_vehicle(described.text, chosen.title, described.vehicle.structure)
        described = parse_bench(text, "bench.toml (shipped)", Path())
    bench = on_bus(described, "virtual", f"bumpbench-demo-{os.getpid()}")
    bench = replace(bench, origin=Origin.SIMULATED)
    simulated = chosen.simulated()
    armed, stop = threading.Event(), threading.Event()
    latest_ns = 0

    def follow(status: Status) -> None:
        nonlocal latest_ns
        latest_ns = status.t_ns
        if status.phase is not Phase.IDLE:
            armed.set()

    lifetime = Lifetime(True, False, None, lambda: bench, follow)

    def drive() -> None:
        armed.wait()
        with open_bus(bench.bus) as bus:
            frames = campaign_frames(bench, bench_codec(bench), simulated, seed, time.time_ns())
            for _ in play(frames, bus, None):
                if stop.is_set():
                    return
        _wait_for_the_last(lambda: latest_ns, stop)
        lifetime.end.set()  # a run was rejected, and the simulated car has no more bumps

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
    return ExitCode.ANSWER_IS_NO if document["verdict"] == "refused" else ExitCode.OK


def _wait_for_the_last(latest_ns: Callable[[], int], stop: Event) -> None:
    """Wait until a recorder takes no further frame; on a busy machine it lags behind the car.

    `latest_ns`: time stamp of the latest frame that it has taken.  `stop`: ends the wait.
    """
    before_ns = -1
    while (now_ns := latest_ns()) != before_ns and not stop.wait(_PATIENCE_S):
        before_ns = now_ns
