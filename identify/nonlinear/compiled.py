"""Compiles functions by Numba, and keeps the result until a source that they take in changes."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from numba import njit

LOOSE = {"reassoc", "contract", "arcp", "nsz"}
"""Rearrangements that the compiler may make; NaN must stay NaN."""

compiled = njit(cache=True, error_model="numpy", fastmath=LOOSE)
"""Decorator of a function that is compiled at its first call, and kept beside the sources."""

_HERE = Path(__file__).parent
_OWN = ("car", "columns", "compiled", "forcing", "kernels", "lanes")
_TAKEN_IN = (
    *sorted((_HERE.parent / "elements").glob("*.py")),
    *(_HERE / f"{name}.py" for name in _OWN),
)
"""Sources of the compiled functions: formulas, constants, and functions that they call."""


def forget_outdated(sources: Sequence[Path], kept: Path) -> None:
    """Delete what was compiled in a folder from other sources than these.

    Numba compares only the file in which a function is; from a formula of another file it went on
    with the old one.  `kept`: folder of the compiled functions.  Where it cannot be written to,
    Numba does not keep them there.
    """
    note = kept / "compiled.sha256"
    now = sha256(b"\0".join(path.read_bytes() for path in sources)).hexdigest()
    with suppress(OSError):
        if note.exists() and note.read_text("ascii") == now:
            return
        for pattern in ("*.nbi", "*.nbc"):
            for path in kept.glob(pattern):
                path.unlink(missing_ok=True)
        kept.mkdir(exist_ok=True)
        note.write_text(now, "ascii")


forget_outdated(_TAKEN_IN, _HERE / "__pycache__")
