"""Checks a message before frames are decoded with it.

A wrong value is worse than no value.  So a signal that cannot be decoded, and a message that could
be decoded in several ways, are left out and reported.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from ..finding import Finding, Severity
from ..layout import MessageLayout, SignalLayout
from .limits import MAX_NESTING, MAX_PAYLOAD_BYTES, MAX_SELECTIONS, MAX_SIGNAL_BITS

MAX_COUNTER = 1 << 32
STANDARD_BITS, EXTENDED_BITS = 11, 29
TOO_LONG = "is marked as 11-bit, but its identifier is longer: it is read as a 29-bit message"


class FaultError(Exception):
    """The reason why a message cannot be used.

    `signal`: the faulty signal; None if the message itself is faulty.  `reason`: a sentence without
    its subject.
    """

    def __init__(self, signal: str | None, reason: str) -> None:
        self.signal = signal
        self.reason = reason
        super().__init__(signal, reason)


def usable_part(message: MessageLayout) -> tuple[MessageLayout, list[tuple[str, str]]]:
    """Return a message without the signals that cannot be decoded, and these signals with reasons.

    Raises FaultError if the message cannot be decoded, or could be decoded in several ways: none of
    its signals is left, or its counter or its checksum cannot be read.
    """
    _check_frame(message)
    faults = {}
    for signal in message.signals:
        fault = _signal_fault(message, signal)
        if fault:
            faults[signal.name] = fault
    for _ in range(MAX_NESTING):  # a signal cannot be read if its selector is left out
        lost = {s.name: s.selector for s in message.signals if s.selector in faults}
        faults |= {
            name: f"has the selector {selector}, which is left out"
            for name, selector in lost.items()
            if name not in faults
        }
    roles = [message.counter.signal if message.counter else None, message.crc]
    first = next((name for name in faults if name in roles), None)
    if first is None and len(faults) == len({s.name for s in message.signals}):
        first = next(iter(faults), None)
    if first is not None:
        raise FaultError(first, faults[first])
    kept = tuple(signal for signal in message.signals if signal.name not in faults)
    message = message if len(kept) == len(message.signals) else replace(message, signals=kept)
    _check_message(message)
    return message, list(faults.items())


def _check_frame(message: MessageLayout) -> None:
    bits = EXTENDED_BITS if message.is_extended else STANDARD_BITS
    if message.can_id >> bits:
        kind = "extended" if message.is_extended else "standard"
        reason = f"has the {kind} identifier 0x{message.can_id:X} of more than {bits} bits"
        raise FaultError(None, reason)
    if message.length > MAX_PAYLOAD_BYTES:
        raise FaultError(None, f"has {message.length} bytes, not 0 to {MAX_PAYLOAD_BYTES}")
    by_name: dict[str, SignalLayout] = {}
    for signal in message.signals:
        if signal.name in by_name:
            raise FaultError(signal.name, "is defined twice")
        by_name[signal.name] = signal


def _check_message(message: MessageLayout) -> None:
    by_name = {signal.name: signal for signal in message.signals}
    for signal in message.signals:
        fault = _multiplexing_fault(by_name, signal)
        if fault:
            raise FaultError(signal.name, fault)
    _check_roles(message)


def _signal_fault(message: MessageLayout, signal: SignalLayout) -> str | None:
    try:
        return _bits_fault(message, signal) or _number_fault(signal)
    except OverflowError:
        return "has a number beyond float64"


def _bits_fault(message: MessageLayout, signal: SignalLayout) -> str | None:
    if not 1 <= signal.length <= MAX_SIGNAL_BITS:
        return f"has {signal.length} bits, not 1 to {MAX_SIGNAL_BITS}"
    if not 0 <= signal.start < 8 * MAX_PAYLOAD_BYTES:
        return f"starts at bit {signal.start}, outside any payload"
    if signal.last_byte >= message.length:
        return f"ends in byte {signal.last_byte + 1} of a message of {message.length}"
    return None


def _number_fault(signal: SignalLayout) -> str | None:
    if not (math.isfinite(signal.factor) and math.isfinite(signal.offset)):
        return "has an infinite factor or offset"
    if signal.factor == 0:
        return "has the factor 0: all its values would be the same"
    if signal.is_float:
        good = signal.length in (16, 32, 64)
        return None if good else f"is a float of {signal.length} bits, not 16, 32 or 64"
    if not all(map(math.isfinite, signal.span)):
        return "has values that are too large for a number"
    return None


def _multiplexing_fault(by_name: Mapping[str, SignalLayout], signal: SignalLayout) -> str | None:
    """Return what is wrong with the chain of selectors above a signal; None if nothing."""
    if len(signal.selected_by) > MAX_SELECTIONS:
        return f"has more than {MAX_SELECTIONS} ranges of selector values"
    name = signal.name
    for _ in range(MAX_NESTING):
        if signal.selector is None:
            return None
        if not signal.selected_by:
            return f"has no value of its selector {signal.selector}"
        if signal.selector not in by_name:
            return f"has the selector {signal.selector}, which is not in the message"
        if signal.selector == name:
            return "selects itself"
        signal = by_name[signal.selector]
        if signal.is_float:
            return f"has the selector {signal.name}, which is not a whole number"
    return f"has more than {MAX_NESTING} selectors above it"


def _check_roles(message: MessageLayout) -> None:
    """Refuse a counter or checksum that is not a plain unsigned number in every frame."""
    names = [message.counter.signal if message.counter else None, message.crc]
    for name in names:
        if name is None:
            continue
        if not message.signal(name).is_plain:
            raise FaultError(name, "has a role but is not a plain unsigned number")
    if message.counter is not None and message.counter.modulus > MAX_COUNTER:
        raise FaultError(message.counter.signal, "counts in more than 32 bits")
    if message.crc is not None:
        crc = message.signal(message.crc)
        if crc.length != 8 or crc.low_bit != 0:
            raise FaultError(crc.name, "is a checksum but not one whole byte")


def overlaps(message: MessageLayout) -> list[tuple[str, str]]:
    """Find signals that share bits, which is legal but sometimes a mistake.

    `message`: a message without faults.  Returns pairs: a signal and an earlier signal with which
    it shares bits.  Signals of different selector values may share bits.
    """
    found = []
    taken: dict[object, dict[int, str]] = defaultdict(dict)
    for signal in sorted(message.signals, key=lambda s: s.is_multiplexed):
        own = taken[signal.selector, signal.selected_by]
        bits = _bits(signal)
        earlier = next((own[b] for b in bits if b in own), None)
        if earlier is None and signal.is_multiplexed:
            always = taken[None, ()]
            earlier = next((always[b] for b in bits if b in always), None)
        if earlier is not None:
            found.append((signal.name, earlier))
        own.update(dict.fromkeys(bits, signal.name))
    return found


def _bits(signal: SignalLayout) -> range | list[int]:
    """Return the numbers of a signal's bits, 8 * byte + bit."""
    if not signal.is_big_endian:
        return range(signal.start, signal.start + signal.length)
    sent = range(signal.first_bit, signal.first_bit + signal.length)
    return [8 * (bit // 8) + 7 - bit % 8 for bit in sent]


def ambiguous(messages: Sequence[MessageLayout]) -> dict[int, str]:
    """Find messages that share their identifier with another message.

    `messages`: all messages of a DBC.  Returns reasons by position, for every message of that
    identifier, because it is not known which one is right.
    """
    found: dict[int, str] = {}
    keys: dict[tuple[int, bool], list[int]] = defaultdict(list)
    for position, message in enumerate(messages):
        keys[message.can_id, message.is_extended].append(position)
    for key, same in keys.items():
        if len(same) > 1:
            found |= dict.fromkeys(same, f"has the identifier 0x{key[0]:X} of another message")
    return found


def with_own_names(messages: Sequence[MessageLayout]) -> list[MessageLayout]:
    """Return messages of different identifiers, each under a unique name.

    If several messages have one name, the identifier is appended to each: ``Status_0x1A0``, with an
    x at the end for a 29-bit identifier if an 11-bit identifier has the same number.
    """
    names = Counter(message.name for message in messages)
    taken = set(names)
    found = []
    for message in messages:
        name = message.name
        if names[name] > 1:
            name = f"{name}_0x{message.can_id:X}"
            while name in taken:
                name += "x"
            taken.add(name)
        found.append(message if name == message.name else replace(message, name=name))
    return found


def with_own_signal_names(
    signals: Sequence[SignalLayout], fixed: Collection[str] = ()
) -> tuple[SignalLayout, ...]:
    """Return the signals of a message; signals that share a name are renamed.

    Two signals ``Limit`` with the selector values 3 and 4 become ``Limit_m3`` and ``Limit_m4``; two
    that are in every frame and start at the bits 8 and 10 become ``Limit_b8`` and ``Limit_b10``.
    `fixed`: names that are not changed, because the database gives them a role or a type and it is
    not known which signal is meant.
    """
    found = list(signals)
    for part in (_selector_part, _bit_part):
        names = Counter(signal.name for signal in found)
        twins = Counter((signal.name, signal.selected_by, signal.start) for signal in found)
        for place, signal in enumerate(found):
            own = signal.name + part(signal)
            is_one = twins[signal.name, signal.selected_by, signal.start] == 1
            shared = names[signal.name] > 1 and signal.name not in fixed
            if shared and is_one and own not in names:
                found[place] = replace(signal, name=own)
    return tuple(found)


def _selector_part(signal: SignalLayout) -> str:
    return f"_m{signal.selected_by[0][0]}" if signal.selected_by else ""


def _bit_part(signal: SignalLayout) -> str:
    return f"_b{signal.start}"


def as_long_as_it_is(message: MessageLayout) -> MessageLayout:
    """Return a message as a 29-bit message if it is marked as 11-bit but its identifier is longer.

    Only a 29-bit frame can have that identifier.
    """
    bits = message.can_id.bit_length()
    too_long = not message.is_extended and STANDARD_BITS < bits <= EXTENDED_BITS
    return replace(message, is_extended=True) if too_long else message


def unusable(where: str, subject: str, reason: str) -> Finding:
    """Return the finding on a message or a signal that is left out."""
    return Finding("left_out", Severity.ERROR, f"{subject} {reason}", subject, where=where)


def odd(where: str, subject: str, reason: str) -> Finding:
    """Return the finding on something odd that is used nevertheless."""
    return Finding("odd", Severity.WARNING, f"{subject} {reason}", subject, where=where)
