"""`bumpbench demo`: the whole job against a simulated car, through a bus and the recorder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode


def demo(
    out: Annotated[Path, typer.Option(help="Folder for journal and session.")] = Path(
        "bumpbench-demo"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Draws noise and sensor errors.")] = 1,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> int:
    """Bump a simulated car, record it over a virtual bus, identify it, and show the truth."""
    import os
    import threading
    import time
    from dataclasses import asdict

    import identify as method
    from daq.bus import open_bus, open_source
    from daq.config import bench_codec, load_bench, on_bus
    from daq.replay import play
    from daq.sim.car import SimulatedCar
    from daq.sim.ecu import campaign_frames

    from ..output import print_json, print_line, progress
    from ..recording import print_summary, record_session
    from ..result import identification_document, print_identification

    bench = on_bus(load_bench(None), "virtual", f"bumpbench-demo-{os.getpid()}")
    car = SimulatedCar()
    codec = bench_codec(bench)
    source = open_source(bench.bus, 0)
    stop = threading.Event()

    def drive() -> None:
        with open_bus(bench.bus) as bus:
            frames = campaign_frames(bench, codec, car, seed, time.time_ns())
            for _ in play(frames, bus, None):
                if stop.is_set():
                    return

    driver = threading.Thread(target=drive, name="simulated car")
    driver.start()
    try:
        with progress("record") as stage:
            path, session = record_session(bench, source, out, stop, stage)
    finally:
        stop.set()
        driver.join()
    with progress("identify") as stage:
        result = method.identify(session, stage)
    truth = asdict(car.parameters)
    if json:
        document = identification_document(result)
        print_json({**document, "truth": truth, "session": str(path)})
    else:
        print_summary(path, session)
        print_line()
        print_identification(result, truth)
    return ExitCode.ANSWER_IS_NO if result.quality.verdict == "refused" else ExitCode.OK
