"""Reads KCD, SYM and ARXML databases with cantools, with the same limits and checks as for a DBC.

Line numbers are lost when cantools has read such a file, so messages name only the file.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..codec import Codec
from ..errors import InputError
from ..finding import Finding
from ..layout import MessageLayout, SignalLayout
from .complaints import complaints
from .document import joined, scaling
from .foreign_numbers import MAX_CHARACTERS, check_numbers
from .limits import MAX_SIGNAL_BITS
from .lint import (
    TOO_LONG,
    FaultError,
    ambiguous,
    as_long_as_it_is,
    odd,
    overlaps,
    unusable,
    usable_part,
    with_own_names,
    with_own_signal_names,
)
from .networks import MARK
from .sentinels import sentinels

MAX_LIMIT = int(sys.float_info.max)
"""Largest number of float64."""

_HEAD = 4096
"""Number of characters at the beginning of a database from which its format is recognised."""

_ROOT = re.compile(r"<(?:\w+:)?(NetworkDefinition|AUTOSAR|CANDELA)\b")
_KINDS = {"NetworkDefinition": "kcd", "AUTOSAR": "arxml", "CANDELA": "cdd"}
_SYM_HEAD = re.compile(r"\s*(?://[^\n]*\n\s*)*FormatVersion\s*=")


def foreign_kind(text: str, name: str) -> str:
    """Return the format of a database, from its content or else its suffix; "" for a DBC."""
    if text.lstrip("\ufeff \t\r\n")[:1] == "<" and (root := _ROOT.search(text[:_HEAD])):
        return _KINDS[root[1]]
    if _SYM_HEAD.match(text[:_HEAD]):
        return "sym"
    suffix = Path(name).suffix.lower()[1:]
    return suffix if suffix in MAX_CHARACTERS else ""


def parse_foreign(text: str, name: str) -> Codec:
    """Compile the text of a KCD, SYM or ARXML file.

    `foreign_kind` decides the format.  Messages that cannot be used are in `left_out`.  Raises
    InputError if it is not such a file, or if none of its messages can be used.
    """
    kind = foreign_kind(text, name)
    if kind == "cdd":
        what = "is a diagnostic description (CDD), which has no messages of the bus"
        raise InputError(name, what, "give the database of the bus: DBC, KCD, SYM or ARXML")
    check_numbers(text, name, kind)
    messages: list[MessageLayout] = []
    meanings: set[MessageLayout] = set()
    networks: list[str] = []
    left_out: list[Finding] = []
    notes: list[Finding] = []
    found_messages, complained = _parse(text, name, kind)
    for found in found_messages:
        try:
            stated = _message(found)
            message, lost = usable_part(as_long_as_it_is(stated))
        except OverflowError:
            left_out.append(unusable(name, f"message {found.name}", "has a number beyond float64"))
        except FaultError as fault:
            what = f"{found.name}.{fault.signal}" if fault.signal else f"message {found.name}"
            left_out.append(unusable(name, what, fault.reason))
        else:
            # A message that is passed on from one bus to another means the same on both.
            meaning = replace(message, senders=(), cycle_s=None)
            if meaning in meanings:
                continue
            meanings.add(meaning)
            messages.append(message)
            networks.append(found.bus_name or "")
            if message.is_extended != stated.is_extended:
                notes.append(odd(name, f"message {found.name}", TOO_LONG))
            left_out += [unusable(name, f"{found.name}.{signal}", why) for signal, why in lost]
    twice = ambiguous(messages)
    several = len({networks[i] for i in twice}) > 1
    for i, why in twice.items():
        advice = f" (if it is of the bus {networks[i]}, name {name}{MARK}{networks[i]})"
        left_out.append(unusable(name, f"message {messages[i].name}", why + advice * several))
    kept = tuple(with_own_names([m for i, m in enumerate(messages) if i not in twice]))
    if not kept:
        what = left_out[0].text if left_out else "it has no messages"
        raise InputError(name, what, "give another file")
    shared = [(message.name, overlaps(message)) for message in kept]
    notes += [
        odd(name, f"{message}.{pairs[0][0]}", f"overlaps {pairs[0][1]}")
        for message, pairs in shared
        if pairs
    ]
    notes += [odd(name, "the text", f"cantools reports: {each}") for each in complained]
    return Codec(kept, tuple(left_out), tuple(notes))


def _parse(text: str, name: str, kind: str) -> tuple[Sequence[Any], Collection[str]]:
    """Return the messages as cantools reads them, and its complaints."""
    from cantools.database.can.formats import arxml, kcd, sym

    load = {"kcd": kcd.load_string, "sym": sym.load_string, "arxml": arxml.load_string}[kind]
    try:
        with complaints() as complained:
            # Without a line feed at the end, cantools would search from each // to the end of the
            # text.
            return tuple(load(f"{text}\n", strict=False).messages), complained
    except Exception as error:
        # cantools raises many kinds of errors: ValueError, KeyError, its own, the XML parser's.
        what = str(error).split("\n", 1)[0] or type(error).__name__
        place = re.search(r"\bline (\d+)", what)
        where = f"{name}:{place[1]}" if place else name
        raise InputError(where, f"not a valid {kind.upper()}: {what}", "correct it") from error


def _message(message: Any) -> MessageLayout:
    if getattr(message, "is_container", False):
        raise FaultError(None, "is a container of other messages")
    if not message.name or not all(signal.name for signal in message.signals):
        raise FaultError(None, "has no name, or a signal without one")
    cycle_ms = message.cycle_time
    return MessageLayout(
        name=message.name,
        can_id=message.frame_id,
        is_extended=message.is_extended_frame,
        length=message.length,
        cycle_s=cycle_ms / 1000 if isinstance(cycle_ms, int | float) and cycle_ms > 0 else None,
        signals=with_own_signal_names([_signal(signal) for signal in message.signals]),
        counter=None,
        crc=None,
        senders=tuple(message.senders),
    )


def _limits(signal: Any) -> tuple[float | None, float | None]:
    """Return the lowest and the highest value; a limit beyond float64 is set to its end."""
    low, high = (
        None if limit is None else min(max(limit, -MAX_LIMIT), MAX_LIMIT)
        for limit in (signal.minimum, signal.maximum)
    )
    if signal.conversion.scale < 0 and low is not None and high is not None and low > high:
        low, high = high, low  # in an ARXML: converted from the limits of the raw values
    return None if low is None else float(low), None if high is None else float(high)


def _signal(signal: Any) -> SignalLayout:
    is_float = signal.conversion.is_float
    factor, offset = scaling(signal.conversion.scale, signal.conversion.offset, is_float)
    low, high = _limits(signal)
    layout = SignalLayout(
        name=signal.name,
        unit=signal.unit or "",
        start=signal.start,
        length=signal.length,
        is_big_endian=signal.byte_order == "big_endian",
        is_signed=signal.is_signed,
        is_float=is_float,
        factor=factor,
        offset=offset,
        minimum=low,
        maximum=high,
        selector=signal.multiplexer_signal,
        selected_by=joined([(value, value) for value in signal.multiplexer_ids or ()]),
        sentinels=(),
    )
    table = {int(raw): str(label) for raw, label in (signal.conversion.choices or {}).items()}
    if not table or not 1 <= layout.length <= MAX_SIGNAL_BITS:
        return layout
    return replace(layout, sentinels=sentinels(layout, table))
