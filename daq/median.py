"""The median of a few numbers.

NumPy's own loads masked arrays, which takes longer than all medians of an identification.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def median(values: ArrayLike) -> float:
    """Return the median of at least one number, NaN if one of them is NaN."""
    ordered = np.sort(values, axis=None)
    n = len(ordered)
    low, high, last = ordered[[(n - 1) // 2, n // 2, -1]].tolist()  # NaN is sorted to the end
    return float((low + high) / 2.0 if last == last else last)
