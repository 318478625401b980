"""Defines the form in which samples of several channels are passed on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Column = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Time stamps, ns, and values, SI, of one channel, each of shape (n,)."""
SampleBlock = Mapping[str, Column]
"""The columns of some channels, by channel name."""
