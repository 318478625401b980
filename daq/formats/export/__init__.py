"""Exports sessions to the formats of other tools."""

from .channels import CsvStyle as CsvStyle
from .export import Exported as Exported
from .export import ExportFormat as ExportFormat
from .export import chosen_runs as chosen_runs
from .export import export_session as export_session
from .export import format_of as format_of
