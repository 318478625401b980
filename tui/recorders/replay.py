"""Runs a recorder on a recorded session, which the operator's terminal shows as if it were live.

``python -m tui.recorders.replay FOLDER SESSION --speed 1``
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ..invocation import invoke

commands = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@commands.command()
def replay_recorder(
    folder: Annotated[Path, typer.Argument(help="Folder for journal and sessions.")],
    session: Annotated[Path, typer.Argument(help="A session file.")],
    speed: Annotated[float, typer.Option(min=0.1, max=20.0, help="Times real time.")] = 1.0,
    log: Annotated[Path | None, typer.Option(help="Log to this file.")] = None,
) -> None:
    """Play a session's frames to an armed recorder, which judges each bump anew."""
    import time
    from dataclasses import replace

    from daq import InputError, read_session
    from daq.bench.campaign import Origin
    from daq.bench.config import BusConfig, parse_bench
    from daq.bus.source import FrameSource
    from daq.control.lock import lone_recorder
    from daq.replay.recorded_source import RecordedSource, whole_frames

    from ..output import progress
    from .daemon import Lifetime
    from .log import Log
    from .recording import record_campaign

    played = read_session(session)
    if not {"bench_toml", "dbc"} <= played.provenance.keys():
        what = "does not hold its bench.toml and DBC: it was not recorded from a bus"
        raise InputError(str(session), what, "name a session that a recorder made")
    frames = whole_frames(played, session)
    about = played.provenance
    bench = parse_bench(about["bench_toml"], str(session), Path(), dbc_text=about["dbc"])
    # The bus has no driver: it reports its end and is not opened again.
    buses = tuple(BusConfig("virtual", f"session{i}", b.bitrate) for i, b in enumerate(bench.buses))
    bench = replace(bench, buses=buses, origin=Origin.REPLAYED)

    def open_source(bus: BusConfig, number: int) -> FrameSource:
        return RecordedSource(frames, number, speed, time.time_ns())

    lifetime = Lifetime(True, True, None, lambda: bench, stay=True, attended=True)
    with lone_recorder(folder), Log(log) as lines, progress("replay") as stage:
        record_campaign(bench, open_source, folder, lifetime, lines, stage)


if __name__ == "__main__":
    sys.exit(invoke(sys.argv[1:], commands))
