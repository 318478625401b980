"""DBC files: reading, parsing (cantools) and refusing what cannot be decoded rightly."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any

from .codec import Codec
from .errors import InputError
from .layout import CounterRule, MessageLayout, SignalLayout
from .limits import MAX_BYTES, check_text

COUNTER_ROLE = "counter"
CRC_ROLE = "crc8_j1850"
_ROLE = "SignalRole"


def shipped_dbc() -> str:
    """Return the text of the shipped DBC: IMU, hub accelerations, suspension travels."""
    return (files(__package__) / "bumpbench.dbc").read_text(encoding="utf-8")


def read_dbc(path: str | Path) -> str:
    """Read a DBC file, as UTF-8 or, where it is not that, as Windows-1252.

    Parameters
    ----------
    path : str or Path
        A regular file of at most 5 MB.

    Returns
    -------
    str
        Its text.

    Raises
    ------
    InputError
        If it cannot be read, is too large or is not text.
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            raise InputError(str(path), "not a file", "give a DBC file")
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), "give a DBC file") from error
    if len(content) > MAX_BYTES:
        raise InputError(str(path), f"larger than {MAX_BYTES // 1_000_000} MB", "give a DBC file")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    try:
        return content.decode("cp1252")
    except UnicodeDecodeError as error:
        raise InputError(str(path), "neither UTF-8 nor Windows text", "give a DBC file") from error


def load_codec(path: str | Path) -> Codec:
    """Read and compile a DBC file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Codec
        Its messages, ready to decode.

    Raises
    ------
    InputError
        See `read_dbc` and `parse_codec`.
    """
    return parse_codec(read_dbc(path), str(path))


def parse_codec(text: str, name: str) -> Codec:
    """Compile the text of a DBC.

    Overlapping signals are legal (sensors document them); each is read from its own bits.

    Parameters
    ----------
    text : str
        The DBC.
    name : str
        Where it came from, for error messages.

    Returns
    -------
    Codec
        Its messages, ready to decode.

    Raises
    ------
    InputError
        If it is not a DBC, or says something that cannot be meant: ambiguous names or
        identifiers, signals outside their message, factors of zero or infinity.
    """
    check_text(text, name)
    messages = tuple(_message(message, name) for message in _parse(text, name))
    if not messages:
        raise InputError(name, "the DBC has no messages", "give the DBC of the sensors")
    _refuse_twins([message.name for message in messages], name, "messages")
    return Codec(messages)


def _parse(text: str, name: str) -> Sequence[Any]:
    from cantools.database.can.formats import dbc

    try:
        return tuple(dbc.load_string(text, strict=False).messages)
    except RecursionError as error:
        raise InputError(name, "too deeply nested", "give a DBC file") from error
    except Exception as error:
        # cantools raises whatever comes up (ValueError, KeyError, its own, the tokenizer's).
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        place = re.search(r"line (\d+)", what)
        where = f"{name}:{place[1]}" if place else name
        raise InputError(where, f"not a valid DBC: {what}", "mend the file") from error


def _message(message: Any, name: str) -> MessageLayout:
    where = f"message {message.name}"
    signals = tuple(_signal(signal, message, name) for signal in message.signals)
    _refuse_twins([signal.name for signal in signals], name, f"signals of {where}")
    roles = {s.name: _role(s) for s in message.signals}
    counters = [signal for signal in signals if roles[signal.name] == COUNTER_ROLE]
    crcs = [signal for signal in signals if roles[signal.name] == CRC_ROLE]
    for signal in counters + crcs:
        integer = (signal.factor, signal.offset) == (1, 0) and not signal.is_float
        if not integer or signal.is_signed or signal.is_multiplexed:
            what = f"{where}: {signal.name} has a role but is not a plain unsigned integer"
            raise InputError(name, what, "mend its line or its SignalRole")
    if any(crc.length != 8 or crc.low_bit != 0 for crc in crcs):
        raise InputError(name, f"{where}: the checksum is not one whole byte", "mend its line")
    if len(counters) > 1 or len(crcs) > 1:
        raise InputError(name, f"{where} has two signals of one role", "mend its SignalRole")
    return MessageLayout(
        name=message.name,
        can_id=message.frame_id,
        is_extended=message.is_extended_frame,
        length=message.length,
        cycle_s=message.cycle_time / 1000 if message.cycle_time else None,
        signals=signals,
        counter=CounterRule(counters[0].name, 1 << counters[0].length) if counters else None,
        crc=crcs[0].name if crcs else None,
        senders=tuple(message.senders),
    )


def _signal(signal: Any, message: Any, name: str) -> SignalLayout:
    where = f"signal {message.name}.{signal.name}"
    conversion = signal.conversion
    factor, offset = conversion.scale, conversion.offset
    if not (math.isfinite(factor) and math.isfinite(offset)) or factor == 0:
        raise InputError(name, f"{where}: factor {factor}, offset {offset}", "mend its line")
    if conversion.is_float and signal.length not in (16, 32, 64):
        raise InputError(name, f"{where}: a float of {signal.length} bits", "mend its SIG_VALTYPE_")
    if not conversion.is_float and float(factor).is_integer() and float(offset).is_integer():
        factor, offset = int(factor), int(offset)
    layout = SignalLayout(
        name=signal.name,
        unit=signal.unit or "",
        start=signal.start,
        length=signal.length,
        is_big_endian=signal.byte_order == "big_endian",
        is_signed=signal.is_signed,
        is_float=conversion.is_float,
        factor=factor,
        offset=offset,
        minimum=None if signal.minimum is None else float(signal.minimum),
        maximum=None if signal.maximum is None else float(signal.maximum),
        selector=signal.multiplexer_signal,
        selected_by=_ranges(signal.multiplexer_ids or ()),
    )
    if layout.last_byte >= message.length:
        what = f"{where} ends in byte {layout.last_byte + 1} of {message.length}"
        raise InputError(name, what, "mend its start, its length or the message's")
    if layout.selector is not None and not layout.selected_by:
        raise InputError(name, f"{where} has no selector value", "mend its multiplexing")
    return layout


def _role(signal: Any) -> str:
    """Return the signal's role: an index into the ENUM, or its text, as editors write both."""
    attribute = signal.dbc.attributes.get(_ROLE) if signal.dbc.attributes else None
    if attribute is None:
        return ""
    value = attribute.value
    choices = attribute.definition.choices or []
    if isinstance(value, int) and 0 <= value < len(choices):
        return str(choices[value])
    return str(value)


def _ranges(values: Sequence[int]) -> tuple[tuple[int, int], ...]:
    """Write whole numbers as inclusive ranges."""
    runs = groupby(enumerate(sorted(values)), lambda pair: pair[1] - pair[0])
    groups = [[value for _, value in run] for _, run in runs]
    return tuple((group[0], group[-1]) for group in groups)


def _refuse_twins(names: list[str], where: str, kind: str) -> None:
    twins = sorted({name for name in names if names.count(name) > 1})
    if twins:
        raise InputError(where, f"two {kind} are called {twins[0]}", "rename one")
