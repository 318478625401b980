"""The noun of the method: what a session says of its vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from daq.html_tables import html_line, html_table

from .fit.estimation import Estimation
from .fit.likelihood import Residuals
from .fit.uncertainty import Correlation, Estimate, ModeEstimate
from .model.matrices import PhysicalModel
from .modes.modal_model import ModalModel
from .modes.pairing import Pairing
from .trust.finding import Quality


@dataclass(frozen=True, slots=True)
class Identification:
    """What a session says of its vehicle."""

    quality: Quality
    """Verdict, findings and goodness of fit."""
    provenance: Mapping[str, str]
    """Of the session."""
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    """The parameters with 95 % intervals (maximum likelihood); empty if no fit was possible."""
    derived: Mapping[str, Estimate] = field(default_factory=dict)
    """What follows from them: loads, radii of gyration, damping ratios
    (`identify.model.derived`)."""
    correlation: Correlation = field(default_factory=lambda: Correlation((), np.zeros((0, 0))))
    """Of the errors of the parameters."""
    drivers: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Which run, fact or stated uncertainty its precision rests on; shares of one."""
    modal: Mapping[str, ModalModel] = field(default_factory=dict)
    """Modes of the identified vehicle, shapes in `daq.vehicle.DOF`."""
    modes: Mapping[str, tuple[ModeEstimate, ...]] = field(default_factory=dict)
    """Their frequencies and damping ratios with intervals, in the same order."""
    mode_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """What moves in each of them (`identify.modes.mode_names`)."""
    pairings: Mapping[str, Pairing] = field(default_factory=dict)
    """How the modes of each further mass state follow from those of the first, by MAC: with mass on
    board, wheel modes that are nearly equal may change their order."""
    sensed: Mapping[str, ModalModel] = field(default_factory=dict)
    """Modes by the State Variable Method alone, shapes in the channels' units."""
    closed_form: Mapping[str, float] = field(default_factory=dict)
    """Parameters by the paper's chain (Eqs. 22-33); empty where it has no answer."""
    closed_form_damping: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Its c_sf and c_sr by each of the three ways to C."""
    physical: Mapping[str, PhysicalModel] = field(default_factory=dict)
    """M, C and K of the identified vehicle."""
    noise: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation of the noise, SI."""
    residuals: tuple[Residuals, ...] = ()
    """Measured less fitted, one for each run."""
    estimation: Estimation | None = None
    """The fit itself, with the decays that it is of; None where none was possible."""

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return _html(self)


def _html(result: Identification) -> str:
    """Return verdict, findings, parameters and modes as HTML."""
    quality = result.quality
    head = f"Verdict: {quality.verdict}"
    if isfinite(quality.chi2_per_n):
        head += f"; chi2/n {quality.chi2_per_n:.3f}"
    parts = [html_line(head)]
    if quality.findings:
        rows = [[f.text, str(f.severity)] for f in quality.findings]
        parts.append(html_table("Findings", ["finding", "severity"], rows))
    if result.parameters:
        rows = [
            [name, *_interval(e), "" if e.unit == "1" else e.unit]
            for name, e in result.parameters.items()
        ]
        columns = ["parameter", "estimate", "95 % interval", "unit"]
        parts.append(html_table("Parameters", columns, rows))
    for state, modes in result.modes.items():
        rows = [
            [name, *_interval(mode.frequency), *_interval(mode.damping_ratio)]
            for name, mode in zip(result.mode_names[state], modes, strict=True)
        ]
        columns = ["mode", "frequency, Hz", "95 % interval", "damping ratio", "95 % interval"]
        parts.append(html_table(f"Modes, {state}", columns, rows))
    return "".join(parts)


def _interval(e: Estimate) -> tuple[str, str]:
    return f"{e.value:.6g}", f"{e.low:.6g} .. {e.high:.6g}" if e.std else "given"
