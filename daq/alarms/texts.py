"""Defines the texts of all alarms: what each means and what to do, in order of severity.

The terminal, the command line and the manual use this table.
"""

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
    """The meaning of an alarm, in words."""

    title: str
    """Title of a few words."""
    meaning: str
    """Observation of the recorder, in one sentence."""
    advice: str
    """Remedy; a symptom may have a more specific one."""
    counted: str = ""
    """Words after the number in the text of an alarm on a counted fault."""


EXPLAINED = MappingProxyType(
    {
        "journal_failed": Explanation(
            "the disk refuses",
            "The disk refuses the journal; frames are held in memory and stored once it takes them",
            "make room on the disk, or mount and plug it again",
        ),
        "not_recording": Explanation(
            "not recording",
            "Frames arrive, and for three seconds none of them was stored on the disk",
            "see the other alarms for the cause; if there is none, restart the recorder and report "
            "it",
        ),
        "disconnected": Explanation(
            "bus disconnected",
            "The adapter or the interface is gone; the recorder tries to open it until it is back",
            "check plug and power of the adapter",
        ),
        "bus_off": Explanation(
            "bus-off",
            "The CAN controller has left the bus after too many transmit errors",
            "check termination, wiring and bit rate; `ip link set can0 type can restart-ms 100` "
            "lets the controller return by itself",
            "reports of bus-off",
        ),
        "interface_down": Explanation(
            "interface down",
            "A person or a driver took the network interface down; frames come again once it is up",
            "`sudo ip link set can0 up` brings it up again",
        ),
        "queue_dropped": Explanation(
            "frames lost in the queue",
            "The writer was too far behind and frames that were received are not recorded",
            "free the processor and the disk of other work",
            "frames received and not recorded",
        ),
        "overrun": Explanation(
            "frames lost in the adapter",
            "The interface reports that it lost frames before they could be read",
            "free the processor of other work; lower the load of the bus",
            "losses reported by the interface",
        ),
        "bus_silent": Explanation(
            "bus silent",
            "The adapter is there, but no frame comes",
            "check cable, power of the sensors and bit rate",
        ),
        "check_bitrate": Explanation(
            "error frames only",
            "Only error frames come, as with a wrong bit rate or a bus without termination",
            "check the bit rate first, then termination (60 ohm between the wires)",
        ),
        "bus_full": Explanation(
            "bus overloaded",
            "The bus is full: messages of low priority come late or never",
            "take other devices off this bus, let sensors send less often, or raise the bit rate",
        ),
        "none_of_dbc": Explanation(
            "nothing of the DBC",
            "Frames come, but none belongs to a message of the DBC",
            "use the DBC of this bus; check whether the buses are swapped",
        ),
        "consumer_failed": Explanation(
            "a part of the recorder failed",
            "Frames are recorded, but a part that evaluates them was switched off after errors",
            "restart the recorder after the run, and report it",
        ),
        "journal_warning": Explanation(
            "trouble with the journal's files",
            "A write failed and was repeated in a new file, or a file was removed",
            "check the disk and which other programs write there; recording continues",
        ),
        "disk_low": Explanation(
            "disk nearly full",
            "The disk is almost full; recording stops before the reserve is used",
            "delete or move old recordings",
        ),
        "stale": Explanation(
            "sensor silent",
            "A message no longer comes, or never came, although the bus works",
            "check plug and power of this sensor",
        ),
        "error_passive": Explanation(
            "error-passive",
            "The CAN controller has counted more than 127 errors; the next state is bus-off",
            "check termination, wiring and bit rate",
        ),
        "wrong_length": Explanation(
            "wrong length",
            "Frames are shorter or longer than the DBC says; missing bytes are not decoded",
            "correct the sensor's settings, or the length in the DBC",
            "frames of wrong length",
        ),
        "crc_bad": Explanation(
            "bad checksum",
            "The checksum in the payload does not match; these samples are not used",
            "check wiring and power of the sensor, and crc_rule in bench.toml",
            "frames with a bad checksum",
        ),
        "counter_gap": Explanation(
            "frames missing",
            "The message's counter jumps: frames were sent but did not arrive",
            "check the load of the bus, wiring and power of the sensor",
            "frames missing by the counter",
        ),
        "saturated": Explanation(
            "sensor overloaded",
            "The value touches the end of the sensor's range: the true peak is not known",
            "bump less hard, or use a sensor with a larger range",
            "samples at the end of the range",
        ),
        "no_value": Explanation(
            "sensor has no value",
            "The sensor itself reports that it has no value, or values are NaN, infinite or above "
            "1e6 in SI, as of no sensor; they are not used",
            "see the sensor's manual: it is starting up, or has found a fault; check type, byte "
            "order and factor of the signal in the DBC",
            "samples without a value",
        ),
        "garbled": Explanation(
            "garbage received",
            "Pieces of the input were not frames",
            "check the adapter's cable, its baud rate and its firmware",
            "pieces that are not frames",
        ),
        "error_frames": Explanation(
            "error frames",
            "The controller reports errors on the wires",
            "check termination (60 ohm between the wires), stubs and plugs",
            "error frames",
        ),
    }
)
"""Texts for every code of `Alarm.code`, the worst first."""

GRAVITY = MappingProxyType({code: place for place, code in enumerate(EXPLAINED)})


def fault(code: str, subject: str, text: str, advice: str = "") -> Finding:
    """Return the symptom of a fault in this cycle, with its usual advice if none is given."""
    return Finding(code, Severity.ERROR, text, subject, advice or EXPLAINED[code].advice)
