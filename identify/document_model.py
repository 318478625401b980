"""Source of a document, and its model as matrices, shapes and covariance."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan
from typing import TypedDict

import numpy as np

from .fit.uncertainty import Correlation, Estimate
from .model.matrices import PhysicalModel
from .modes.modal_model import ModalModel
from .software import VERSION, software_sha256


class CorrelationEntry(TypedDict):
    """Correlation coefficients of the parameters' errors."""

    names: list[str]
    matrix: list[list[float]]


class SourceEntry(TypedDict):
    """Source of the numbers; a text is empty where the session does not state it."""

    software: str
    """Program and version that identified the session."""
    software_sha256: str
    """Hash of the program's modules (`identify.software`)."""
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
