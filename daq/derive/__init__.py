"""Sessions derived from recorded frames."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .build_session import derive as derive
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
