"""The result of an identification, which every form of it reads, and its JSON.

Command line, terminal, report, batch row and notebook read `Identification`; `identify --json`
prints `Identification.document`.  A new kind of result is one more field and one more key there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import daq
import dbc
from daq.vehicle import VehicleGeometry

from .fit.estimation import Estimation
from .fit.uncertainty import LARGEST_SHARE, Correlation, Estimate, ModeEstimate
from .model.matrices import PhysicalModel
from .modes.modal_model import ModalModel, Pairing
from .trust.finding import Judgement, Verdict
from .words import unit_text

if TYPE_CHECKING:
    from .nonlinear.forces import Forces

VERSION = "1.0.0"
"""That of pyproject.toml; to look it up in the installed metadata loads a reader of e-mail."""

_PACKAGES = (Path(dbc.__file__).parent, Path(daq.__file__).parent, Path(__file__).parent)


def software_sha256(packages: Sequence[Path] = _PACKAGES) -> str:
    """Return SHA-256 over names and contents of modules and shipped tables in some packages.

    A version says which program it should be; the hash also shows a change made in place.
    """
    whole = sha256()
    endings = (".py", ".toml", ".dbc")  # compiled copies and pages do not affect the numbers
    for folder in packages:
        for path in sorted(path for path in folder.rglob("*") if path.suffix in endings):
            name, content = path.relative_to(folder.parent).as_posix(), path.read_bytes()
            whole.update(b"%s\0%d\0%s" % (name.encode(), len(content), content))
    return whole.hexdigest()


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
    (`identify.model.matrices`)."""
    motion_ratios: Mapping[str, Estimate] = field(default_factory=dict)
    """Fitted motion ratio of each travel whose ratio is stated with a sigma."""
    correlation: Correlation = field(default_factory=lambda: Correlation((), np.zeros((0, 0))))
    """Correlation of the errors of the parameters."""
    drivers: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Runs, facts and stated uncertainties that a parameter's precision rests on; shares of one."""
    modal: Mapping[str, ModalModel] = field(default_factory=dict)
    """Modes of the identified vehicle by mass state, shapes in `daq.vehicle.DOF`."""
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
    """M, C and K of the identified vehicle by mass state."""
    noise: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation of the noise by channel, SI."""
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

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that the runs do not determine."""
        return tuple(name for name, e in self.parameters.items() if not e.determined)

    def document(self, file_sha256: str = "") -> dict[str, Any]:
        """Return the result as JSON: SI units, NaN for what is not determined.

        `file_sha256`: hash of the session file; empty where there is none.
        """
        quality, vague = self.quality, self.undetermined
        std = [
            e.std if (e := self.parameters.get(name)) and e.determined else nan
            for name in self.correlation.names
        ]
        names = list(self.correlation.names)
        covariance = self.correlation.matrix * np.multiply.outer(std, std)
        return {
            "source": {
                "software": f"bumpbench {VERSION}",
                "software_sha256": software_sha256(),
                "session": self.provenance.get("uuid", ""),
                "created": self.provenance.get("created", ""),
                "origin": self.provenance.get("origin", "not stated"),
                "frames_sha256": self.provenance.get("frames_sha256", ""),
                "file_sha256": file_sha256,
            },
            "verdict": str(quality.verdict),
            "reasons": list(quality.reasons),
            "findings": [
                {"gate": f.code, "severity": str(Verdict.of(f.severity)), "text": f.text}
                for f in quality.findings
            ],
            "surviving": list(quality.survival.surviving),
            "lost": {
                name: {"cause": loss.cause, "shift": loss.shift}
                for name, loss in quality.survival.lost.items()
            },
            "chi2_per_n": quality.chi2_per_n,
            "chi2_by_run": {run: dict(row) for run, row in quality.chi2_by_run.items()},
            "parameters": _entries(self.parameters),
            "derived": _entries(self.derived),
            "motion_ratios": _entries(self.motion_ratios),
            "correlation": {"names": names, "matrix": self.correlation.matrix.tolist()},
            "covariance": {"names": names, "matrix": covariance.tolist()},
            "drivers": {
                name: {} if name in vague else dict(shares) for name, shares in self.drivers.items()
            },
            "modes": {
                state: [
                    _mode_entry(name, mode)
                    for name, mode in zip(self.mode_names[state], modes, strict=True)
                ]
                for state, modes in self.modes.items()
            },
            "shapes": {
                state: [{"real": s.real.tolist(), "imag": s.imag.tolist()} for s in model.shapes.T]
                for state, model in self.modal.items()
            },
            "matrices": {
                state: {name: getattr(model, name).tolist() for name in "MCK"}
                for state, model in self.physical.items()
                if not vague
            },
            "paired": {
                state: [
                    {"first": i + 1, "this": j + 1, "mac": mac}
                    for i, j, mac in zip(
                        pairs.baseline.tolist(), pairs.added.tolist(), pairs.mac.tolist(),
                        strict=True,
                    )
                ]
                for state, pairs in self.pairings.items()
            },
            "swapped": {
                state: [[i + 1, j + 1] for i, j in pairs.swapped]
                for state, pairs in self.pairings.items()
            },
            "snr_db": {run: list(row) for run, row in quality.snr_db.items()},
            "sensed_modes": {state: _sensed_entries(model) for state, model in self.sensed.items()},
            "closed_form": dict(self.closed_form),
            "closed_form_damping": {way: dict(c) for way, c in self.closed_form_damping.items()},
            "closed_form_reason": self.closed_form_reason,
            "noise": dict(self.noise),
            "forces": _forces_entry(self.forces) if self.forces else None,
        }  # fmt: skip


