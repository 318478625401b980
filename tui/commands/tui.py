"""`bumpbench tui`: the operator's terminal."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Option

from ..options import (
    BenchFile,
    DisplayAt,
    DisplayControl,
    FaultName,
    Interface,
    InterfaceChannel,
    Operator,
    shared_bench,
)
from ..output import ExitCode

if TYPE_CHECKING:
    from daq.control.messages import Setup


def tui(
    bench: BenchFile = None,
    out: Annotated[Path | None, Option(help="The recorder's folder.")] = None,
    interface: Interface = None,
    channel: InterfaceChannel = None,
    demo: Annotated[bool, Option("--demo", help="Use a simulated car, no bus.")] = False,
    fault: Annotated[FaultName | None, Option(help="Fault of --demo.")] = None,
    speed: Annotated[float, Option(min=0.1, max=20, help="Of --demo, --replay.")] = 1.0,
    replay: Annotated[Path | None, Option(help="Play a recorded session on the screens.")] = None,
    auto: Annotated[bool, Option("--auto", help="Press SPACE whenever it does something.")] = False,
    glyphs: Annotated[
        Literal["auto", "braille", "blocks"], Option(help="Characters to draw with.")
    ] = "auto",
    theme: Annotated[
        Literal["bench-dark", "bench-light", "ansi-dark", "ansi-light"], Option(help="Colours.")
    ] = "bench-dark",
    operator: Operator = "",
    display: DisplayAt = None,
    control: DisplayControl = False,
    web: Annotated[bool, Option("--web", help="Serve it to this machine's browsers.")] = False,
) -> int:
    """Run a campaign at the bench: connect to the folder's recorder, or start one.

    With --demo the folder is bumpbench-demo, with --replay bumpbench-replay, if none is named.
    The recorder goes on when the terminal is closed; a new terminal continues where you were.
    """
    from daq import InputError
    from daq.formats.reader import optional

    from ..display.link import display_beside
    from ..recorders.process import Process, start_recorder
    from ..terminal.app import BenchApp
    from ..terminal.campaign import VEHICLE_FORM, read_draft
    from ..terminal.feed import RecorderFeed
    from ..terminal.words import DisplayLink, choose_glyphs

    if demo and replay:
        raise InputError("--demo", "cannot be combined with --replay", "leave one out")
    if fault and not demo:
        raise InputError("--fault", "works on simulated runs only", "add --demo")
    if replay and not replay.is_file():
        raise InputError(str(replay), "is not a file", "name a session file")
    folder = out or Path("bumpbench-demo" if demo else "bumpbench-replay" if replay else ".")
    wanted = wanted_setup(bench, interface, channel, demo, replay)
    if web:
        optional("textual_serve", "web")
        from ..browser.server import serve

        serve([word for word in sys.argv[1:] if word != "--web"])  # the same command
        return ExitCode.OK
    # A server draws in the browser, which is its terminal.
    for stream in () if "TEXTUAL_DRIVER" in os.environ else ("stdin", "stdout", "stderr"):
        if not getattr(sys, stream).isatty():
            advice = "start it in one; `bumpbench record` and `status` need none"
            raise InputError("bumpbench tui", f"{stream} is not a terminal", advice)
    # The arguments of `bumpbench record`, which has no use for a bench or a bus in a replay.
    arguments = ["--replay", str(replay)] if replay else ["--idle"]
    arguments += [*([str(bench)] if bench else []), *(["--demo"] if demo else [])]
    options = {"--interface": interface, "--channel": channel, "--fault": fault}
    for option, value in {**options, "--speed": f"{speed:g}"}.items():
        arguments += [option, value] if value else []

    def start() -> Process:
        if not (demo or replay):
            shared_bench(bench, interface, channel)  # names a bad file here, not in a log
        return start_recorder(folder, *arguments)

    entered = read_draft(folder / VEHICLE_FORM).get("operator")  # in the vehicle form
    stored_name = entered.strip() if isinstance(entered, str) else ""
    name = operator or stored_name or ("demo" if demo else "")  # a demo need not wait for a name
    feed = RecorderFeed(folder, name or os.environ.get("USER", ""), start)
    glyph_set = choose_glyphs(glyphs, os.environ)
    with display_beside(folder, display, name, control) as served:
        link = None if served is None else DisplayLink(served.lines, served.code)
        app = BenchApp(feed, folder, glyph_set, name, theme, auto, wanted=wanted, display=link)
        feed.attach()  # after all checks of the command
        app.run()
    return app.return_code or ExitCode.OK


def wanted_setup(
    bench: Path | None, interface: str | None, channel: str | None, demo: bool, replay: Path | None
) -> Setup:
    """Return the setup that the terminal is started for.

    If no bench is named, and in a replay, any bench will do.  Raises InputError if bench, interface
    or channel is bad, also if a recorder runs already.
    """
    from daq.bench.campaign import Origin
    from daq.control.messages import Setup, setup_of

    origin = Origin.SIMULATED if demo else Origin.REPLAYED if replay else Origin.REAL
    if replay or not (bench or interface or channel):
        return Setup(origin)
    from daq.bench.config import load_bench  # it also loads the reader of databases

    described = load_bench(bench) if demo else shared_bench(bench, interface, channel)
    return replace(setup_of(described), origin=origin) if bench else Setup(origin)
