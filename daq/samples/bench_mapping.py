"""The channels of a whole bench on the signals of its DBC, and those that trigger."""

from __future__ import annotations

from dbc import Codec

from ..bench.config import Bench
from ..errors import InputError
from .mapping import MappedChannel, map_channels
from .trigger import trigger_channels


def bench_mapping(bench: Bench, codec: Codec) -> tuple[tuple[MappedChannel, ...], frozenset[str]]:
    """Return the bench's channels, and the names of those that trigger.

    Raises InputError if a channel and the DBC do not fit, or no channel can trigger.
    """
    # All channels are mapped although only some trigger: what does not fit together is to be
    # known before the first bump, not after the last.
    mapped = map_channels(bench.channels, codec.messages, bench.dbc_name)
    triggers = frozenset(c.name for c in trigger_channels(bench.channels, bench.procedure.method))
    if not triggers:
        what, advice = "has no channel that can trigger", "add a hub or a body acceleration"
        raise InputError("bench.toml", what, advice)
    return mapped, triggers
