"""Maps the channels of a bench to the signals of its DBC, and finds those that trigger."""

from __future__ import annotations

from dbc import Codec

from ..bench.config import Bench
from ..bench.toml_file import channel_line
from ..errors import InputError
from .mapping import MappedChannel, map_channels
from .trigger import trigger_channels


def mapped_channels(bench: Bench, codec: Codec) -> tuple[MappedChannel, ...]:
    """Return the bench's channels, mapped to the signals of its DBC.

    Raises InputError, with the file and line, if a channel contradicts the DBC.
    """
    mapped: list[MappedChannel] = []
    for channel in bench.channels:
        try:
            mapped += map_channels([channel], codec.messages, bench.dbc_name)
        except InputError as error:
            line = channel_line(bench.text, channel.name)
            where = f"{bench.where}:{line}" if line else bench.where
            raise InputError(where, f"{error.where}: {error.what}", error.advice) from error
    return tuple(mapped)


def bench_mapping(bench: Bench, codec: Codec) -> tuple[tuple[MappedChannel, ...], frozenset[str]]:
    """Return the bench's channels, and the names of those that trigger.

    Raises InputError if a channel contradicts the DBC, or no channel can trigger.
    """
    # All channels are mapped although only some trigger, so that errors are found before the first
    # bump and not after the last.
    mapped = mapped_channels(bench, codec)
    triggers = frozenset(c.name for c in trigger_channels(bench.channels, bench.procedure.method))
    if not triggers:
        what, advice = "has no channel that can trigger", "add a hub or a body acceleration"
        raise InputError("bench.toml", what, advice)
    return mapped, triggers
