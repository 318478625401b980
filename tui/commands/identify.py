"""`bumpbench identify`: computes parameters with intervals and a verdict from a session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode
from ..options import Force, JsonResult, SessionFile


def identify(
    session: SessionFile,
    dampers: Annotated[
        Path | None, typer.Option(help="Write the damper curves: .csv or .mat (MATLAB).")
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="Write the linear model: .mat (MATLAB).")
    ] = None,
    force: Force = False,
    json: JsonResult = False,
) -> int:
    """Identify the physical parameters of a session's vehicle."""
    import daq
    import identify as method
    from daq.files import file_sha256, refuse_existing

    from ..diagnostics import require_ending
    from ..model_file import DAMPER_ENDINGS, MODEL_ENDINGS, write_damper_table, write_model
    from ..output import print_json, progress

    for path, option, noun, endings in (
        (dampers, "--dampers", "table", DAMPER_ENDINGS),
        (model, "--model", "model", MODEL_ENDINGS),
    ):
        if path is not None:
            require_ending(path, noun, endings)
            refuse_existing(path, replace=force, option=option, inputs=[session])
    with progress("identify") as stage:
        stage(0.05, "reading")
        recorded = daq.read_session(session)
        result = method.identify(recorded, stage)
    if json:
        print_json(result.document(file_sha256(session)))
    else:
        from ..result import print_identification

        print_identification(result, {})
    if dampers is not None:
        write_damper_table(result, dampers)
    if model is not None:
        write_model(result, model)
    return ExitCode.ANSWER_IS_NO if result.quality.verdict == "refused" else ExitCode.OK
