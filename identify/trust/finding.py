"""The classes of trust: verdict, quality, and what survives of an identification."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, nan

from dbc.words import Finding, Severity

from ..fit.grey_box import SIGNED

NAMED_SHARE = 0.5
"""Part of a misfit above which what explains it is named as its cause."""


class Verdict(StrEnum):
    """Usability of the parameters."""

    OK = "ok"
    DOUBTFUL = "doubtful"
    """The numbers may be wrong by more than their intervals, or the intervals are wide."""
    REFUSED = "refused"
    """The numbers must not be used."""

    @classmethod
    def of(cls, severity: Severity) -> Verdict:
        """Return the verdict that a finding of this severity requires at least."""
        return tuple(cls)[severity]


@dataclass(frozen=True, slots=True)
class Cause:
    """A likely cause of a misfit; without sizes, a row of `hypotheses.TABLE`."""

    name: str
    """The fault."""
    advice: str = ""
    sizes: str = ""
    """Size of the fault, as text."""
    explained: float = 0.0
    """Part of the excess of the squared residuals that the cause explains; 0 without a misfit."""
    moved: Mapping[str, float] = field(default_factory=dict)
    """Change of each parameter's unknown: relative, or in units of its size in `SIGNED`."""
    certain: bool = False
    """True if it refuses the result even if it moves little: it can be put right."""
    code: str = ""
    """Code of the finding; empty: from the name."""
    kind: str = ""
    """Key of `hypotheses.TABLE`; empty for what was refitted."""
    subject: str = ""
    """Channel or group that it is of."""
    of_bench: bool = False
    """True if it is a fault of a sensor."""
    gain: float = inf
    """Fall of the squared residuals by the cause, in units of the noise."""
    strength: float = inf
    """That fall over what chance gives in one of a million cases."""

    @property
    def shift(self) -> tuple[float, str]:
        """Largest relative change of a parameter by the cause, and that parameter."""
        # A parameter that may be zero has no relative change.
        relative = {n: 0.0 if n in SIGNED else abs(change) for n, change in self.moved.items()}
        parameter = max(relative, key=lambda name: relative[name])
        return relative[parameter], parameter

    @property
    def finding(self) -> Finding:
        """The cause in words: 2 % of a parameter make a result doubtful, 10 % refuse it."""
        largest, parameter = self.shift
        severity = Severity.WARNING if largest > 0.02 else Severity.NOTE
        if self.certain or largest > 0.1:
            severity = Severity.ERROR
        explains = f"explains {min(self.explained, 1.0) * 100:.0f} % of the misfit"
        size = ", ".join(part for part in (self.sizes, explains if self.explained else "") if part)
        moves = f"moves {parameter} by about {min(largest, 1.0) * 100:.1f} %"
        details = f"{size}; {moves}" if size else moves
        text = f"likely cause: {self.name} ({details}): {self.advice}"
        code = self.code or self.name.split(" of ")[0].replace(" ", "_")
        return Finding(code, severity, text)


@dataclass(frozen=True, slots=True)
class Loss:
    """The cause for which a parameter is lost."""

    cause: str
    """In words."""
    shift: float = nan
    """Relative change of the parameter by the cause; NaN where that is not known."""


@dataclass(frozen=True, slots=True)
class Survival:
    """The parameters of a result, divided."""

    surviving: tuple[str, ...] = ()
    """Parameters that no cause moves by more than their standard deviation."""
    lost: Mapping[str, Loss] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Judgement:
    """Judgement of an identification: verdict, findings, goodness of fit."""

    findings: tuple[Finding, ...]
    """The worst first."""
    chi2_per_n: float
    """Mean square residual in units of the noise; 1 if the model holds, NaN without a fit."""
    chi2_by_run: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """chi2/n of each run and channel."""
    snr_db: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Energy of each mode of the run's mass state over the noise, by run, dB."""
    survival: Survival = field(default_factory=Survival)
    """Parameters that can be used, and those that are lost by a cause whose size was estimated."""

    def __post_init__(self) -> None:
        ranked = sorted(self.findings, key=lambda finding: -finding.severity)
        object.__setattr__(self, "findings", tuple(ranked))

    @property
    def verdict(self) -> Verdict:
        """The severity of the worst finding; `ok` if there is none."""
        return Verdict.of(self.findings[0].severity) if self.findings else Verdict.OK

    @property
    def reasons(self) -> tuple[str, ...]:
        """Texts of the findings, the worst first."""
        return tuple(finding.text for finding in self.findings)


def listed(texts: Iterable[str]) -> str:
    """Return the first three different texts, and the number of the others, as one text."""
    unique = tuple(dict.fromkeys(texts))
    first, others = unique[:3], len(unique) - 3
    return ", ".join(first) + (f" and {others} more" if others > 0 else "")
