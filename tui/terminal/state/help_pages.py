"""Help pages: one a screen, one for each reason to reject a run, one for each alarm.

The pages of screens are Markdown files in `tui/help`; the others come from the recorder's own
tables (`daq.verdict.WORDS`, `daq.alarms.EXPLAINED`), so that they cannot differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from types import MappingProxyType

from daq.alarms import EXPLAINED
from daq.verdict import WORDS

SCREEN_PAGES = (
    "vehicle", "check", "home", "run", "masses", "identify", "results", "report", "sessions",
    "note",
)  # fmt: skip
_NONE = "# Help\n\nThere is no page for this. F1 on another screen shows its help.\n"


def page_of(name: str) -> str:
    """Return a page as Markdown.

    `name`: a screen, or the code of a finding (the reason of a rejected run) or of an alarm.
    """
    if name in SCREEN_PAGES:
        return (files("tui.terminal") / "help" / f"{name}.md").read_text("utf-8")
    pages = []
    if name in WORDS:
        words = WORDS[name]
        kept = "\nNothing is lost: a rejected run is kept and can be taken back.\n"
        title = f"Rejected: {words.title}"
        pages.append(_explained(title, words.meaning, words.advice, SKETCHES.get(name, "")) + kept)
    if name in EXPLAINED:
        alarm = EXPLAINED[name]
        pages.append(_explained(f"Alarm: {alarm.title}", alarm.meaning, alarm.advice, ""))
    return "\n".join(pages) or _NONE


def _explained(title: str, meaning: str, advice: str, sketch: str) -> str:
    drawn = f"\n```{sketch}```\n" if sketch else ""
    return f"# {title}\n\n{_sentence(meaning)}\n{drawn}\n**What to do:** {_sentence(advice)}\n"


def _sentence(text: str) -> str:
    text = text.strip()
    text = f"{text[:1].upper()}{text[1:]}"
    return text if text.endswith((".", "!", "?")) else f"{text}."


SKETCHES: Mapping[str, str] = MappingProxyType(
    {
        "double_bump": r"""
   good                       bumped twice
    /\                         /\      /\
   /  \    /\                 /  \    /  \   /\
--'    \  /  `-----        --'    `--'    `-'  `---
        \/                          ^ second bump
""",
        "too_weak": r"""
   good                       too weak
    /\
   /  \    /\
--'    \  /  `-----        --.-'`.-.-'`-.-.-------
        \/                    lost in the noise
""",
        "not_at_rest": r"""
   good                       not at rest before
    /\                              /\
   /  \    /\                 /\   /  \    /\
--'    \  /  `-----        \_/  `-'    \  /  `----
        \/                  ^ still moves \/
""",
        "not_decayed": r"""
   good                       not decayed
    /\                         /\    /\    /\    /
   /  \    /\                 /  \  /  \  /  \  /
--'    \  /  `-----        --'    \/    \/    \/  |
        \/                                  the end
""",
        "overload": r"""
   good                       overload
    /\                        ____  <- end of the range
   /  \    /\                 /  \    /\
--'    \  /  `-----        --'    \__/  `-----
        \/
""",
        "wrong_mode": r"""
   bounce            pitch             roll
   all four wheels   front axle        left side
   [=]     [=]       [=]     [ ]       [=]     [=]  left
   [=]     [=]       [=]     [ ]       [ ]     [ ]  right
  front   rear      front   rear      front   rear
""",
        "lost_frames": r"""
   sent       1 2 3 4 5 6 7 8 9
   recorded   1 2 3     6 7 8 9
                    ^ ^ lost: gap in the counter
""",
        "frozen": r"""
   wheel FL   .-'`-.-'`-.-'`-.
   wheel RR   .-'--------------    <- one value from here on
""",
        "stale": r"""
   wheel FL   .-'`-.-'`-.-'`-.
   wheel RR   .-'`-.               <- silent from here on
""",
    }
)
