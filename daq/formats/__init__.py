"""Reads and writes logs and files of other tools, one module for each format."""

from .columns import read_columns as read_columns
from .export import CsvStyle as CsvStyle
from .export import ExportFormat as ExportFormat
from .export import chosen_runs as chosen_runs
from .export import export_session as export_session
from .export import format_of as format_of
from .log import Log as Log
from .log import read_log as read_log
from .log import read_logs as read_logs
