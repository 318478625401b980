"""The integrator in use: Numba's machine code where it is installed (extra `fast`), else NumPy.

Both give the same numbers to rounding.
"""

from __future__ import annotations

from importlib.util import find_spec

if find_spec("numba") is not None:
    from .fast import filtered, integrate, sample, seen, tangents
else:
    from .filtered import filtered
    from .linearised import seen, tangents
    from .reference import integrate, sample

__all__ = ["filtered", "integrate", "sample", "seen", "tangents"]
