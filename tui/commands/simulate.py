"""`bumpbench simulate`: the simulated car plays a campaign on any bus."""

from __future__ import annotations

from typing import Annotated

import typer

from ..options import BenchFile, CarName


def simulate(
    bench: BenchFile = None,
    interface: Annotated[str | None, typer.Option(help="python-can interface.")] = None,
    channel: Annotated[str | None, typer.Option(help="Channel of that interface.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of noise and sensor errors.")] = 1,
    fast: Annotated[bool, typer.Option(help="Send as fast as the bus takes the frames.")] = False,
    car: CarName = "granada",
    json: Annotated[bool, typer.Option("--json", help="Print the truth as JSON.")] = False,
) -> None:
    """Play a campaign of the simulated car, each sensor on its bus, in real time."""
    import time
    from bisect import bisect_right
    from itertools import accumulate

    from daq import bench_codec
    from daq.bus import open_buses
    from daq.replay import play
    from daq.sim import campaign_frames, named_car, present_parameters
    from identify.report import number

    from ..bench import shared_bench
    from ..output import print_json, print_table, progress

    # On a busy host the frames of a bump arrive late, and the rest after it must still be seen.
    simulated = named_car(car).simulated(tail_s=3.5)
    described = shared_bench(bench, interface, channel)
    codec = bench_codec(described)
    steps = described.campaign.steps
    with open_buses(described.buses) as (bus, *more), progress("simulate") as stage:
        batches = []
        for batch in campaign_frames(described, codec, simulated, seed, time.time_ns()):
            batches.append(batch)
            stage(0.0, f"computing run {len(batches)} of {len(steps)}")
        ends = list(accumulate(map(len, batches)))
        sent = 0
        for count in play(batches, bus, None if fast else 1.0, *more):
            sent = count
            run = min(bisect_right(ends, sent), len(steps) - 1)
            stage(sent / ends[-1], f"playing {steps[run].label}")
    truth = present_parameters(simulated)
    if json:
        print_json({"truth": truth, "frames": sent})
    else:
        rows = [[name, number(value)] for name, value in truth.items()]
        print_table(f"Simulated {sent} frames of this car", ["parameter", "truth"], rows)
