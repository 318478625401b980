"""The integrator in use: Numba's machine code where it is installed (extra `fast`), else NumPy.

Both give the same numbers to rounding.
"""

from __future__ import annotations

from importlib.util import find_spec

if find_spec("numba") is not None:
    from .fast import add_sampled, filtered, integrate, sample, tangents
else:
    from .filtered import filtered
    from .linearised import add_sampled, tangents
    from .reference import integrate, sample

__all__ = ["add_sampled", "filtered", "integrate", "sample", "tangents"]
