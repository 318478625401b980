"""Session files: HDF5, schema v1.

    /                      Conventions, schema, schema_version
    /session               attributes: vehicle, known geometry, provenance
    /config                DBC and bench.toml as bytes, each with its SHA-256
    /channels              one column a property, one row a channel
    /mass_states/NAME      weights as columns; delta_mass (7, 7) given directly
    /runs/r001_LABEL       verdict, losses and t0 as attributes
        GROUP              one sample clock: time [s], t_ns, SI values, quality flags
        raw_bus0           the frames as received
        events             what happened

Simple types only, so that xarray, netCDF-C, MATLAB and h5dump read it alike.  A file is complete or
absent: it is written beside its place and moved there.
"""

from __future__ import annotations

from .findings import Finding, Severity
from .read import read_foreign_session, read_session
from .validate import validate_session
from .write import write_session

__all__ = [
    "Finding",
    "Severity",
    "read_foreign_session",
    "read_session",
    "validate_session",
    "write_session",
]
