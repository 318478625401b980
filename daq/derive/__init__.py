"""Derives sessions from recorded frames."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .build_session import derive as derive
    from .from_columns import bump_run as bump_run
    from .from_columns import bumps_in as bumps_in
    from .from_columns import given_run as given_run
    from .from_columns import recording as recording
    from .from_columns import session_from_columns as session_from_columns
    from .from_logs import Intake as Intake
    from .from_logs import LogPart as LogPart
    from .from_logs import labelled as labelled
    from .from_logs import numbered as numbered
    from .from_logs import parse_runs as parse_runs
    from .from_logs import session_from_parts as session_from_parts
    from .from_logs import with_steps as with_steps
    from .redecode import redecoded as redecoded
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
