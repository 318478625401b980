"""DBC files: reading, parsing (cantools) and refusing what cannot be decoded rightly."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any

from .codec import Codec
from .errors import InputError
from .layout import CounterRule, MessageLayout, SignalLayout
from .limits import MAX_BYTES, PICK_DBC, Source, check_text
from .lint import check_messages

ROLE_ATTRIBUTE = "SignalRole"
VALUE_ROLE = "value"
COUNTER_ROLE = "counter"
CRC_ROLE = "crc8_j1850"


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
    if path.exists() and not path.is_file():  # a directory; or a device, which may never end
        raise InputError(str(path), "not a file", PICK_DBC)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), PICK_DBC) from error
    if len(content) > MAX_BYTES:
        raise InputError(str(path), f"larger than {MAX_BYTES // 1_000_000} MB", PICK_DBC)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    try:
        return content.decode("cp1252")
    except UnicodeDecodeError as error:
        raise InputError(str(path), "neither UTF-8 nor Windows text", PICK_DBC) from error


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
    source = check_text(text, name)
    try:
        messages = tuple(_message(message, source) for message in _parse(text, source))
        check_messages(messages, source)
    except OverflowError as error:
        raise InputError(name, "a number is beyond float64", "mend factors and ranges") from error
    return Codec(messages)


def _parse(text: str, source: Source) -> Sequence[Any]:
    from cantools.database.can.formats import dbc

    # The parser takes a text that ends within a definition for a whole one, and leaves out what
    # it did not understand.  A definition after the end turns that into a syntax error.
    whole = f'{text}\nCM_ "";\n'
    try:
        return tuple(dbc.load_string(whole, strict=False).messages)
    except Exception as error:
        # cantools raises whatever comes up: ValueError, KeyError, its own, the tokenizer's.
        what = str(error).split("\n", 1)[0] or type(error).__name__
        place = re.search(r"\bline (\d+)", what)
        if place and int(place[1]) > text.count("\n") + 1:
            raise InputError(source.name, "ends within a definition", PICK_DBC) from error
        where = f"{source.name}:{place[1]}" if place else source.name
        raise InputError(where, f"not a valid DBC: {what}", "mend it or give another") from error


def _message(message: Any, source: Source) -> MessageLayout:
    signals = tuple(map(_signal, message.signals))
    roles = _roles(message, source)
    counter = next((signal for signal in signals if signal.name == roles.get(COUNTER_ROLE)), None)
    cycle_ms = message.cycle_time
    return MessageLayout(
        name=message.name,
        can_id=message.frame_id,
        is_extended=message.is_extended_frame,
        length=message.length,
        cycle_s=cycle_ms / 1000 if isinstance(cycle_ms, int | float) and cycle_ms > 0 else None,
        signals=signals,
        counter=CounterRule(counter.name, 1 << counter.length) if counter else None,
        crc=roles.get(CRC_ROLE),
        senders=tuple(message.senders),
    )


def _signal(signal: Any) -> SignalLayout:
    is_float = signal.conversion.is_float
    factor, offset = signal.conversion.scale, signal.conversion.offset
    if not is_float and factor == factor // 1 and offset == offset // 1:
        factor, offset = int(factor), int(offset)
    return SignalLayout(
        name=signal.name,
        unit=signal.unit or "",
        start=signal.start,
        length=signal.length,
        is_big_endian=signal.byte_order == "big_endian",
        is_signed=signal.is_signed,
        is_float=is_float,
        factor=factor,
        offset=offset,
        minimum=None if signal.minimum is None else float(signal.minimum),
        maximum=None if signal.maximum is None else float(signal.maximum),
        selector=signal.multiplexer_signal,
        selected_by=_ranges(signal.multiplexer_ids or ()),
    )


def _roles(message: Any, source: Source) -> dict[str, str]:
    """Return the names of the signals that have a role other than to carry a value, by role."""
    found: dict[str, str] = {}
    for signal in message.signals:
        attribute = (signal.dbc.attributes or {}).get(ROLE_ATTRIBUTE)
        if attribute is None:
            continue
        choices = dict(enumerate(attribute.definition.choices or ()))
        role = choices.get(
            attribute.value, attribute.value
        )  # an ENUM has the index, a STRING the text
        if role == VALUE_ROLE:
            continue
        if role not in (COUNTER_ROLE, CRC_ROLE) or role in found:
            what = f"{message.name}.{signal.name}: the role {role} is unknown or there twice"
            advice = f"give {ROLE_ATTRIBUTE} as {VALUE_ROLE}, {COUNTER_ROLE} or {CRC_ROLE}"
            raise InputError(source.name, what, advice)
        found[role] = signal.name
    return found


def _ranges(values: Sequence[int]) -> tuple[tuple[int, int], ...]:
    """Write whole numbers as inclusive ranges."""
    runs = groupby(enumerate(sorted(values)), lambda pair: pair[1] - pair[0])
    groups = [[value for _, value in run] for _, run in runs]
    return tuple((group[0], group[-1]) for group in groups)
