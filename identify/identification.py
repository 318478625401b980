"""The result of the method, and its JSON document."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from daq.vehicle import VehicleGeometry

from .document import (
    Document,
    correlation_entry,
    covariance_entry,
    estimate_entries,
    finding_entries,
    forces_entry,
    loss_entries,
    matrices_entry,
    mode_entries,
    pair_entries,
    sensed_mode_entries,
    shape_entries,
    source_entry,
    swapped_entries,
)
from .document_html import document_html
from .fit.estimation import Estimation
from .fit.likelihood import Residuals
from .fit.uncertainty import Correlation, Estimate, ModeEstimate
from .model.matrices import PhysicalModel
from .modes.modal_model import ModalModel, Pairing
from .trust.finding import Judgement

if TYPE_CHECKING:
    from .nonlinear.forces import Forces


@dataclass(frozen=True, slots=True)
class Identification:
    """The vehicle as a session shows it: parameters, modes, and how far they can be trusted."""

    quality: Judgement
    """Verdict, findings and goodness of fit."""
    provenance: Mapping[str, str]
    """Provenance of the session."""
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    """The parameters with 95 % intervals (maximum likelihood); empty if no fit was possible."""
    derived: Mapping[str, Estimate] = field(default_factory=dict)
    """Quantities that follow from them: loads, radii of gyration, damping ratios
    (`identify.model.derived`)."""
    motion_ratios: Mapping[str, Estimate] = field(default_factory=dict)
    """Fitted motion ratio of each travel whose ratio is stated with a sigma."""
    correlation: Correlation = field(default_factory=lambda: Correlation((), np.zeros((0, 0))))
    """Correlation of the errors of the parameters."""
    drivers: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Runs, facts and stated uncertainties that a parameter's precision rests on; shares of one."""
    modal: Mapping[str, ModalModel] = field(default_factory=dict)
    """Modes of the identified vehicle, shapes in `daq.vehicle.DOF`."""
    modes: Mapping[str, tuple[ModeEstimate, ...]] = field(default_factory=dict)
    """Their frequencies and damping ratios with intervals, in the same order."""
    mode_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Name of each mode by what moves in it (`identify.modes.modal_model`)."""
    pairings: Mapping[str, Pairing] = field(default_factory=dict)
    """Pairs of the modes of the first mass state with those of each further one, by MAC: with mass
    on board, wheel modes that are nearly equal may change their order."""
    sensed: Mapping[str, ModalModel] = field(default_factory=dict)
    """Modes by the State Variable Method alone, shapes in the channels' units."""
    closed_form: Mapping[str, float] = field(default_factory=dict)
    """Parameters by the paper's chain (Eqs. 22-33); empty where it has no answer."""
    closed_form_damping: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """c_sf and c_sr of that chain by each of the three ways to C."""
    closed_form_reason: str = ""
    """Why that chain has no answer; empty where it has one, or was not asked."""
    physical: Mapping[str, PhysicalModel] = field(default_factory=dict)
    """M, C and K of the identified vehicle."""
    noise: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation of the noise, SI."""
    residuals: tuple[Residuals, ...] = ()
    """Measured less fitted, one for each run."""
    forces: Forces | None = None
    """Damper curves, friction and the other elements of a car that is not linear, and which were
    tried; None where the linear model explains the decays."""
    estimation: Estimation | None = None
    """The fit itself, with its decays; None where no fit was possible."""
    vehicle: str = ""
    """Name of the vehicle, as the session states it."""

    @property
    def geometry(self) -> VehicleGeometry:
        """Estimated places of the wheels; only where a fit was possible."""
        return VehicleGeometry(*(self.parameters[name].value for name in ("a", "b", "t_f", "t_r")))

    def document(self) -> Document:
        """Return the JSON document, from which every printed form is made."""
        quality = self.quality
        lost = {name for name, e in self.parameters.items() if not e.determined}
        return {
            "source": source_entry(self.provenance),
            "verdict": str(quality.verdict),
            "reasons": list(quality.reasons),
            "findings": finding_entries(quality.findings),
            "surviving": list(quality.survival.surviving),
            "lost": loss_entries(quality.survival.lost),
            "chi2_per_n": quality.chi2_per_n,
            "chi2_by_run": {run: dict(row) for run, row in quality.chi2_by_run.items()},
            "parameters": estimate_entries(self.parameters),
            "derived": estimate_entries(self.derived),
            "motion_ratios": estimate_entries(self.motion_ratios),
            "correlation": correlation_entry(self.correlation),
            "covariance": covariance_entry(self.correlation, self.parameters),
            "drivers": {
                name: {} if name in lost else dict(shares) for name, shares in self.drivers.items()
            },
            "modes": {
                state: mode_entries(self.mode_names[state], modes)
                for state, modes in self.modes.items()
            },
            "shapes": {state: shape_entries(model) for state, model in self.modal.items()},
            "matrices": {
                state: matrices_entry(model) for state, model in self.physical.items() if not lost
            },
            "paired": {state: pair_entries(p) for state, p in self.pairings.items()},
            "swapped": {state: swapped_entries(p) for state, p in self.pairings.items()},
            "snr_db": {run: list(row) for run, row in quality.snr_db.items()},
            "sensed_modes": {s: sensed_mode_entries(model) for s, model in self.sensed.items()},
            "closed_form": dict(self.closed_form),
            "closed_form_damping": {way: dict(c) for way, c in self.closed_form_damping.items()},
            "closed_form_reason": self.closed_form_reason,
            "noise": dict(self.noise),
            "forces": forces_entry(self.forces) if self.forces else None,
        }

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return document_html(self.document())
