"""The document of an identification: the JSON from which every form of a result is made.

Command line, terminal, report, batch row and notebook read it; `identify --json` prints it.  A new
kind of result is one more key here and one more line in `Identification.document`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from hashlib import sha256
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import numpy as np

import daq
import dbc
from dbc.finding import Finding

from .fit.uncertainty import COVERAGE_95, LARGEST_SHARE, Correlation, Estimate, ModeEstimate
from .model.matrices import PhysicalModel
from .modes.modal_model import ModalModel, Pairing
from .trust.finding import Loss, Verdict

if TYPE_CHECKING:
    from .nonlinear.forces import DamperCurve, Forces

# The version and the hash of the program that makes the numbers -----------------------------------

VERSION = "0.1.0"
"""That of pyproject.toml; to look it up in the installed metadata loads a reader of e-mail."""

_PACKAGES = (Path(dbc.__file__).parent, Path(daq.__file__).parent, Path(__file__).parent)

_KINDS = (".py", ".toml", ".dbc")
"""Endings of the files that affect the numbers; compiled copies and pages do not."""


@cache
def software_sha256() -> str:
    """Return the hash of the modules of `dbc`, `daq` and `identify` and their shipped tables.

    A version says which program it should be; the hash also shows a change made in place.
    """
    return hash_of(_PACKAGES)


def hash_of(folders: Sequence[Path]) -> str:
    """Return SHA-256 over names and contents of those files in some folders."""
    whole = sha256()
    for folder in folders:
        for path in sorted(_files(folder)):
            name, content = path.removeprefix(f"{folder.parent}/").encode(), Path(path).read_bytes()
            whole.update(b"%s\0%d\0%s" % (name, len(content), content))
    return whole.hexdigest()


def _files(folder: Path) -> Iterator[str]:
    """Yield the files of those kinds; `Path.rglob` takes as long as to read them."""
    for place, _, names in os.walk(folder):
        yield from (f"{place}/{name}" for name in names if name.endswith(_KINDS))


# Source of a document, and its model as matrices, shapes and covariance ---------------------------


class CorrelationEntry(TypedDict):
    """Correlation coefficients of the parameters' errors."""

    names: list[str]
    matrix: list[list[float]]


class SourceEntry(TypedDict):
    """Source of the numbers; a text is empty where the session does not state it."""

    software: str
    """Program and version that identified the session."""
    software_sha256: str
    """Hash of the program's modules (`identify.document`)."""
    session: str
    """Its UUID."""
    created: str
    """Time of the recording, ISO 8601."""
    origin: str
    """`real`, `simulated` or `replayed`."""
    frames_sha256: str
    """Hash of its raw frames."""
    file_sha256: str
    """Hash of the session file; set by the caller that reads the file."""


class MatricesEntry(TypedDict):
    """Mass, damping and stiffness of one mass state, SI, rows and columns as `daq.vehicle.DOF`."""

    M: list[list[float]]
    C: list[list[float]]
    K: list[list[float]]


class ShapeEntry(TypedDict):
    """Shape of one mode in the order of `daq.vehicle.DOF`: m and rad, complex."""

    real: list[float]
    imag: list[float]


def correlation_entry(correlation: Correlation) -> CorrelationEntry:
    """Return names and coefficients."""
    return {"names": list(correlation.names), "matrix": correlation.matrix.tolist()}


def covariance_entry(
    correlation: Correlation, parameters: Mapping[str, Estimate]
) -> CorrelationEntry:
    """Return names and covariances of the parameters."""
    known = [parameters.get(name) for name in correlation.names]
    sigma = np.array([e.std if e is not None and e.determined else nan for e in known])
    matrix = correlation.matrix * np.multiply.outer(sigma, sigma)
    return {"names": list(correlation.names), "matrix": matrix.tolist()}


