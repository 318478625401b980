"""`bumpbench tui`: the operator's terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..diagnostics import ExitCode, unknown_value
from ..options import BenchFile, DisplayAt, DisplayControl, Interface, InterfaceChannel, Operator

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable

    from daq.control.messages import Setup

FAULTS = ("double-bump", "overload", "frozen", "lost-frames", "weak", "wrong-mode", "unplug")


def tui(
    bench: BenchFile = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the recorder; default: the present one, bumpbench-demo with --demo,"
            " bumpbench-replay with --replay."
        ),
    ] = None,
    interface: Interface = None,
    channel: InterfaceChannel = None,
    demo: Annotated[
        bool, typer.Option("--demo", help="Use a simulated car instead of a bus.")
    ] = False,
    fault: Annotated[
        str | None,
        typer.Option(
            help="Fault of --demo: double-bump, overload, frozen, lost-frames, weak, wrong-mode, "
            "unplug."
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option(min=0.1, max=20.0, help="Speed of --demo or --replay, times real time.")
    ] = 1.0,
    replay: Annotated[
        Path | None, typer.Option(help="Play a recorded session through the same screens.")
    ] = None,
    auto: Annotated[
        bool, typer.Option("--auto", help="Press SPACE whenever there is a next action.")
    ] = False,
    glyphs: Annotated[
        Literal["auto", "braille", "blocks", "ascii"], typer.Option(help="Characters to draw with.")
    ] = "auto",
    theme: Annotated[str, typer.Option(help="Colours: bench-dark, bench-light, ansi-dark, ...")] = (
        "bench-dark"
    ),
    operator: Operator = "",
    display: DisplayAt = None,
    control: DisplayControl = False,
    web: Annotated[
        bool, typer.Option("--web", help="Serve the terminal to browsers of this machine.")
    ] = False,
) -> int:
    """Run a campaign at the bench: connect to the folder's recorder, or start one.

    The recorder goes on when the terminal is closed; a new terminal continues where you were.
    """
    import os
    import sys

    from ..display.start import display_beside_terminal
    from ..terminal.app import BenchApp
    from ..terminal.feed import RecorderFeed
    from ..terminal.words import choose_glyphs

    _check_options(demo, fault, replay)
    wanted = _wanted(bench, interface, channel, demo, replay)
    if web:
        return _serve(sys.argv[1:])
    _check_terminal()
    folder = out or Path("bumpbench-demo" if demo else "bumpbench-replay" if replay else ".")
    check_fault(folder, fault)
    start = _starter(folder, bench, (interface, channel), demo, fault, speed, replay)
    name = operator or known_operator(folder, demo)
    feed = RecorderFeed(folder, name or os.environ.get("USER", ""), start)
    chosen = choose_glyphs(glyphs, os.environ, sys.stdout.encoding or "")
    with display_beside_terminal(folder, display, name, control) as link:
        app = BenchApp(feed, folder, chosen, name, theme, auto, wanted=wanted, display=link)
        feed.attach()  # after all checks of the command
        app.run()
    return app.return_code or ExitCode.OK


def known_operator(folder: Path, demo: bool) -> str:
    """Return the operator of the vehicle form in this folder; else "demo" for a demo, else ""."""
    from ..terminal.campaign import VEHICLE_FORM, read_draft

    entered = read_draft(folder / VEHICLE_FORM).get("operator")
    name = entered.strip() if isinstance(entered, str) else ""
    return name or ("demo" if demo else "")  # a demo need not wait for a name


def _check_terminal() -> None:
    """Raise InputError without a terminal to draw on, before a recorder is started."""
    import os
    import sys

    from daq import InputError

    if "TEXTUAL_DRIVER" in os.environ:  # a server draws in the browser, which is its terminal
        return
    for name in ("stdin", "stdout", "stderr"):
        if not getattr(sys, name).isatty():
            advice = "start it in one; `bumpbench record` and `status` need none"
            raise InputError("bumpbench tui", f"{name} is not a terminal", advice)


def check_fault(folder: Path, fault: str | None) -> None:
    """Raise InputError for a fault if a recorder already runs: it would ignore the fault."""
    from daq import InputError
    from daq.control.address import control_address, is_running

    if fault and is_running(control_address(folder)):
        why = f"a recorder already runs in {folder} and cannot take a fault"
        advice = "leave --fault out to attach to it, or name another folder with --out"
        raise InputError(f"--fault {fault}", why, advice)


def _check_options(demo: bool, fault: str | None, replay: Path | None) -> None:
    """Raise InputError for options that do not fit together."""
    from daq import InputError

    if demo and replay:
        raise InputError("--demo", "cannot be combined with --replay", "leave one out")
    if fault and not demo:
        raise InputError("--fault", "works on simulated runs only", "add --demo")
    if fault and fault not in FAULTS:
        raise unknown_value("--fault", fault, "fault", FAULTS)
    if replay:
        _check_is_there(replay)


def _wanted(
    bench: Path | None, interface: str | None, channel: str | None, demo: bool, replay: Path | None
) -> Setup:
    """Return the setup that the terminal is started for; parts that are not named are open.

    Raises InputError if the bench that is named is bad, also if a recorder runs already.
    """
    from dataclasses import replace

    from daq.bench.campaign import Origin
    from daq.control.messages import Setup, setup_of

    origin = Origin.SIMULATED if demo else Origin.REPLAYED if replay else Origin.REAL
    if replay or not (bench or interface or channel):
        return Setup(origin)
    from daq.bench.config import load_bench  # it also loads the reader of databases

    from ..bench import shared_bench

    if demo:
        return replace(setup_of(load_bench(bench)), origin=origin, buses=None)
    setup = setup_of(shared_bench(bench, interface, channel))
    return setup if bench else Setup(origin, buses=setup.buses)


def _starter(
    folder: Path,
    bench: Path | None,
    bus: tuple[str | None, str | None],
    demo: bool,
    fault: str | None,
    speed: float,
    replay: Path | None,
) -> Callable[[], subprocess.Popen[bytes]]:
    """Return a function that starts the wanted recorder."""
    from ..recorders.process import start_demo_recorder, start_recorder, start_replay_recorder

    if demo:
        return lambda: start_demo_recorder(folder, speed, fault or "", bench=bench)
    if replay:
        return lambda: start_replay_recorder(folder, replay, speed)

    def start() -> subprocess.Popen[bytes]:
        from ..bench import shared_bench

        shared_bench(bench, *bus)  # reports a bad file here, not in a log
        return start_recorder(bench, folder, *bus)

    return start


def _check_is_there(path: Path) -> None:
    from daq import InputError

    if not path.is_file():
        raise InputError(str(path), "is not a file", "name a session file")


def _serve(arguments: list[str]) -> int:
    """Serve the same command, without --web, to browsers."""
    from daq import InputError

    try:
        from ..browser.server import serve
    except ImportError as error:
        raise InputError(
            "--web", "textual-serve is not installed", "install bumpbench[web]"
        ) from error
    serve([argument for argument in arguments if argument != "--web"])
    return ExitCode.OK
