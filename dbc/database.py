"""Reads DBC files; leaves out or refuses what cannot be decoded correctly.

The DBC is not read by cantools for three reasons: cantools rejects a whole file because of one line
that it does not understand, its work grows with the numbers in the text and not with the length of
the text, and its import alone takes as long as a hostile file may take.  In the tests, cantools is
the reference for this reader.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from .codec import Codec
from .errors import InputError
from .finding import Finding
from .layout import MessageLayout
from .reader.compose import compose
from .reader.document import EXTENDED_BIT, ORPHANS, Block, Document, read_document, whole
from .reader.foreign import foreign_kind, parse_foreign
from .reader.limits import MAX_BYTES, PICK_DBC
from .reader.lint import (
    TOO_LONG,
    FaultError,
    ambiguous,
    as_long_as_it_is,
    odd,
    overlaps,
    unusable,
    usable_part,
    with_own_names,
)
from .reader.networks import MARK, network_names, one_network
from .reader.source import Source
from .words import counted


def shipped_dbc() -> str:
    """Return the text of the shipped DBC: IMU, hub accelerations, suspension travels."""
    return (files(__package__) / "bumpbench.dbc").read_text(encoding="utf-8")


def read_dbc(path: str | Path) -> str:
    """Read a DBC file as UTF-8 or, if it is not valid UTF-8, as Windows-1252.

    Parameters
    ----------
    path : str or Path
        A regular file of at most 5 MB.  ``car.kcd#Powertrain`` is one bus of a KCD or ARXML: the
        text without the other buses.

    Returns
    -------
    str
        Its text.

    Raises
    ------
    InputError
        If it cannot be read, is too large or is UTF-16, or has no such bus.
    """
    path = Path(path)
    whole_file, mark, network = str(path).rpartition(MARK)
    if mark and not path.exists() and Path(whole_file).is_file():
        text = read_dbc(whole_file)
        return one_network(text, foreign_kind(text, whole_file), whole_file, network)
    if path.exists() and not path.is_file():  # a directory; or a device, which may never end
        raise InputError(str(path), "not a file", PICK_DBC)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), PICK_DBC) from error
    if len(content) > MAX_BYTES:
        raise InputError(str(path), f"larger than {MAX_BYTES // 1_000_000} MB", PICK_DBC)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(str(path), "UTF-16 text, not UTF-8 or Windows text", "save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def split_by_bus(text: str, name: str) -> dict[str, str]:
    """Return the text of each bus that a KCD or ARXML describes, by name; empty for other formats.

    `text` and `name`: as in `parse_codec`.
    """
    kind = foreign_kind(text, name)
    return {each: one_network(text, kind, name, each) for each in network_names(text, kind)}


def load_codec(path: str | Path) -> Codec:
    """Read and compile a CAN database.

    Parameters
    ----------
    path : str or Path
        The file: DBC, KCD, SYM or ARXML.

    Returns
    -------
    Codec
        Its messages, ready to decode; `left_out` lists those that cannot be used.

    Raises
    ------
    InputError
        See `read_dbc` and `parse_codec`.
    """
    return parse_codec(read_dbc(path), str(path))


def parse_codec(text: str, name: str) -> Codec:
    """Compile the text of a CAN database.

    A signal or message that cannot be decoded correctly is left out and listed in `Codec.left_out`;
    the others are loaded.  Messages that share a name are loaded under different names
    (`dbc.reader.lint.with_own_names`).  Overlapping signals are legal (sensors document them): each
    is read from its own bits, and `Codec.notes` lists them.

    Parameters
    ----------
    text : str
        DBC, KCD, SYM or ARXML; the format is recognised by the first characters, else by the suffix
        of `name`.
    name : str
        Source of the text, for error messages.

    Returns
    -------
    Codec
        Its messages, ready to decode.

    Raises
    ------
    InputError
        If it is not a CAN database, or ends within a definition, or none of its messages can be
        used; with `name:line`.
    """
    if len(text) > MAX_BYTES:
        raise InputError(name, f"larger than {MAX_BYTES // 1_000_000} MB", PICK_DBC)
    if not text.strip():
        raise InputError(name, "the file is empty", PICK_DBC)
    if "\0" in text:
        raise InputError(name, "binary data, not a DBC", PICK_DBC)
    if foreign_kind(text, name):
        return parse_foreign(text, name)
    source = Source.of(text, name)
    return _compile(read_document(text, source), source)


def _compile(document: Document, source: Source) -> Codec:
    """Check the messages of a document one by one and separate the usable ones from the others."""
    usable: list[tuple[Block, MessageLayout]] = []
    left_out: list[Finding] = []
    faults = _strays(document) | document.faults
    for block in document.blocks:
        name = block.head["name"] if block.head else "?"
        if name == ORPHANS:
            continue
        known = faults.get(whole(block.head["id"])) if block.head else None
        fault = block.fault or known
        if fault is not None:
            left_out.append(unusable(source.at(fault[0]), f"message {name}", fault[1]))
            continue
        try:
            message, lost = usable_part(as_long_as_it_is(compose(document, block)))
        except FaultError as found:
            place, subject = _place(source, block, name, found.signal)
            left_out.append(unusable(place, subject, found.reason))
        else:
            usable.append((block, message))
            left_out += [
                unusable(*_place(source, block, name, signal), reason) for signal, reason in lost
            ]
    twice = ambiguous([message for _, message in usable])
    left_out += [
        unusable(*_place(source, usable[i][0], usable[i][1].name, None), why)
        for i, why in twice.items()
    ]
    blocks = [block for i, (block, _) in enumerate(usable) if i not in twice]
    messages = [message for i, (_, message) in enumerate(usable) if i not in twice]
    kept = with_own_names(messages)
    notes = [odd(source.at(start), "the text", what) for start, what in document.loose]
    for block, message, own in zip(blocks, messages, kept, strict=True):
        if own.name != message.name:
            where = f"has the name of another message: it is {own.name} here"
            notes.append(odd(*_place(source, block, message.name, None), where))
    for block, message in zip(blocks, kept, strict=True):
        if block.head and message.is_extended and whole(block.head["id"]) < EXTENDED_BIT:
            notes.append(odd(*_place(source, block, message.name, None), TOO_LONG))
        shared = overlaps(message)
        if shared:
            rest = len(shared) - 1
            more = f" (and {counted(rest, 'more signal')})" if rest else ""
            what = f"overlaps {shared[0][1]}{more}"
            notes.append(odd(*_place(source, block, message.name, shared[0][0]), what))
    if not kept:
        raise _refusal(source, [*left_out, *notes])
    return Codec(tuple(kept), tuple(left_out), tuple(notes))


def _strays(document: Document) -> dict[int, tuple[int, str]]:
    """Find messages without a signal that the DBC elsewhere declares as float or multiplexed.

    The DBC may mean another signal of that message.  (A value table of a missing signal is common
    and harmless.)
    """
    held = {
        whole(block.head["id"]): {s.body["name"] for s in block.signals if s.body}
        for block in document.blocks
        if block.head
    }
    return {
        key[0]: (document.positions[key], f"has no signal {key[1]}, which is named there")
        for key in [*document.float_types, *document.selections]
        if key[0] in held and key[1] not in held[key[0]]
    }


def _place(source: Source, block: Block, message: str, signal: str | None) -> tuple[str, str]:
    """Return line and name of a message, or of one of its signals if the text has that name."""
    if signal is None:
        return source.at(block.position), f"message {message}"
    lines = (s.start for s in reversed(block.signals) if s.body and s.body["name"] == signal)
    return source.at(next(lines, block.position)), f"{message}.{signal}"


def _refusal(source: Source, findings: list[Finding]) -> InputError:
    """Return the error for a file that has no usable message."""
    if not findings:
        return InputError(source.name, "the DBC has no messages", PICK_DBC)
    first = findings[0]
    rest = len(findings) - 1
    more = f", and {counted(rest, 'more fault')}" if rest else ""
    what = f"{first.text}{more}"
    if first.subject == "the text":
        what = f"not a valid DBC: {first.text.removeprefix('the text ')}{more}"
    return InputError(first.where, what, "correct that line or give another file")
