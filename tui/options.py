"""Arguments and options that several commands have; they load nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

LOG_FORMATS = "BLF, ASC, TRC, MF4, candump, CSV of python-can, or a journal"

Buses = Annotated[
    list[str] | None,
    Option("--bus", metavar="BUS", help="Only this bus: name, channel or number; repeatable."),
]

DisplayAt = Annotated[
    str | None,
    Option("--display", "--host", metavar="ADDRESS", help="Serve a display: here, lan or an IP."),
]
DisplayControl = Annotated[
    bool, Option("--control", "--display-control", help="Let the display start, reject and pause.")
]
Page = Annotated[
    Path | None, Option("--page", "--out", metavar="FILE", help="Page to write (*.html).")
]
Force = Annotated[bool, Option("--force", help="Replace existing files without a question.")]
"""The explicit word of `daq.files.refuse_existing`."""

BenchFile = Annotated[Path | None, Argument(help="bench.toml; default: the shipped bench.")]
RecorderFolder = Annotated[Path, Argument(help="The recorder's folder.")]
SessionFile = Annotated[Path, Argument(help="Session file (HDF5).")]

Interface = Annotated[
    str | None, Option(metavar="NAME", help="python-can interface; default: that of bench.toml.")
]
InterfaceChannel = Annotated[
    str | None, Option(metavar="CHANNEL", help="Its channel; default: that of bench.toml.")
]
Fast = Annotated[bool, Option("--fast", help="Send as fast as the bus takes the frames.")]
Seed = Annotated[int, Option(min=0, metavar="N", help="Seed of noise and sensor errors.")]
FaultName = Literal["double-bump", "lost-frames", "unplug"]
"""Those of `daq.sim.bench.Fault`, which is slow to load."""
Operator = Annotated[
    str, Option(metavar="NAME", help="Your name or initials, stored with every verdict.")
]

JsonResult = Annotated[bool, Option("--json", help="Print the result as JSON.")]
