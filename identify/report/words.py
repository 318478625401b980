"""Parameters, gates and states of trust in plain words."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ..trust.finding import Verdict

_PARAMETERS = {
    "m_s": "sprung mass",
    "I_yy": "pitch inertia",
    "I_xx": "roll inertia",
    "m_u": "wheel mass",
    "k_s": "suspension spring",
    "k_t": "tyre spring",
    "c_s": "damper",
    "k_a": "anti-roll bar",
    "c_t": "tyre damping",
    "a": "CG to front axle",
    "b": "CG to rear axle",
    "t_f": "half width, front",
    "t_r": "half width, rear",
    "y_s": "CG left of the middle",
}
_PLACES = {"f": "front", "r": "rear", "fl": "front left", "fr": "front right", "rl": "rear left"}
_PLACES |= {"rr": "rear right"}

SYMBOL: Mapping[Verdict, str] = MappingProxyType(
    {Verdict.OK: "✓", Verdict.DOUBTFUL: "!", Verdict.REFUSED: "✕"}
)
"""Each state has a symbol and a word; colour only helps."""

HEADLINE: Mapping[Verdict, str] = MappingProxyType(
    {
        Verdict.OK: "The parameters may be used.",
        Verdict.DOUBTFUL: "Use the parameters with care.",
        Verdict.REFUSED: "The parameters must not be used.",
    }
)
MEANING: Mapping[Verdict, str] = MappingProxyType(
    {
        Verdict.OK: "The model of the car explains the decays down to the noise of the "
        "sensors, and the intervals hold.",
        Verdict.DOUBTFUL: "They may be wrong by more than their intervals say, or the intervals "
        "are wide. The findings say where, and what to do.",
        Verdict.REFUSED: "The recordings do not support a result. The findings say why, what to "
        "do, and which parameters are usable all the same, if any.",
    }
)
SEVERITY: Mapping[Verdict, str] = MappingProxyType(
    {Verdict.OK: "note", Verdict.DOUBTFUL: "doubt", Verdict.REFUSED: "refused"}
)
NOT_OK = "Where a verdict is not ok, neither intervals nor significances hold."
"""Caution beside a comparison of sessions."""


def parameter_words(name: str) -> str:
    """Return the name of a parameter in words."""
    if name in _PARAMETERS:
        return _PARAMETERS[name]
    return f"{_PARAMETERS[name[:3]]}, {_PLACES[name[3:]]}"


def plain(name: str) -> str:
    """Return a name with spaces instead of underscores."""
    return name.replace("_", " ")
