"""Defines the meaning of each finding and its remedy, for terminal, report and manual."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from dbc.words import Finding, Severity


class Words(NamedTuple):
    """A finding in plain words."""

    title: str
    meaning: str
    """The fault of the run, and why it matters."""
    advice: str
    """The remedy, in one line."""


WORDS: Mapping[str, Words] = {
    "stale": Words(
        "sensor silent",
        "A sensor sent nothing, or no usable value, for a part of the run. What it would have "
        "shown is missing.",
        "check its plug and power, and type, checksum and factor of its signal, then bump again",
    ),
    "lost_frames": Words(
        "frames lost",
        "Frames that were sent never arrived, by the counters in them or by the interface. A "
        "few cost little; many, or a gap while the wheels move, hide the wheels' motion.",
        "check bus load, cable and plugs, then bump again",
    ),
    "overload": Words(
        "overload",
        "A sensor reached the end of its range while the car swung freely: the tops are cut "
        "off, and the true motion was larger. On the bump itself this is harmless.",
        "use a lower bump or a sensor with a wider range",
    ),
    "frozen": Words(
        "sensor frozen",
        "A sensor showed one value while the car moved. The identification leaves such a run "
        'out. If it stays frozen, state quantity = "unused" for it in bench.toml.',
        "switch the sensor off and on, check its linkage, then bump again",
    ),
    "not_at_rest": Words(
        "not at rest before",
        "The car still moved when the bump came. The motion before mixes with the one after.",
        "keep off the car and wait until it is still, then bump again",
    ),
    "too_weak": Words(
        "too weak",
        "The bump is hardly above the noise, or barely reached the trigger's level. "
        "Frequencies and damping cannot be identified well from it.",
        "use a higher bump, or take it faster",
    ),
    "double_bump": Words(
        "bumped twice",
        "A wheel was struck again while the car should swing freely. The decay after a bump "
        "must not be disturbed.",
        "bump once, then keep off the car until the run has ended",
    ),
    "too_strong": Words(
        "too strong",
        "The suspension moved much farther than a bump of the planned height moves it: it "
        "reaches its stops, wheels leave the road, and friction and curves have more effect.",
        "use a lower bump, or state its height in bench.toml (bump_height_mm)",
    ),
    "wrong_mode": Words(
        "wrong bump",
        "The wheels or the body moved as in another kind of bump.",
        "compare boards, blocks or hands with the sketch, then bump again",
    ),
    "not_decayed": Words(
        "not decayed",
        "Much of the motion was left when the run ended: somebody kept the car moving, or the "
        "run is too short for this car.",
        "keep off the car; if that does not help, set a longer post_s in bench.toml",
    ),
    "not_repeatable": Words(
        "unlike the others",
        "The motion differs from the accepted runs of the same kind in size or in course.",
        "bump as before: same speed, same boards, everyone off the car; if the accepted run was "
        "the odd one, reject it",
    ),
    "rest_changed": Words(
        "rest position changed",
        "The car came to rest in another position: friction held it, or a weight slipped.",
        "rock the car and let it settle; check that every weight is bolted",
    ),
    "motion": Words("motion", "Size, frequency and damping of the motion, for information.", ""),
    "no_data": Words(
        "nothing to judge",
        "No channel has samples before and after the bump.",
        "check the sensors and their plugs, then bump again",
    ),
    "bus_lost": Words(
        "bus lost",
        "No more frames came during the run: the bus was unplugged or its power was off.",
        "plug the bus in, check the power of the sensors, then bump again",
    ),
    "cut": Words("cut", "The recorder was stopped during the run.", "bump again"),
}
"""Words by code of the finding, in the order of judging: causes before their effects."""


def finding(
    code: str, passed: bool, value: float, limit: float, unit: str, text: str, subject: str = ""
) -> Finding:
    """Return a finding; a failed one has the table's advice."""
    severity = Severity.NOTE if passed else Severity.ERROR
    advice = "" if passed else WORDS[code].advice
    return Finding(code, severity, text, subject, advice, float(value), float(limit), unit)
