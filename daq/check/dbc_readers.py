"""Compares our reader with cantools on a bench's databases, as lines of the check."""

from __future__ import annotations

from dbc import Codec
from dbc.finding import Finding, Severity
from dbc.witness.second_reader import Witness, WitnessReport
from dbc.words import counted

from ..bench.config import Bench
from ..bench.databases import database_codec, database_text, stored_databases
from ..signal_names import message_of

_ADVICE = "one of them is wrong: compare with the sensor's data sheet, and report it to us"


class BenchWitness:
    """Runs cantools on each database of a bench; a context manager that ends its processes."""

    def __init__(self, witnesses: tuple[Witness, ...]) -> None:
        self._witnesses = witnesses

    def __enter__(self) -> BenchWitness:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End all processes."""
        for witness in self._witnesses:
            witness.__exit__()

    def report(self) -> WitnessReport:
        """Wait for all answers and return them as one."""
        reports = [witness.report() for witness in self._witnesses]
        return WitnessReport(
            tuple(difference for report in reports for difference in report.differences),
            next((report.refusal for report in reports if report.refusal), ""),
            sum(report.compared for report in reports),
        )


def bench_witness(bench: Bench, codec: Codec) -> BenchWitness:
    """Start cantools on the databases of a bench."""
    names = {message.name for message in codec.messages}
    used = {message_of(c.signal) for c in bench.channels if c.signal} & names
    if not bench.sensors:
        known = [message.name for message in codec.messages if message.name in used]
        return BenchWitness((Witness(bench.dbc_text, bench.dbc_name, codec, known),))
    databases = stored_databases(bench.dbc_text)
    witnesses = []
    for name in dict.fromkeys(sensor.database for sensor in bench.sensors):
        owners = {sensor.name for sensor in bench.sensors if sensor.database == name}
        messages = [each.partition(".") for each in sorted(used)]
        known = [message for owner, _, message in messages if owner in owners]
        text = database_text(databases, name) or ""  # ensured by bench_codec
        witnesses.append(Witness(text, name, database_codec(text, name), known))
    return BenchWitness(tuple(witnesses))


def reader_lines(reading: WitnessReport) -> list[Finding]:
    """Return a FAIL for each difference; one WARN if cantools cannot read the DBC."""
    if reading.refusal:
        reason = f"values are not compared, because cantools cannot read it: {reading.refusal}"
        advice = "compare some values with the sensors' own tools"
        return [Finding("unread", Severity.WARNING, reason, "DBC", advice)]
    if reading.differences:
        return [
            Finding("readers", Severity.ERROR, each.reason, f"message {each.message}", _ADVICE)
            for each in reading.differences
        ]
    if not reading.compared:
        return []
    reason = f"our reader and cantools read its {counted(reading.compared, 'message')} in use alike"
    return [Finding("readers", Severity.NOTE, reason, "DBC")]
