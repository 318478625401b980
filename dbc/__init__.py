"""CAN frames and their meaning: databases, decoding, encoding, units."""

from .codec import UNUSABLE, Codec, DecodeCounts, MessageLayout, Quality, Samples
from .database import load_codec, parse_codec, read_dbc, shipped_dbc
from .frames import FrameBatch, FrameFlag
from .words import BumpbenchError, InputError, Severity, counted, csv_text, plural, seconds_text

__all__ = [
    "UNUSABLE",
    "BumpbenchError",
    "Codec",
    "DecodeCounts",
    "FrameBatch",
    "FrameFlag",
    "InputError",
    "MessageLayout",
    "Quality",
    "Samples",
    "Severity",
    "counted",
    "csv_text",
    "load_codec",
    "parse_codec",
    "plural",
    "read_dbc",
    "seconds_text",
    "shipped_dbc",
]