def source_entry(provenance: Mapping[str, str]) -> SourceEntry:
    """Return where the numbers come from, by the provenance of the session."""
    return {
        "software": f"bumpbench {VERSION}",
        "software_sha256": software_sha256(),
        "session": provenance.get("uuid", ""),
        "created": provenance.get("created", ""),
        "origin": provenance.get("origin", "real"),
        "frames_sha256": provenance.get("frames_sha256", ""),
        "file_sha256": "",
    }


def matrices_entry(model: PhysicalModel) -> MatricesEntry:
    """Return M, C and K of one mass state."""
    return {"M": model.M.tolist(), "C": model.C.tolist(), "K": model.K.tolist()}


def shape_entries(model: ModalModel) -> list[ShapeEntry]:
    """Return the shapes of one mass state."""
    return [{"real": s.real.tolist(), "imag": s.imag.tolist()} for s in model.shapes.T]


# The document -------------------------------------------------------------------------------------


class EstimateEntry(TypedDict):
    """A number in `unit` (1 for a ratio) with its standard deviation and 95 % interval.

    All four are NaN, which JSON writes as null, where the data do not determine it.
    """

    value: float
    std: float
    low: float
    high: float
    unit: str
    reason: str
    """Why there is no number; empty where there is one."""


class FindingEntry(TypedDict):
    """One thing that a gate found; severity `refused`, `doubtful` or `ok`."""

    gate: str
    severity: str
    text: str


class LossEntry(TypedDict):
    """States the cause that makes a parameter useless, and its effect."""

    cause: str
    shift: float
    """Shift of the parameter by the cause, as a share of its value; NaN where that is not known."""


class SensedModeEntry(TypedDict):
    """One mode by the State Variable Method alone."""

    frequency_hz: float
    frequency_std_hz: float
    damping_ratio: float
    damping_ratio_std: float


class ModeEntry(SensedModeEntry):
    """One mode of the identified vehicle with its 95 % intervals."""

    name: str
    frequency_low_hz: float
    frequency_high_hz: float
    damping_ratio_low: float
    damping_ratio_high: float
    reason: str
    """Why there are no numbers (NaN); empty where both are there."""


class PairEntry(TypedDict):
    """A mode of the first mass state and the same mode of another one, numbers from 1."""

    first: int
    this: int
    mac: float
    """Modal assurance criterion of their shapes, 0 to 1."""


class DamperEntry(TypedDict):
    """Force of one damper of an axle over its speed, compression positive, SI."""

    speed_m_s: list[float]
    force_n: list[float]
    """Force of the damper alone."""
    force_low_n: list[float]
    """Lower end of its 95 % band."""
    force_high_n: list[float]
    """Upper end of its 95 % band."""
    total_n: list[float]
    """Force of damper and friction together: right whatever the law of the friction is."""
    total_low_n: list[float]
    """Lower end of its 95 % band."""
    total_high_n: list[float]
    """Upper end of its 95 % band."""


class SpeedEntry(TypedDict):
    """Force of one corner at a standard speed."""

    speed_m_s: float
    damper: EstimateEntry
    with_friction: EstimateEntry


class AxleEntry(TypedDict):
    """The forces of one corner of an axle beyond springs and tyres."""

    damper: DamperEntry
    at_speeds: list[SpeedEntry]
    """Forces at the standard speeds that occurred, from rebound to compression."""
    elements: dict[str, EstimateEntry]
    """Friction, bump stop, mount and the like, where the car has them."""
    notes: list[str]
    """Remarks on what is not determined."""


class ElementEntry(TypedDict):
    """One group of force elements that the fit tried."""

    name: str
    """As in `[vehicle.structure]`."""
    gain: float
    """Fall of the cost with it, in units of the noise."""
    threshold: float
    """Gain above which the element counts as present."""
    kept: bool
    forced: bool
    """True where `[vehicle.structure]` decides."""
    values: dict[str, EstimateEntry]


class ForcesEntry(TypedDict):
    """Forces of a car that is not linear."""

    law: str
    axles: dict[str, AxleEntry]
    """Forces of each axle, by `front` and `rear`."""
    elements: list[ElementEntry]


