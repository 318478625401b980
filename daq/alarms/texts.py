"""The alarms of a recorder: what each means and what to do, in order of gravity.

One table for the terminal, the command line and the manual.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Explanation:
    """The meaning of an alarm, in words."""

    title: str
    """A few words."""
    meaning: str
    """The recorder's observation, in a sentence."""
    advice: str
    """The remedy; a symptom may bring a more exact one of its own."""


EXPLAINED = MappingProxyType(
    {
        "journal_failed": Explanation(
            "the disk refuses",
            "The disk refuses the journal; frames are held in memory and stored once it takes them",
            "make room on the disk, or mount and plug it again",
        ),
        "not_recording": Explanation(
            "not recording",
            "Frames arrive, and for a second none of them was stored on the disk",
            "see the other alarms for the cause; if there is none, restart the recorder and report "
            "it",
        ),
        "disconnected": Explanation(
            "bus disconnected",
            "The adapter or the interface has gone; it is opened again and again until it is back",
            "check plug and power of the adapter",
        ),
        "bus_off": Explanation(
            "bus-off",
            "The CAN controller has left the bus after too many errors of its own sending",
            "check termination, wiring and bit rate; `ip link set can0 type can restart-ms 100` "
            "lets the controller come back by itself",
        ),
        "interface_down": Explanation(
            "interface down",
            "Somebody, or a driver, took the network interface down; frames come again once it is "
            "up",
            "`sudo ip link set can0 up` brings it up again",
        ),
        "queue_dropped": Explanation(
            "frames lost in the queue",
            "The writer was too far behind and frames that were received are not recorded",
            "free the processor and the disk of other work",
        ),
        "overrun": Explanation(
            "frames lost in the adapter",
            "The interface says that it lost frames before they could be read",
            "free the processor of other work; lower the load of the bus",
        ),
        "bus_silent": Explanation(
            "bus silent",
            "The adapter is there, but no frame comes",
            "check cable, power of the sensors and bit rate",
        ),
        "check_bitrate": Explanation(
            "error frames only",
            "Error frames come, and not one good frame: so does a wrong bit rate, or a bus that is "
            "not terminated",
            "check the bit rate first, then termination (60 ohm between the wires)",
        ),
        "bus_full": Explanation(
            "bus overloaded",
            "The bus is full: messages of low priority come late or never",
            "take other devices off this bus, let sensors send less often, or raise the bit rate",
        ),
        "none_of_dbc": Explanation(
            "nothing of the DBC",
            "Frames come, but none is of a message of the DBC",
            "the DBC is not the one of this bus, or the buses are swapped",
        ),
        "consumer_failed": Explanation(
            "a part of the recorder failed",
            "Frames are recorded, but something that looks at them was switched off after errors",
            "restart the recorder after the run, and report it",
        ),
        "journal_warning": Explanation(
            "trouble with the journal's files",
            "A write failed and went into a new file, a file was taken away, or no old recording "
            "may be deleted to make room",
            "look at the disk and at who else writes there; recording goes on",
        ),
        "disk_low": Explanation(
            "disk nearly full",
            "The room on the disk goes to the end; recording stops before the reserve is touched",
            "delete or move old recordings",
        ),
        "stale": Explanation(
            "sensor silent",
            "A message no longer comes, or never came, while the bus is alive",
            "check plug and power of this sensor",
        ),
        "error_passive": Explanation(
            "error-passive",
            "The CAN controller has counted more than 127 errors; bus-off comes next",
            "check termination, wiring and bit rate",
        ),
        "wrong_length": Explanation(
            "wrong length",
            "Frames are shorter or longer than the DBC says; what is not there is not decoded",
            "correct the sensor's settings, or the length in the DBC",
        ),
        "crc_bad": Explanation(
            "bad checksum",
            "The checksum in the payload does not fit; these samples are not used",
            "check wiring and power of the sensor, and crc_rule in bench.toml",
        ),
        "counter_gap": Explanation(
            "frames missing",
            "The message's counter jumps: frames were sent and never came",
            "check the load of the bus, wiring and power of the sensor",
        ),
        "stuck": Explanation(
            "sensor stuck",
            "The raw value does not change by one bit although it must",
            "the sensor is frozen: take its power away and give it back",
        ),
        "saturated": Explanation(
            "sensor overloaded",
            "The value touches the end of the sensor's range: the true peak is not known",
            "bump less hard, or take a sensor of a larger range",
        ),
        "no_value": Explanation(
            "sensor has no value",
            "The sensor itself says that it has no value",
            "see the sensor's manual: it starts up, or has found a fault",
        ),
        "not_a_number": Explanation(
            "not a number",
            "Floating-point values are NaN or infinite; these samples are not used",
            "check the type of the signal in the DBC, and the sensor",
        ),
        "out_of_range": Explanation(
            "out of range",
            "Values lie outside the range that the DBC states",
            "check the sensor, or range and factor in the DBC",
        ),
        "mixed_id": Explanation(
            "identifier mixed up",
            "One identifier comes from two buses, or with the other number of bits than in the DBC",
            "give each sensor its own identifier; set 11 or 29 bits alike in sensor and DBC",
        ),
        "garbled": Explanation(
            "garbage received",
            "Pieces of input were no frame",
            "check the adapter's cable, its baud rate and its firmware",
        ),
        "error_frames": Explanation(
            "error frames",
            "The controller reports errors on the wires",
            "check termination (60 ohm between the wires), stubs and plugs",
        ),
        "queue_high": Explanation(
            "writer behind",
            "The queue between readers and writer fills up; nothing is lost yet",
            "free the processor and the disk of other work",
        ),
        "time_back": Explanation(
            "time stamps go back",
            "Frames carry time stamps earlier than those before them",
            "check the adapter's driver; is the host's clock being set?",
        ),
        "restamped": Explanation(
            "stamped on arrival",
            "The time stamps of the interface cannot be true; frames carry the host's time instead",
            "update the adapter's driver; times are as exact as the host is quick",
        ),
        "clock_step": Explanation(
            "clock set",
            "The host's clock was set; the recorder's waiting times do not depend on it",
            "let the clock be synchronised before measuring",
        ),
        "unknown_id": Explanation(
            "unknown identifiers",
            "Frames come whose identifier is not in the DBC; they are recorded and not decoded",
            "nothing, if these devices are known",
        ),
    }
)
"""Every code of `Alarm.code`; the worst first."""

GRAVITY = MappingProxyType({code: place for place, code in enumerate(EXPLAINED)})
