"""The child of `second_reader`: reads a DBC with cantools and decodes payloads with it.

Run as ``python -I -m dbc.witness.child MAX_BYTES MAX_S``; question and answer are JSON.
"""

from __future__ import annotations

import json
import sys
from copy import copy
from itertools import groupby
from typing import Any

ORPHANS = "VECTOR__INDEPENDENT_SIG_MSG"


def answer(question: dict[str, Any]) -> dict[str, Any]:
    """Return what cantools reads from a DBC and payloads.

    `question`: ``text`` of the DBC; ``payloads``, hexadecimal, by identifier (`key`).  Returns
    ``refusal``, the reason why cantools cannot read the DBC; or ``names`` of all messages by
    identifier and ``messages``, those of the question.
    """
    from cantools.database import load_string

    try:
        loaded: Any = load_string(question["text"], "dbc", strict=False)
    except Exception as error:  # cantools raises many kinds of errors
        return {"refusal": str(error).split("\n", 1)[0] or type(error).__name__}
    messages = {key(m.frame_id, m.is_extended_frame): m for m in loaded.messages}
    names = {number: m.name for number, m in messages.items() if m.name != ORPHANS}
    decoded = {
        number: _decoded(messages[number], [bytes.fromhex(p) for p in payloads])
        for number, payloads in question["payloads"].items()
        if number in names
    }
    return {"names": names, "messages": decoded}


def key(can_id: int, is_extended: bool) -> str:
    """Return the text form of an identifier."""
    return f"{can_id:X}{'x' if is_extended else ''}"


def _decoded(message: Any, payloads: list[bytes]) -> dict[str, Any]:
    fits = all(len(payload) == message.length for payload in payloads)
    signals = {s.name: _signal(message, s, payloads) for s in message.signals if fits}
    return {"length": message.length, "signals": signals}


def _signal(message: Any, signal: Any, payloads: list[bytes]) -> dict[str, Any]:
    """Decode one signal alone: cantools decodes wrongly where signals of a message overlap."""
    from cantools.database.can import Message

    alone = copy(signal)
    alone.is_multiplexer, alone.multiplexer_ids, alone.multiplexer_signal = False, None, None
    bare = Message(
        message.frame_id,
        message.name,
        message.length,
        [alone],
        is_extended_frame=message.is_extended_frame,
        strict=False,
    )
    raw = [
        bare.decode(payload, decode_choices=False, scaling=False)[signal.name]
        for payload in payloads
    ]
    values = [alone.raw_to_scaled(each, decode_choices=False) for each in raw]
    chosen = _runs(signal.multiplexer_ids or [])
    return {
        "selector": signal.multiplexer_signal,
        "chosen": chosen,
        "raw": raw,
        "values": [float(value) for value in values],
    }


def _runs(numbers: list[int]) -> list[list[int]]:
    """Return whole numbers as inclusive ranges, in order."""
    ordered = enumerate(sorted(set(numbers)))
    groups = [
        [n for _, n in group] for _, group in groupby(ordered, lambda pair: pair[1] - pair[0])
    ]
    return [[group[0], group[-1]] for group in groups]


def _limit(max_bytes: int, max_s: int) -> None:
    """Bound this process: memory, time, no file written, no core dumped."""
    try:
        import resource
    except ModuleNotFoundError:  # not on Windows; there the parent's time limit is the only one
        return
    resource.setrlimit(resource.RLIMIT_AS, (max_bytes, max_bytes))
    resource.setrlimit(resource.RLIMIT_CPU, (max_s, max_s + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main() -> None:
    """Answer one question."""
    _limit(int(sys.argv[1]), int(sys.argv[2]))
    json.dump(answer(json.load(sys.stdin)), sys.stdout)


if __name__ == "__main__":
    main()
