"""`bumpbench simulate`: the simulated car plays a campaign on any bus, or is pushed by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from ..options import BenchFile, CarName, Fast, Interface, InterfaceChannel, Seed

if TYPE_CHECKING:
    from daq import Bench
    from daq.sim import SimulatedCar


def simulate(
    bench: BenchFile = None,
    interface: Interface = None,
    channel: InterfaceChannel = None,
    seed: Seed = 1,
    fast: Fast = False,
    push: Annotated[
        float | None,
        typer.Option(
            help="No campaign: stand still for these seconds, then be pushed down at each corner"
            " and kicked against its tyre; then stand still until Ctrl-C.",
            min=0,
            max=600,
        ),
    ] = None,
    car: CarName = "granada",
    json: Annotated[bool, typer.Option("--json", help="Print the truth as JSON.")] = False,
) -> None:
    """Play a campaign of the simulated car, each sensor on its bus, in real time."""
    import time
    from bisect import bisect_right
    from itertools import accumulate

    from daq import InputError, bench_codec
    from daq.bus import open_buses
    from daq.replay import play
    from daq.sim import campaign_frames, named_car, present_parameters
    from dbc import counted
    from identify.report import number

    from ..bench import shared_bench
    from ..output import print_json, print_table, progress

    if push is not None and (fast or json):
        raise InputError("--push", "goes on until Ctrl-C, in real time", "leave out the rest")
    # On a busy host the frames of a bump arrive late, and the rest after it must still be recorded.
    simulated = named_car(car).simulated(tail_s=3.5)
    described = shared_bench(bench, interface, channel)
    if push is not None:
        _push(described, simulated, seed, push)
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
        print_table(f"Simulated {counted(sent, 'frame')} of this car", ["parameter", "truth"], rows)


def _push(bench: Bench, car: SimulatedCar, seed: int, rest_s: float) -> None:
    """Play rest and pushes until the command is interrupted."""
    import time

    from daq import bench_codec
    from daq.bus import open_buses
    from daq.replay import play
    from daq.sim import PUSHES_S, push_frames

    from ..output import progress

    frames = push_frames(bench, bench_codec(bench), car, seed, time.time_ns(), rest_s)
    begun_s = time.monotonic()
    with open_buses(bench.buses) as (bus, *more), progress("simulate") as stage:
        for _ in play(frames, bus, 1.0, *more):
            left_s = begun_s + rest_s - time.monotonic()
            share = -left_s / PUSHES_S
            if left_s > 0:
                stage(0.0, f"at rest, pushed in {left_s:.0f} s")
            elif share < 1:
                stage(share, "pushed at each corner, each tyre kicked")
            else:
                stage(1.0, "at rest: Ctrl-C ends it")
