"""The comparison of our reader with cantools on the bench's DBC, as lines of the check."""

from __future__ import annotations

from dbc import Codec
from dbc.finding import Finding, Severity
from dbc.witness.second_reader import Witness, WitnessReport

from ..bench.config import Bench

_ADVICE = "one of the two is wrong: compare with the sensor's data sheet, and report it to us"


def bench_witness(bench: Bench, codec: Codec) -> Witness:
    """Start cantools on the DBC of a bench."""
    used = {channel.signal.partition(".")[0] for channel in bench.channels if channel.signal}
    known = [message.name for message in codec.messages if message.name in used]
    return Witness(bench.dbc_text, bench.dbc_name, codec, known)


def reader_lines(reading: WitnessReport) -> list[Finding]:
    """Return a FAIL for each difference; one WARN if cantools cannot read the DBC.

    `reading`: what cantools says; nothing gives no line.
    """
    if reading.refusal:
        reason = f"values are not compared, because cantools does not read it: {reading.refusal}"
        advice = "compare some values with the sensors' own tools"
        return [Finding("unread", Severity.WARNING, reason, "DBC", advice)]
    if reading.differences:
        return [
            Finding("readers", Severity.ERROR, each.reason, f"message {each.message}", _ADVICE)
            for each in reading.differences
        ]
    if not reading.compared:
        return []
    reason = f"our reader and cantools read its {reading.compared} messages in use alike"
    return [Finding("readers", Severity.NOTE, reason, "DBC")]
