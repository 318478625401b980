"""The quick studies: Table 2 and the figures."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated

import typer

from ...options import JsonResult
from .deliver import FigureFile, check_figure_file, deliver
from .monte_carlo import Noise, Rate


class Response(StrEnum):
    """Ways to simulate the runs."""

    EXACT = "exact"
    WILSON = "wilson"


def table2(
    response: Annotated[
        Response, typer.Option(help="Exact discretisation, or the paper's Wilson-theta at 1 ms.")
    ] = Response.EXACT,
    json: JsonResult = False,
    figure: FigureFile = None,
) -> None:
    """Identify all parameters from noise-free simulated runs."""
    from identify.study import table2_study as study

    from ...output import progress

    check_figure_file(figure)
    with progress("table2"):
        result = study(response.value)
    deliver(result, json, figure)


def fig2(json: JsonResult = False, figure: FigureFile = None) -> None:
    """Shift the modes by 2 to 14 % of added mass."""
    from identify.study import fig2_study as study

    check_figure_file(figure)
    deliver(study(), json, figure)


def mass_error_command(name: str) -> Callable[..., None]:
    """Return the command of one of Figs. 3 to 7."""

    def command(json: JsonResult = False, figure: FigureFile = None) -> None:
        from identify.study import mass_error_study

        check_figure_file(figure)
        deliver(mass_error_study(name), json, figure)

    return command


def fig8(json: JsonResult = False, figure: FigureFile = None) -> None:
    """Mistake a, b, t_f or t_r by -5 to 5 %."""
    from identify.study import fig8_study as study

    check_figure_file(figure)
    deliver(study(), json, figure)


def fig9(
    rate_hz: Rate = 1000.0,
    noise_db: Noise = 30.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 1,
    json: JsonResult = False,
    figure: FigureFile = None,
) -> None:
    """Show the noisy signal and what a 16 Hz FIR low-pass leaves of it."""
    from identify.study import fig9_study as study

    check_figure_file(figure)
    deliver(study(rate_hz, noise_db, seed), json, figure)
