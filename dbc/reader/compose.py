"""Composes message layouts from a DBC's statements: names, selectors, value tables, roles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from re import Match

from ..crc import CRC_RULES
from ..layout import CounterRule, MessageLayout, SignalLayout
from .document import EXTENDED_BIT, Block, Document, SignalKey, number, scaling, whole
from .grammar import unquoted
from .lint import FaultError, with_own_signal_names
from .sentinels import sentinels

ROLE_ATTRIBUTE = "SignalRole"
VALUE_ROLE = "value"
COUNTER_ROLE = "counter"

NO_NODE = "Vector__XXX"
_J1939 = "J1939PG"


def compose(document: Document, block: Block) -> MessageLayout:
    """Put together all that a DBC says about one message.

    `block` is the message; its first line is understood.  The layout is not checked yet, see
    `dbc.reader.lint`.  Raises FaultError if parts of the message contradict each other.
    """
    head = block.head
    assert head is not None
    identifier = whole(head["id"])
    bodies = [statement.body for statement in block.signals if statement.body is not None]
    marked = [body["name"] for body in bodies if (body["marker"] or "").endswith("M")]
    sole = marked[0] if len(marked) == 1 else None
    signals = [_signal(document, identifier, body, sole) for body in bodies]
    roles = _roles(document, identifier, signals)
    renamed = {
        old.name: str(
            document.attributes.get(("SystemSignalLongSymbol", (identifier, old.name)), old.name)
        )
        for old in signals
    }
    signals = [
        replace(s, name=renamed[s.name], selector=renamed.get(s.selector or "", s.selector))
        for s in signals
    ]
    typed = {name for name in renamed if (identifier, name) in document.float_types}
    fixed = {renamed[name] for name in (*typed, *roles.values())}
    signals = list(with_own_signal_names(signals, fixed))
    rule = next((role for role in roles if role in CRC_RULES), None)
    by_role = {role: renamed[name] for role, name in roles.items()}
    counter = next((s for s in signals if s.name == by_role.get(COUNTER_ROLE)), None)
    return MessageLayout(
        name=str(document.attributes.get(("SystemMessageLongSymbol", identifier), head["name"])),
        can_id=identifier % EXTENDED_BIT,
        is_extended=identifier >= EXTENDED_BIT,
        length=whole(head["length"]),
        cycle_s=_cycle_s(document, identifier),
        signals=tuple(sorted(signals, key=lambda signal: signal.first_bit)),
        counter=CounterRule(counter.name, 1 << min(counter.length, 64)) if counter else None,
        crc=by_role[rule] if rule else None,
        crc_rule=rule or "crc8_j1850",
        senders=_senders(document, identifier, head["sender"]),
        is_j1939=identifier >= EXTENDED_BIT and _frame_format(document, identifier) == _J1939,
    )


def _signal(
    document: Document, identifier: int, body: Match[str], sole: str | None
) -> SignalLayout:
    key = (identifier, body["name"])
    selector, selected_by = _selection(document, key, body["marker"] or "", sole)
    is_float = document.float_types.get(key) in (1, 2)
    factor, offset = scaling(number(body["factor"]), number(body["offset"]), is_float)
    low, high = body["minimum"], body["maximum"]
    stated = (low, high) != ("0", "0")
    signal = SignalLayout(
        name=body["name"],
        unit=unquoted(body["unit"][1:-1]),
        start=whole(body["start"]),
        length=whole(body["length"]),
        is_big_endian=body["order"] == "0",
        is_signed=body["sign"] == "-",
        is_float=is_float,
        factor=factor,
        offset=offset,
        minimum=float(low) if stated else None,
        maximum=float(high) if stated else None,
        selector=selector,
        selected_by=selected_by,
        sentinels=(),
    )
    table = document.tables.get(key)
    if not table or signal.length > 64 or _role(document, key) != VALUE_ROLE:
        return signal
    return replace(signal, sentinels=sentinels(signal, table))


def _selection(
    document: Document, key: SignalKey, marker: str, sole: str | None
) -> tuple[str | None, tuple[tuple[int, int], ...]]:
    """Return the selector of a signal and the values for which it is in a frame.

    `SG_MUL_VAL_` names the selector; without it, the mark `m3` is a value of the only selector.
    """
    listed = document.selections.get(key)
    first = whole(marker[1:].rstrip("M")) if marker.startswith("m") else None
    if listed is not None:
        if not marker:
            raise FaultError(key[1], "has SG_MUL_VAL_ but no mark of a multiplexed signal")
        if first is not None and not any(low <= first <= high for low, high in listed[1]):
            raise FaultError(key[1], f"is marked {marker}, which its SG_MUL_VAL_ does not name")
        return listed
    if first is None:
        return None, ()
    if sole is None or sole == key[1]:
        raise FaultError(key[1], "is multiplexed without one clear selector")
    return sole, ((first, first),)


def _role(document: Document, key: SignalKey) -> str:
    value = document.attributes.get((ROLE_ATTRIBUTE, key), VALUE_ROLE)
    choices = document.choices.get(ROLE_ATTRIBUTE, ())
    if isinstance(value, int) and 0 <= value < len(choices):
        return choices[value]  # an ENUM stores the index, a STRING the text
    return str(value)


def _roles(document: Document, identifier: int, signals: Sequence[SignalLayout]) -> dict[str, str]:
    """Return the names of the signals that are counters or checksums, by role."""
    found: dict[str, str] = {}
    for signal in signals:
        role = _role(document, (identifier, signal.name))
        if role == VALUE_ROLE:
            continue
        if role != COUNTER_ROLE and role not in CRC_RULES:
            raise FaultError(signal.name, f"has the {ROLE_ATTRIBUTE} {role}, which is unknown")
        if role in found or (role in CRC_RULES and not CRC_RULES.keys().isdisjoint(found)):
            raise FaultError(signal.name, f"has the {ROLE_ATTRIBUTE} {role}, defined twice")
        found[role] = signal.name
    return found


def _cycle_s(document: Document, identifier: int) -> float | None:
    """Return the time between two frames, s; the attributes state it in ms."""
    default = document.defaults.get("GenMsgCycleTime")
    value = document.attributes.get(("GenMsgCycleTime", identifier), default)
    return value / 1000 if isinstance(value, int | float) and 0 < value < 1e12 else None


def _frame_format(document: Document, identifier: int) -> str:
    """Return the label of `VFrameFormat`, which the attributes state as a number or as a text."""
    name = "VFrameFormat"
    value = document.attributes.get((name, identifier), document.defaults.get(name, ""))
    labels = document.choices.get(name, ())
    if isinstance(value, str):
        return value
    return labels[int(value)] if 0 <= value < len(labels) else ""


def _senders(document: Document, identifier: int, first: str) -> tuple[str, ...]:
    names = dict.fromkeys([first, *document.senders.get(identifier, ())])
    senders = [str(document.attributes.get(("SystemNodeLongSymbol", n), n)) for n in names]
    return () if senders == [NO_NODE] else tuple(senders)
