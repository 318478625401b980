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
        Path | None, typer.Option(help="Write the damper curves: .csv, .txt (Modelica) or .mat.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(help="Write the model: .mat, .py (python-control), .mo (Modelica), .json."),
    ] = None,
    force: Force = False,
    json: JsonResult = False,
) -> int:
    """Identify the physical parameters of a session's vehicle."""
    import daq
    import identify as method
    from daq.files import file_sha256, refuse_existing

    from ..damper_table import DAMPER_WRITERS, write_damper_table
    from ..diagnostics import require_ending
    from ..model_file import MODEL_WRITERS, write_model
    from ..output import print_json, progress

    if dampers is not None:
        require_ending(dampers, "table", DAMPER_WRITERS)
        refuse_existing(dampers, replace=force, option="--dampers", inputs=[session])
    if model is not None:
        require_ending(model, "model", MODEL_WRITERS)
        refuse_existing(model, replace=force, option="--model", inputs=[session])
    with progress("identify") as stage:
        stage(0.05, "reading")
        recorded = daq.read_session(session)
        result = method.identify(recorded, stage)
    document = result.document()
    if json:
        document["source"]["file_sha256"] = file_sha256(session)
        print_json(document)
    else:
        from ..result import print_identification

        print_identification(document, {})
    if dampers is not None:
        write_damper_table(document, dampers)
    if model is not None:
        write_model(result, model)
    return ExitCode.ANSWER_IS_NO if document["verdict"] == "refused" else ExitCode.OK
