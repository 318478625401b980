"""Asks for a format and exports a session in it."""

from __future__ import annotations

from contextlib import aclosing
from glob import escape
from pathlib import Path

from textual.app import App

from daq.errors import printable

from ...jobs.lines import Done, ExportTask, Trouble
from ...jobs.worker import lines_of
from .dialogs import ChoiceScreen, Confirm

FORMATS = (
    ("mf4", "MF4      measurement tools: asammdf, CANape"),
    ("mat", "MAT      MATLAB, Octave, SciPy"),
    ("uff", "UFF      modal analysis tools"),
    ("csv", "CSV      tables, one a run and sample clock"),
    ("parquet", "Parquet  data frames"),
    ("blf", "BLF      raw frames: CANalyzer, SavvyCAN"),
    ("asc", "ASC      raw frames as text"),
    ("log", "candump  raw frames as candump -l has them"),
)


async def export_session(app: App[None], path: str) -> None:
    """Ask for the format, export in a worker process and show the files; needs a Textual worker."""
    name = printable(Path(path).name, 40)
    form = await app.push_screen_wait(ChoiceScreen(f"Export {name} as", FORMATS))
    if form is None:
        return
    there = _existing(Path(path), form)
    if there is not None:
        words = f"{printable(there.name, 40)} exists already: replace it?"
        if not await app.push_screen_wait(Confirm(words, "yes, replace", "no, keep it")):
            return
    app.notify(f"exporting {name} as {form}", markup=False)
    async with aclosing(lines_of(ExportTask(path, form, there is not None), name)) as lines:
        async for line in lines:
            if isinstance(line, Trouble):
                app.notify(line.text, severity="error", markup=False)
            elif isinstance(line, Done):
                paths = [printable(str(item)) for item in line.body["paths"]]
                more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
                app.notify(
                    "\n".join([f"written: {paths[0]}{more}", *line.body["notes"]]), markup=False
                )


def _existing(session: Path, form: str) -> Path | None:
    """Return the export of a session that is there already; None if there is none."""
    from daq.formats import ExportFormat  # with all writers, which few need

    if form == ExportFormat.CSV:  # a file for each run and sample clock
        return next(session.parent.glob(f"{escape(session.stem)}_*.csv"), None)
    place = session.with_suffix(ExportFormat(form).suffix)
    return place if place.exists() else None
