"""Reads the DBC with cantools as well, and compares each message and signal."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from random import Random
from tempfile import TemporaryFile
from typing import Any

from ..codec import Codec
from ..errors import printable
from ..layout import MessageLayout
from ..reader.foreign import foreign_kind
from .child import key
from .compare import Difference, message_differences

SAMPLE = 16
"""Number of payloads of each message that both readers decode: ends of the range, and random
ones."""
MAX_CPU_S = 20
"""Processor time for cantools, s.  The slowest of 191 public databases takes 2 s."""
MAX_WAIT_S = 60
"""Wall-clock time, s, on a machine that has other work."""
MAX_BYTES = 1 << 30
"""Address space of the child, bytes."""


@dataclass(frozen=True, slots=True)
class WitnessReport:
    """The differences between our reading of a DBC and cantools'."""

    differences: tuple[Difference, ...]
    """Differences, with those of messages in use first."""
    refusal: str
    """Reason why cantools gave no answer; empty if it answered, or was not started."""
    compared: int = 0
    """Number of messages whose values were compared."""


class Witness:
    """A cantools process that reads a DBC, with limits because the DBC may be hostile."""

    def __init__(self, text: str, name: str, codec: Codec, used: Iterable[str]) -> None:
        """Start the process.

        KCD, SYM and ARXML are read only by cantools, so nothing is compared.  `codec`: result of
        our reader for the same text.  `used`: the messages whose values are compared.
        """
        self._codec = codec
        self._sample = {name: payloads(codec.message(name)) for name in dict.fromkeys(used)}
        self._child: subprocess.Popen[str] | None = None
        self._failure = ""
        if foreign_kind(text, name):
            return
        by_key = {
            key(message.can_id, message.is_extended): [p.hex() for p in sample]
            for message, sample in ((codec.message(n), s) for n, s in self._sample.items())
        }
        question = json.dumps({"text": text, "payloads": by_key})
        command = [sys.executable, "-I", "-m", "dbc.witness.child", str(MAX_BYTES), str(MAX_CPU_S)]
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        try:
            with TemporaryFile(
                "w+", encoding="utf-8"
            ) as stdin:  # a pipe would have to be waited for
                stdin.write(question)
                stdin.seek(0)
                self._child = subprocess.Popen(
                    command,
                    stdin=stdin,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    encoding="utf-8",
                    env=environment,
                )
        except OSError as error:
            self._failure = f"no process for it ({error.strerror or error})"

    def __enter__(self) -> Witness:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Kill the child, whatever its state."""
        if self._child is not None:
            self._child.kill()
            self._child.communicate()

    def report(self) -> WitnessReport:
        """Wait for the answer, at most `MAX_WAIT_S`, and compare."""
        child = self._child
        if child is None:
            return WitnessReport((), self._failure)
        try:
            answer, _ = child.communicate(timeout=MAX_WAIT_S)
        except subprocess.TimeoutExpired:
            return WitnessReport((), f"no answer for {MAX_WAIT_S} s")
        if child.returncode:
            ended = child.returncode < 0  # killed at the time limit
            return WitnessReport(
                (), f"it takes more than {MAX_CPU_S} s" if ended else "it stops with an error"
            )
        found: dict[str, Any] = json.loads(answer)
        if "refusal" in found:
            return WitnessReport((), printable(found["refusal"], 120))
        differences: list[Difference] = []
        for name, sample in self._sample.items():
            message = self._codec.message(name)
            theirs = found["messages"].get(key(message.can_id, message.is_extended))
            differences += message_differences(message, sample, _kept(self._codec, name, theirs))
        differences += _unread(self._codec, found["names"])
        return WitnessReport(tuple(differences), "", len(self._sample))


def _kept(codec: Codec, message: str, theirs: dict[str, Any] | None) -> dict[str, Any] | None:
    """Return the result of cantools for a message, without the signals that we leave out."""
    lost = {each.subject.rpartition(".")[2] for each in codec.left_out if "." in each.subject}
    if theirs is None or not lost:
        return theirs
    own = {signal.name for signal in codec.message(message).signals}
    kept = {n: each for n, each in theirs["signals"].items() if n in own or n not in lost}
    return {**theirs, "signals": kept}


def payloads(message: MessageLayout) -> tuple[bytes, ...]:
    """Return the payloads for the comparison, the same ones in every run."""
    length, dice = message.length, Random(message.can_id)
    fixed = [bytes(length), b"\xff" * length, (b"\x80\x00" * length)[:length]]
    return (*fixed, *(dice.randbytes(length) for _ in range(SAMPLE - len(fixed))))


def _unread(codec: Codec, names: dict[str, str]) -> Sequence[Difference]:
    """Return the messages of cantools that our reader neither reads nor lists as left out."""
    left_out = {each.subject.removeprefix("message ").split(".")[0] for each in codec.left_out}
    if "?" in left_out:  # a message whose name is not understood may be any of them
        return []
    known = {key(message.can_id, message.is_extended) for message in codec.messages}
    return [
        Difference(name, None, "no such message", f"identifier 0x{number.rstrip('x')}")
        for number, name in names.items()
        if number not in known and name not in left_out
    ]
