"""A Parquet data set of the rows of a batch: a folder `vehicle=NAME` for each vehicle."""

from __future__ import annotations

from collections import defaultdict
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from daq.files import replaced

from .newest import Newest, Rows

if TYPE_CHECKING:
    import pyarrow as pa

GROUP = 1000
"""Rows of a group in Parquet: what is in memory at once."""
_FILE = "rows.parquet"
_NO_VEHICLE = "__HIVE_DEFAULT_PARTITION__"
"""Standard name of a partition without a value; failed sessions are in it."""
_KEY = b"bumpbench.rows"


def schema_of(newest: Newest, without: str = "") -> pa.Schema:
    """Return the columns of a table of all rows, as text or float64; one column may be left out."""
    import pyarrow as pa

    names = [name for name in newest.columns if name != without]
    return pa.schema([(n, pa.string() if n in newest.texts else pa.float64()) for n in names])


def write_parquet(path: Path, schema: pa.Schema, rows: Rows) -> None:
    """Write rows to a file, a group at a time."""
    import pyarrow as pa
    from pyarrow import parquet

    with parquet.ParquetWriter(path, schema) as writer:
        while group := list(islice(rows, GROUP)):
            writer.write_table(pa.Table.from_pylist(group, schema))


def write_dataset(folder: Path, newest: Newest) -> None:
    """Bring a data set up to date: only vehicles whose rows have changed are written.

    Every file has all columns, so that a reader that takes the columns from the first file misses
    none; a new column rewrites all files.  Each file is complete or as it was before.  Raises
    OSError.
    """
    schema = schema_of(newest, without="vehicle")
    places: dict[str, list[int]] = defaultdict(list)
    for place, vehicle in newest.vehicles.items():
        places[quote(vehicle, safe=" ") or _NO_VEHICLE].append(place)
    for name, own in places.items():
        key = sha256(repr((own, schema.names)).encode()).hexdigest().encode()
        path = folder / f"vehicle={name}" / _FILE
        if _key_of(path) != key:
            path.parent.mkdir(parents=True, exist_ok=True)
            with replaced([path]) as (part,):
                write_parquet(part, schema.with_metadata({_KEY: key}), newest.rows(own))
    for path in folder.glob(f"vehicle=*/{_FILE}"):
        if path.parent.name.removeprefix("vehicle=") not in places:
            path.unlink()


def _key_of(path: Path) -> bytes | None:
    """Return the key of the rows in a file; None if there is no such file, or it is not ours."""
    from pyarrow import ArrowInvalid, parquet

    try:
        return (parquet.read_schema(path).metadata or {}).get(_KEY)
    except (OSError, ArrowInvalid):
        return None
