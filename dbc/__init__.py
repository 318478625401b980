"""CAN frames and their meaning: DBC databases, decoding, encoding, units."""

from .codec import Codec
from .database import load_codec, parse_codec, read_dbc, shipped_dbc
from .errors import BumpbenchError, InputError
from .finding import Finding, Severity
from .frames import FrameBatch, FrameFlag
from .layout import CounterRule, MessageLayout, SignalLayout
from .samples import UNUSABLE, DecodeCounts, Decoded, Quality, Samples
from .units import SiUnit, to_si

__all__ = [
    "UNUSABLE",
    "BumpbenchError",
    "Codec",
    "CounterRule",
    "DecodeCounts",
    "Decoded",
    "Finding",
    "FrameBatch",
    "FrameFlag",
    "InputError",
    "MessageLayout",
    "Quality",
    "Samples",
    "Severity",
    "SiUnit",
    "SignalLayout",
    "load_codec",
    "parse_codec",
    "read_dbc",
    "shipped_dbc",
    "to_si",
]
