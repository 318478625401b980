"""Writes Parquet: the table of `Session.to_dataframe` in one file."""

from __future__ import annotations

from pathlib import Path

from ...optional import optional
from ...sessions import Session
from .. import description
from .raw_frames import frames_left_out


def write_parquet(session: Session, path: Path) -> tuple[str, ...]:
    """Write one table: run, group, status, time_s, t_ns, quality, and a column for each channel.

    pandas finds the units in ``DataFrame.attrs["units"]``, other readers in the metadata ``unit``
    of each field.  A channel is null in the rows of other groups.  The metadata of the table have
    the description of the session as ``bumpbench``.

    Returns notes on the contents of the session that the format cannot hold.
    """
    pa = optional("pyarrow", "data")
    parquet = optional("pyarrow.parquet", "data")
    frame = session.to_dataframe()
    table = pa.Table.from_pandas(frame, preserve_index=False)
    units = frame.attrs["units"]
    fields = [
        field.with_metadata({"unit": units[field.name]}) if field.name in units else field
        for field in table.schema
    ]
    about = description.session_text(session)
    own = {description.KEY.encode(): about.encode()}
    schema = pa.schema(fields, metadata={**(table.schema.metadata or {}), **own})
    parquet.write_table(table.cast(schema), path, compression="zstd")
    return frames_left_out(session)