def _entries(estimates: Mapping[str, Estimate]) -> dict[str, dict[str, float | str]]:
    return {name: _entry(e) for name, e in estimates.items()}


def _entry(e: Estimate) -> dict[str, float | str]:
    """Return an estimate for JSON: no number for one that is not determined, but why."""
    numbers = (e.value, e.std, e.low, e.high) if e.determined else (nan,) * 4
    return {
        **dict(zip(("value", "std", "low", "high"), numbers, strict=True)),
        "unit": e.unit,
        "reason": _reason(e),
    }


def _reason(e: Estimate) -> str:
    """Return why an estimate has no number; nothing where it has one."""
    if e.determined:
        return ""
    if not isfinite(e.std):
        return "not determined: the runs say nothing of it"
    if e.size > LARGEST_SHARE * abs(e.value):
        return f"not determined: its standard deviation is above {e.size:g} {unit_text(e.unit)}"
    return f"not determined: its standard deviation is above {LARGEST_SHARE * 100:.0f} % of it"


def _mode_entry(name: str, mode: ModeEstimate) -> dict[str, float | str]:
    frequency, damping = _entry(mode.frequency), _entry(mode.damping_ratio)
    return {
        "name": name,
        "frequency_hz": frequency["value"],
        "frequency_std_hz": frequency["std"],
        "frequency_low_hz": frequency["low"],
        "frequency_high_hz": frequency["high"],
        "damping_ratio": damping["value"],
        "damping_ratio_std": damping["std"],
        "damping_ratio_low": damping["low"],
        "damping_ratio_high": damping["high"],
        "reason": frequency["reason"] or damping["reason"],
    }


def _sensed_entries(model: ModalModel) -> list[dict[str, float]]:
    columns = {
        "frequency_hz": model.frequencies_hz,
        "frequency_std_hz": model.frequency_std_hz,
        "damping_ratio": model.damping_ratios,
        "damping_ratio_std": model.damping_ratio_std,
    }
    return [{name: float(row[i]) for name, row in columns.items()} for i in range(len(model))]


def _forces_entry(forces: Forces) -> dict[str, Any]:
    """Return for JSON, by axle, damper curve and elements, and the elements that were tried."""
    from .nonlinear.forces import forces_at_speeds

    axles = {}
    for axle in forces.axles:
        curve = axle.damper
        (low, high), (total_low, total_high) = curve.band_n, curve.total_band_n
        axles[axle.axle] = {
            "damper": {
                "speed_m_s": curve.speed_m_s.tolist(),
                "force_n": curve.force_n.tolist(),
                "force_low_n": low.tolist(),
                "force_high_n": high.tolist(),
                "total_n": curve.total_n.tolist(),
                "total_low_n": total_low.tolist(),
                "total_high_n": total_high.tolist(),
            },
            "at_speeds": [
                {
                    "speed_m_s": point.speed_m_s,
                    "damper": _entry(point.damper),
                    "with_friction": _entry(point.total),
                }
                for point in forces_at_speeds(curve)
            ],
            "elements": _entries(axle.values),
            "notes": list(axle.notes),
        }
    tried = [
        {
            "name": choice.name,
            "gain": choice.gain,
            "threshold": choice.threshold,
            "kept": choice.kept,
            "forced": choice.forced,
            "values": _entries(choice.values),
        }
        for choice in forces.choices
    ]
    return {"law": forces.law, "axles": axles, "elements": tried}
