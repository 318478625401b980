"""Arguments and options that several commands have; they load nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

Buses = Annotated[
    list[str] | None,
    typer.Option(
        "--bus",
        metavar="BUS",
        help="Only this bus: its name, channel or number from 0; repeatable.",
    ),
]
"""Buses of the bench."""

DisplayAt = Annotated[
    str | None,
    typer.Option(
        "--display",
        "--host",
        metavar="ADDRESS",
        help="Serve a display: here (this machine's browsers), lan, or an address to listen on.",
    ),
]
DisplayControl = Annotated[
    bool,
    typer.Option(
        "--control",
        "--display-control",
        help="Let the display start, reject and pause, for a number shown with its link.",
    ),
]
Page = Annotated[
    Path | None, typer.Option("--page", "--out", metavar="FILE", help="Page to write (*.html).")
]
"""The page of a report."""
Force = Annotated[bool, typer.Option("--force", help="Replace existing files without a question.")]
"""The explicit word of `daq.files.refuse_existing`."""

BenchFile = Annotated[Path | None, typer.Argument(help="bench.toml; default: the shipped bench.")]
RecorderFolder = Annotated[Path, typer.Argument(help="The recorder's folder.")]
SessionFile = Annotated[Path, typer.Argument(help="Session file (HDF5).")]

Interface = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="python-can interface; default: that of bench.toml."),
]
InterfaceChannel = Annotated[
    str | None,
    typer.Option(metavar="CHANNEL", help="Channel of that interface; default: that of bench.toml."),
]
Fast = Annotated[bool, typer.Option("--fast", help="Send as fast as the bus takes the frames.")]
Seed = Annotated[int, typer.Option(min=0, metavar="N", help="Seed of noise and sensor errors.")]
FaultName = Literal["double-bump", "lost-frames", "unplug"]
"""Those of `daq.sim.bench.Fault`, which is slow to load."""
Operator = Annotated[
    str, typer.Option(metavar="NAME", help="Your name or initials, stored with every verdict.")
]

JsonResult = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
