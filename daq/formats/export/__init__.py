"""Exports sessions to the formats of other tools."""

from __future__ import annotations

from .csv_files import CsvStyle
from .even_times import with_even_times
from .export import Exported, ExportFormat, chosen_runs, export_session, format_of
from .sep005 import sep005_channels
from .universal import ModeShapes

__all__ = [
    "CsvStyle",
    "ExportFormat",
    "Exported",
    "ModeShapes",
    "chosen_runs",
    "export_session",
    "format_of",
    "sep005_channels",
    "with_even_times",
]