class Document(TypedDict):
    """An identification as JSON, SI units; its parts are those of `Identification`."""

    source: SourceEntry
    verdict: str
    reasons: list[str]
    findings: list[FindingEntry]
    surviving: list[str]
    """Parameters that no sized cause moves by more than their standard deviation; all of them where
    the verdict is ok."""
    lost: dict[str, LossEntry]
    """The other parameters."""
    chi2_per_n: float
    chi2_by_run: dict[str, dict[str, float]]
    """chi2/n by run and channel."""
    parameters: dict[str, EstimateEntry]
    derived: dict[str, EstimateEntry]
    motion_ratios: dict[str, EstimateEntry]
    """Fitted motion ratios by channel, where one is stated with a sigma."""
    correlation: CorrelationEntry
    covariance: CorrelationEntry
    """Covariance in units of the parameters; null for those that are not determined."""
    drivers: dict[str, dict[str, float]]
    """Shares of the precision, by parameter and source."""
    modes: dict[str, list[ModeEntry]]
    """Modes by mass state, in order of frequency."""
    shapes: dict[str, list[ShapeEntry]]
    """Shapes of these modes, by mass state."""
    matrices: dict[str, MatricesEntry]
    """M, C and K by mass state; empty where a parameter is not determined."""
    paired: dict[str, list[PairEntry]]
    """Pairs of modes by further mass state, in the order of the first."""
    swapped: dict[str, list[list[int]]]
    """Modes of the first mass state that change their order, numbered from 1, by further mass
    state."""
    snr_db: dict[str, list[float]]
    """Energy of each mode over the noise, by run, in the order of the modes of its mass state."""
    sensed_modes: dict[str, list[SensedModeEntry]]
    closed_form: dict[str, float]
    closed_form_damping: dict[str, dict[str, float]]
    """c_sf and c_sr of the closed form by each way to C."""
    closed_form_reason: str
    """Why the closed form has no answer; empty where it has one."""
    noise: dict[str, float]
    """Standard deviation of the noise by channel, SI."""
    forces: ForcesEntry | None
    """Damper curves and other elements; null where the linear model explains the decays."""


def finding_entries(findings: Sequence[Finding]) -> list[FindingEntry]:
    """Return the findings, the worst first."""
    return [
        {"gate": f.code, "severity": str(Verdict.of(f.severity)), "text": f.text} for f in findings
    ]


def survival_lines(document: Document) -> list[str]:
    """Return which parameters survive, and which are lost to which cause, one line each.

    Nothing where the verdict is ok, or where there are no parameters.
    """
    if document["verdict"] == Verdict.OK or not document["parameters"]:
        return []
    by_cause: dict[str, list[str]] = {}
    for name, loss in document["lost"].items():
        size = f" {_percent(loss['shift'])}" if isfinite(loss["shift"]) else ""
        by_cause.setdefault(loss["cause"], []).append(f"{name}{size}")
    kept = ", ".join(document["surviving"])
    word = "usable all the same" if document["verdict"] == Verdict.REFUSED else "usable"
    return [
        f"{word}, moved by no cause that was sized: {kept}" if kept else "usable: none",
        *(f"lost, {cause}: {', '.join(names)}" for cause, names in by_cause.items()),
    ]


def _percent(share: float) -> str:
    """Return a change as signed per cent, not rounded to zero."""
    return f"{share * 100:+.1f} %" if abs(share) >= 0.001 else f"{share * 100:+.1g} %"


def estimate_entries(estimates: Mapping[str, Estimate]) -> dict[str, EstimateEntry]:
    """Return estimates by name; no number for one that is not determined."""
    return {name: _estimate_entry(e) for name, e in estimates.items()}


