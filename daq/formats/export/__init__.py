"""Exports sessions to the formats of other tools."""

from .even_times import with_even_times
from .export import Exported, ExportFormat, chosen_runs, export_session, format_of
from .tables import CsvStyle
from .universal import ModeShapes

__all__ = [
    "CsvStyle",
    "ExportFormat",
    "Exported",
    "ModeShapes",
    "chosen_runs",
    "export_session",
    "format_of",
    "with_even_times",
]
