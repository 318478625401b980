"""Makes machine code of the kernels (Numba), and keeps it for the processes to come.

Numba takes what it has stored for a function as good while the file of that function stays as it
is.  But the code of a kernel also contains the formulas, constants and kernels of other files.  So
the name by which a kernel is stored has the hash of them all.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba import njit

LOOSE = {"reassoc", "contract", "arcp", "nsz"}
"""Rearrangements that the compiler may make; NaN must stay NaN."""

_HERE = Path(__file__).parent
_FILES = ("car", "columns", "compiled", "forcing", "kernels", "lanes")
SOURCES = (
    *sorted((_HERE.parent / "elements").glob("*.py")),
    *(_HERE / f"{name}.py" for name in _FILES),
)
"""All files of which the machine code of a kernel may contain something."""
_HASH = sha256(b"".join(source.read_bytes() for source in SOURCES)).hexdigest()[:16]


def kernel(function: Callable[..., Any]) -> Any:
    """Return a function as machine code; it is made at the first call, or read where it is stored.

    Where no folder can be written, it is not stored.
    """
    function.__qualname__ += f"_{_HASH}"
    compiled = njit(error_model="numpy", fastmath=LOOSE, nogil=True)(function)
    with suppress(RuntimeError):  # neither beside the sources nor in the user's cache
        compiled.enable_caching()
        _forget_others(compiled.stats.cache_path)
    return compiled


@cache
def _forget_others(folder: str) -> None:
    """Remove what is stored of other versions of the sources."""
    for stored in Path(folder).glob("*.nb[ic]"):
        if _HASH not in stored.name:
            with suppress(OSError):  # it may be another user's, or removed by another process
                stored.unlink()
