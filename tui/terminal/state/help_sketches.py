"""Sketches of the decay for each reason to reject a run."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

SKETCHES: Mapping[str, str] = MappingProxyType(
    {
        "double_bump": (
            "   good                       bumped twice\n"
            "    /\\                         /\\      /\\\n"
            "   /  \\    /\\                 /  \\    /  \\   /\\\n"
            "--'    \\  /  `-----        --'    `--'    `-'  `---\n"
            "        \\/                          ^ second bump"
        ),
        "too_weak": (
            "   good                       too weak\n"
            "    /\\\n"
            "   /  \\    /\\\n"
            "--'    \\  /  `-----        --.-'`.-.-'`-.-.-------\n"
            "        \\/                    lost in the noise"
        ),
        "not_at_rest": (
            "   good                       not at rest before\n"
            "    /\\                              /\\\n"
            "   /  \\    /\\                 /\\   /  \\    /\\\n"
            "--'    \\  /  `-----        \\_/  `-'    \\  /  `----\n"
            "        \\/                  ^ still moves \\/"
        ),
        "not_decayed": (
            "   good                       not decayed\n"
            "    /\\                         /\\    /\\    /\\    /\n"
            "   /  \\    /\\                 /  \\  /  \\  /  \\  /\n"
            "--'    \\  /  `-----        --'    \\/    \\/    \\/  |\n"
            "        \\/                                  the end"
        ),
        "overload": (
            "   good                       overload\n"
            "    /\\                        ____  <- end of the range\n"
            "   /  \\    /\\                 /  \\    /\\\n"
            "--'    \\  /  `-----        --'    \\__/  `-----\n"
            "        \\/"
        ),
        "wrong_mode": (
            "   bounce            pitch             roll\n"
            "   all four wheels   front axle        left side\n"
            "   [=]     [=]       [=]     [ ]       [=]     [=]  left\n"
            "   [=]     [=]       [=]     [ ]       [ ]     [ ]  right\n"
            "  front   rear      front   rear      front   rear"
        ),
        "lost_frames": (
            "   sent       1 2 3 4 5 6 7 8 9\n"
            "   recorded   1 2 3     6 7 8 9\n"
            "                    ^ ^ lost: gap in the counter"
        ),
        "stale": (
            "   wheel FL   .-'`-.-'`-.-'`-.\n"
            "   wheel RR   .-'`-.               <- silent from here on"
        ),
    }
)
