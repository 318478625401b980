"""The classes of trust: verdict, quality, and what survives of an identification."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import nan

from dbc.finding import Finding, Severity


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
class Loss:
    """The cause for which a parameter is lost."""

    cause: str
    """In words."""
    shift: float = nan
    """Shift of the parameter by the cause, as a share of its value; NaN where that is not known."""


@dataclass(frozen=True, slots=True)
class Survival:
    """The parameters of a result, divided."""

    surviving: tuple[str, ...] = ()
    """Parameters that no cause moves by more than their standard deviation."""
    lost: Mapping[str, Loss] = field(default_factory=dict)
    """The other parameters, each with its cause."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """Judgement of an identification: verdict, findings, goodness of fit."""

    findings: tuple[Finding, ...]
    """The worst first."""
    chi2_per_n: float
    """Mean square residual in units of the noise; 1 if the linear model holds, NaN without a
    fit."""
    chi2_by_run: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """chi2/n of each run and channel."""
    snr_db: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Energy of each mode in the run over the noise, in the order of the modes of the run's mass
    state, dB."""
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


_LISTED = 3


def listed(places: Iterable[str]) -> str:
    """Return the first three different places, and the number of the others."""
    unique = tuple(dict.fromkeys(places))
    text = ", ".join(unique[:_LISTED])
    more = len(unique) - _LISTED
    return f"{text} and {more} more" if more > 0 else text
