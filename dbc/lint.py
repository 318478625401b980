"""What a parsed DBC must hold before frames may be decoded with it.

The parser accepts databases that cannot be decoded rightly: ambiguous names, signals outside
their message, factors of zero.  A wrong value is worse than none, so they are refused here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from .errors import InputError
from .layout import MessageLayout, SignalLayout
from .limits import PICK_DBC, Source

MAX_COUNTER = 1 << 32


def check_messages(messages: Sequence[MessageLayout], source: Source) -> None:
    """Refuse messages that cannot be decoded, or not in one way only.

    Parameters
    ----------
    messages : sequence of MessageLayout
        In the order of the text.
    source : Source
        The text, for line numbers.

    Raises
    ------
    InputError
        At the first fault, with its line.
    """
    if not messages:
        raise InputError(source.name, "the DBC has no messages", PICK_DBC)
    names: set[str] = set()
    keys: set[tuple[int, bool]] = set()
    for number, message in enumerate(messages):
        key, where = (message.can_id, message.is_extended), source.at(source.blocks[number][0])
        if key in keys:
            what = f"message {message.name} has the identifier 0x{message.can_id:X} of another one"
            raise InputError(where, what, "give each message its own")
        if message.name in names:
            what = f"there are two messages called {message.name}"
            raise InputError(where, what, "rename one")
        keys.add(key)
        names.add(message.name)
        for position, signal in enumerate(message.signals):
            fault = _fault(message, position)
            if fault is not None:
                what = f"{message.name}.{signal.name} {fault}"
                raise InputError(source.where(number, signal.name), what, "mend that signal")
        if source.multiplexed(number) != sum(s.is_multiplexed for s in message.signals):
            what = f"message {message.name} has multiplexed signals without one clear selector"
            raise InputError(where, what, "mark the selector M, or add SG_MUL_VAL_ lines")
        _check_roles(message, where)


def _fault(message: MessageLayout, position: int) -> str | None:
    """Tell what is wrong with a signal."""
    signal = message.signals[position]
    if signal.name in (other.name for other in message.signals[:position]):
        return "is there twice"
    if signal.last_byte >= message.length:
        return f"ends in byte {signal.last_byte + 1} of a message of {message.length}"
    if not (math.isfinite(signal.factor) and math.isfinite(signal.offset)):
        return "has an infinite factor or offset"
    if signal.factor == 0:
        return "has the factor 0: all its values would be the same"
    if not all(map(math.isfinite, signal.span)) and not signal.is_float:
        return "has values that are too large for a number"
    if signal.is_float and signal.length not in (16, 32, 64):
        return f"is a float of {signal.length} bits, not 16, 32 or 64"
    return _multiplexing_fault(message, signal)


def _multiplexing_fault(message: MessageLayout, signal: SignalLayout) -> str | None:
    """Tell what is wrong with the chain of selectors above a signal."""
    by_name = {other.name: other for other in message.signals}
    seen = {signal.name}
    while signal.selector is not None:
        if not signal.selected_by:
            return f"has no value of its selector {signal.selector}"
        if signal.selector not in by_name:
            return f"has the selector {signal.selector}, which is not in the message"
        if signal.selector in seen:
            return "selects itself"
        seen.add(signal.selector)
        signal = by_name[signal.selector]
        if signal.is_float:
            return f"has the selector {signal.name}, which is not a whole number"
    return None


def _check_roles(message: MessageLayout, where: str) -> None:
    """Refuse a counter or checksum that is not a plain unsigned number in every frame."""
    names = [message.counter.signal if message.counter else None, message.crc]
    for name in names:
        if name is None:
            continue
        signal = message.signal(name)
        plain = (signal.factor, signal.offset) == (1, 0) and not signal.is_float
        if not plain or signal.is_signed or signal.is_multiplexed:
            what = f"{message.name}.{name} has a role but is not a plain unsigned number"
            raise InputError(where, what, "mend its line or its SignalRole")
    if message.counter is not None and message.counter.modulus > MAX_COUNTER:
        what = f"{message.name}.{message.counter.signal} counts in more than 32 bits"
        raise InputError(where, what, "mend its line or its SignalRole")
    if message.crc is not None:
        crc = message.signal(message.crc)
        if crc.length != 8 or crc.low_bit != 0:
            what = f"{message.name}.{crc.name} is a checksum but not one whole byte"
            raise InputError(where, what, "mend its line or its SignalRole")
