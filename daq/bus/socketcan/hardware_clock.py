"""Converts the stamps of a CAN adapter's clock to the time of the host.

An adapter stamps frames when they are on the wire, to the microsecond, but with its own clock,
which may count from when it was plugged in and be 50 ppm fast.  The kernel's stamp of the same
frame is in the time of the host, but late by a varying delay.  In each second, the frame with the
least delay shows the difference of the two clocks.  The conversion is corrected by a part of this
difference without a jump, as NTP steers the clock of the host.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

PERIOD_NS = 1_000_000_000
"""Time between two corrections, ns."""
LARGEST_ERROR_NS = 50_000_000
"""Difference of the clocks, ns, above which a clock was set or the adapter was restarted."""
LARGEST_RATE = 1e-3
"""Largest rate difference that is corrected; crystals differ by less than 1e-4."""

_PROPORTIONAL = 0.25e-9
_INTEGRAL = 0.03e-9
"""Gains of the correction: change of rate per ns of error in a period of 1 s.  Together they give a
time constant of 8 s at a damping ratio of 0.7."""


@dataclass(frozen=True, slots=True)
class HardwareClock:
    """The relation of an adapter's clock to that of the host."""

    hardware_ns: int
    """An instant in the adapter's clock, ns."""
    host_ns: int
    """The same instant in the host's clock, ns."""
    rate: float = 0.0
    """Estimated relative rate by which the adapter's clock is slow."""
    steering: float = 0.0
    """Sum of `rate` and the proportional correction of the last error."""
    error_ns: int | None = None
    """Least delay of the kernel's stamps after the converted ones since `hardware_ns`, ns."""


def advance(
    clock: HardwareClock | None, hardware_ns: NDArray[np.int64], kernel_ns: NDArray[np.int64]
) -> tuple[HardwareClock, NDArray[np.int64]]:
    """Return the clock after a block, and the stamps of the block in the time of the host.

    `clock`: None before the first block.  `hardware_ns` and `kernel_ns`, (n,) int64, n > 0: both
    stamps of each frame.
    """
    if clock is None:
        clock = _set(hardware_ns, kernel_ns)
    t_ns = _host_time(clock, hardware_ns)
    error_ns = int((kernel_ns - t_ns).min())
    if abs(error_ns) > LARGEST_ERROR_NS:
        clock = _set(hardware_ns, kernel_ns)
        t_ns, error_ns = _host_time(clock, hardware_ns), 0
    if clock.error_ns is not None:
        error_ns = min(error_ns, clock.error_ns)
    if hardware_ns[-1] - clock.hardware_ns < PERIOD_NS:
        return replace(clock, error_ns=error_ns), t_ns
    rate = _limited(clock.rate + _INTEGRAL * error_ns)
    steering = _limited(rate + _PROPORTIONAL * error_ns)
    return HardwareClock(int(hardware_ns[-1]), int(t_ns[-1]), rate, steering), t_ns


def _set(hardware_ns: NDArray[np.int64], kernel_ns: NDArray[np.int64]) -> HardwareClock:
    first = int(hardware_ns[0])
    return HardwareClock(first, first + int((kernel_ns - hardware_ns).min()))


def _host_time(clock: HardwareClock, hardware_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    since_ns = hardware_ns - clock.hardware_ns
    corrected_ns = np.rint(since_ns * clock.steering).astype(np.int64)
    return np.asarray(clock.host_ns + since_ns + corrected_ns, np.int64)


def _limited(rate: float) -> float:
    return min(max(rate, -LARGEST_RATE), LARGEST_RATE)
