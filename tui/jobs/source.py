"""The source of a result: session file and its hash, software, date, persons."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # slow to load
    from identify.report import Source

_LIBRARIES = ("numpy", "scipy", "h5py", "matplotlib")


def file_sha256(path: Path) -> str:
    """Return the hash of a session file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def source_of(path: Path, operator: str = "", approver: str = "") -> Source:
    """Return the source of the numbers of a session file, and the persons responsible for them."""
    from importlib.metadata import version

    from identify.report import Source

    digest = file_sha256(path)
    libraries = {name: version(name) for name in _LIBRARIES}
    today = datetime.now(UTC).date().isoformat()
    return Source(path.name, digest, version("bumpbench"), libraries, today, operator, approver)
