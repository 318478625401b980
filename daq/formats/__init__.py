"""Reads and writes logs and files of other tools, one module for each format."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .columns import read_columns as read_columns
    from .export import CsvStyle as CsvStyle
    from .export import ExportFormat as ExportFormat
    from .export import ModeShapes as ModeShapes
    from .export import chosen_runs as chosen_runs
    from .export import export_session as export_session
    from .export import format_of as format_of
    from .export import with_even_times as with_even_times
    from .log import Log as Log
    from .log import read_logs as read_logs
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
