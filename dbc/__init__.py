"""CAN frames and their meaning: DBC databases, decoding, encoding, units.

Public names are loaded at their first use: code that needs only an error or a finding loads neither
the grammar of databases nor NumPy.
"""

from typing import TYPE_CHECKING

from .lazy import lazy

if TYPE_CHECKING:
    from .codec import Codec as Codec
    from .database import load_codec as load_codec
    from .database import parse_codec as parse_codec
    from .database import read_dbc as read_dbc
    from .database import shipped_dbc as shipped_dbc
    from .database import split_by_bus as split_by_bus
    from .errors import BumpbenchError as BumpbenchError
    from .errors import InputError as InputError
    from .finding import Finding as Finding
    from .finding import Severity as Severity
    from .frames import FrameBatch as FrameBatch
    from .frames import FrameFlag as FrameFlag
    from .layout import CounterRule as CounterRule
    from .layout import MessageLayout as MessageLayout
    from .layout import SignalLayout as SignalLayout
    from .samples import UNUSABLE as UNUSABLE
    from .samples import DecodeCounts as DecodeCounts
    from .samples import Decoded as Decoded
    from .samples import Quality as Quality
    from .samples import Samples as Samples
    from .units import SiUnit as SiUnit
    from .units import to_si as to_si
    from .words import counted as counted
    from .words import csv_text as csv_text
    from .words import plural as plural
    from .words import seconds_text as seconds_text
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
