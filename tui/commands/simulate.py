"""`bumpbench simulate`: the simulated car plays a campaign on any bus."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def simulate(
    bench: Annotated[
        Path | None, typer.Argument(help="bench.toml; the shipped bench if absent.")
    ] = None,
    interface: Annotated[str | None, typer.Option(help="python-can interface.")] = None,
    channel: Annotated[str | None, typer.Option(help="Channel of that interface.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Draws noise and sensor errors.")] = 1,
    fast: Annotated[bool, typer.Option(help="As fast as the bus takes the frames.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the truth as JSON.")] = False,
) -> None:
    """Play a campaign of the simulated car on a bus, frame by frame, in real time."""
    import time
    from collections.abc import Iterator
    from dataclasses import asdict

    from daq.bus import open_bus
    from daq.sim.car import SimulatedCar
    from daq.sim.ecu import campaign_frames
    from daq.sim.player import play
    from dbc import FrameBatch, parse_codec

    from ..bench import shared_bench
    from ..output import print_json, print_table, progress
    from ..result import number

    described = shared_bench(bench, interface, channel)
    codec = parse_codec(described.dbc_text, described.dbc_name)
    car = SimulatedCar()
    total = len(described.campaign.steps)
    with open_bus(described.bus) as bus, progress("simulate") as stage:

        def told() -> Iterator[FrameBatch]:
            """Yield the batches, and tell which run is being played."""
            frames = campaign_frames(described, codec, car, seed, time.time_ns())
            for done, (step, batch) in enumerate(
                zip(described.campaign.steps, frames, strict=True)
            ):
                stage(done / total, step.label)
                yield batch

        sent = 0
        for count in play(told(), bus, paced=not fast):
            sent = count
    truth = asdict(car.parameters)
    if json:
        print_json({"truth": truth, "frames": sent})
    else:
        rows = [[name, number(value)] for name, value in truth.items()]
        print_table(f"Simulated {sent} frames of this car", ["parameter", "truth"], rows)