def _estimate_entry(e: Estimate) -> EstimateEntry:
    if not e.determined:
        return {
            "value": nan, "std": nan, "low": nan, "high": nan, "unit": e.unit,
            "reason": _open(e),
        }  # fmt: skip
    return {
        "value": e.value, "std": e.std, "low": e.low, "high": e.high, "unit": e.unit, "reason": "",
    }  # fmt: skip


def _open(e: Estimate) -> str:
    """Return why an estimate has no number."""
    if not isfinite(e.std):
        return "not determined: the runs say nothing of it"
    if e.size > LARGEST_SHARE * abs(e.value):
        return f"not determined: its standard deviation is above {e.size:g} {unit_text(e.unit)}"
    return f"not determined: its standard deviation is above {LARGEST_SHARE * 100:.0f} % of it"


def loss_entries(lost: Mapping[str, Loss]) -> dict[str, LossEntry]:
    """Return the lost parameters."""
    return {name: {"cause": one.cause, "shift": one.shift} for name, one in lost.items()}


def mode_entries(names: Sequence[str], modes: Sequence[ModeEstimate]) -> list[ModeEntry]:
    """Return the modes of one mass state."""
    return [_mode_entry(name, mode) for name, mode in zip(names, modes, strict=True)]


def _mode_entry(name: str, mode: ModeEstimate) -> ModeEntry:
    frequency, damping = (_estimate_entry(e) for e in (mode.frequency, mode.damping_ratio))
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


def pair_entries(pairing: Pairing) -> list[PairEntry]:
    """Return the pairs of modes of two mass states."""
    return [
        {"first": int(i) + 1, "this": int(j) + 1, "mac": float(mac)}
        for i, j, mac in zip(pairing.baseline, pairing.added, pairing.mac, strict=True)
    ]


def swapped_entries(pairing: Pairing) -> list[list[int]]:
    """Return the numbers, from 1, of the modes that change their order."""
    return [[i + 1, j + 1] for i, j in pairing.swapped]


def sensed_mode_entries(model: ModalModel) -> list[SensedModeEntry]:
    """Return the sensed modes of one mass state."""
    return [
        {
            "frequency_hz": float(model.frequencies_hz[i]),
            "frequency_std_hz": float(model.frequency_std_hz[i]),
            "damping_ratio": float(model.damping_ratios[i]),
            "damping_ratio_std": float(model.damping_ratio_std[i]),
        }
        for i in range(len(model))
    ]


def forces_entry(forces: Forces) -> ForcesEntry:
    """Return damper curves, elements, and which elements were tried."""
    from .nonlinear.forces import forces_at_speeds

    return {
        "law": forces.law,
        "axles": {
            one.axle: {
                "damper": _damper_entry(one.damper),
                "at_speeds": [
                    {
                        "speed_m_s": at.speed_m_s,
                        "damper": _estimate_entry(at.damper),
                        "with_friction": _estimate_entry(at.total),
                    }
                    for at in forces_at_speeds(one.damper)
                ],
                "elements": estimate_entries(one.values),
                "notes": list(one.notes),
            }
            for one in forces.axles
        },
        "elements": [
            {
                "name": choice.name,
                "gain": choice.gain,
                "threshold": choice.threshold,
                "kept": choice.kept,
                "forced": choice.forced,
                "values": estimate_entries(choice.values),
            }
            for choice in forces.choices
        ],
    }


def _damper_entry(curve: DamperCurve) -> DamperEntry:
    low, high = curve.band_n
    half = COVERAGE_95 * curve.total_std_n
    return {
        "speed_m_s": curve.speed_m_s.tolist(),
        "force_n": curve.force_n.tolist(),
        "force_low_n": low.tolist(),
        "force_high_n": high.tolist(),
        "total_n": curve.total_n.tolist(),
        "total_low_n": (curve.total_n - half).tolist(),
        "total_high_n": (curve.total_n + half).tolist(),
    }


def unit_text(unit: str) -> str:
    """Return a unit as it is printed; nothing for a ratio."""
    return "" if unit == "1" else unit
