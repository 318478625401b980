"""Defines title and advice of all alarms, in order of severity; docs/recorder.md explains them."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from dbc.words import Finding, Severity

Key = tuple[str, str]
"""Code and subject of an alarm."""
Counts = dict[Key, tuple[int, str]]
"""The number of times that each counted fault happened in one cycle, and a detail."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """Title and advice of an alarm."""

    title: str
    """A few words."""
    advice: str
    """The usual remedy; an alarm may have a more specific one."""
    counted: str = ""
    """Words after the number in the text of an alarm on a counted fault."""


EXPLAINED = MappingProxyType(
    {
        "journal_failed": Explanation(
            "the disk refuses", "make room on the disk, or mount and plug it again"
        ),
        "not_recording": Explanation(
            "not recording",
            "see the other alarms for the cause; if there is none, restart the recorder and report "
            "it",
        ),
        "disconnected": Explanation("bus disconnected", "check plug and power of the adapter"),
        "bus_off": Explanation(
            "bus-off",
            "check termination, wiring and bit rate; `ip link set can0 type can restart-ms 100` "
            "lets the controller return by itself",
            "reports of bus-off",
        ),
        "interface_down": Explanation(
            "interface down", "`sudo ip link set can0 up` brings it up again"
        ),
        "queue_dropped": Explanation(
            "frames lost in the queue",
            "free the processor and the disk of other work",
            "frames received and not recorded",
        ),
        "overrun": Explanation(
            "frames lost in the adapter",
            "free the processor of other work; lower the load of the bus",
            "losses reported by the interface",
        ),
        "bus_silent": Explanation("bus silent", "check cable, power of the sensors and bit rate"),
        "check_bitrate": Explanation(
            "error frames only",
            "check the bit rate first, then termination (60 ohm between the wires)",
        ),
        "bus_full": Explanation(
            "bus overloaded",
            "take other devices off this bus, let sensors send less often, or raise the bit rate",
        ),
        "none_of_dbc": Explanation(
            "nothing of the DBC", "use the DBC of this bus; check whether the buses are swapped"
        ),
        "consumer_failed": Explanation(
            "a part of the recorder failed", "restart the recorder after the run, and report it"
        ),
        "journal_warning": Explanation(
            "trouble with the journal's files",
            "check the disk and which other programs write there; recording continues",
        ),
        "disk_low": Explanation("disk nearly full", "delete or move old recordings"),
        "stale": Explanation("sensor silent", "check plug and power of this sensor"),
        "error_passive": Explanation("error-passive", "check termination, wiring and bit rate"),
        "wrong_length": Explanation(
            "wrong length",
            "correct the sensor's settings, or the length in the DBC",
            "frames of wrong length",
        ),
        "crc_bad": Explanation(
            "bad checksum",
            "check wiring and power of the sensor, and crc_rule in bench.toml",
            "frames with a bad checksum",
        ),
        "counter_gap": Explanation(
            "frames missing",
            "check the load of the bus, wiring and power of the sensor",
            "frames missing by the counter",
        ),
        "saturated": Explanation(
            "sensor overloaded",
            "bump less hard, or use a sensor with a larger range",
            "samples at the end of the range",
        ),
        "no_value": Explanation(
            "sensor has no value",
            "see the sensor's manual: it is starting up, or has found a fault; check type, byte "
            "order and factor of the signal in the DBC",
            "samples without a value",
        ),
        "garbled": Explanation(
            "garbage received",
            "check the adapter's cable, its baud rate and its firmware",
            "pieces that are not frames",
        ),
        "error_frames": Explanation(
            "error frames",
            "check termination (60 ohm between the wires), stubs and plugs",
            "error frames",
        ),
    }
)
"""Texts for every code of `Alarm.code`, the worst first."""

RANK = MappingProxyType({code: position for position, code in enumerate(EXPLAINED)})
"""Rank of each code in order of severity, 0 for the worst."""


def fault(code: str, subject: str, text: str, advice: str = "") -> Finding:
    """Return the symptom of a fault in this cycle, with its usual advice if none is given."""
    return Finding(code, Severity.ERROR, text, subject, advice or EXPLAINED[code].advice)
