"""The clock of a CAN adapter, told in the time of the host.

An adapter stamps frames when they are on the wire, to the microsecond, but with a clock of its own:
since it was plugged in, say, and some 50 ppm fast.  The kernel's stamp of the same frame is in the
time of the host and late by a delay that varies.  The most punctual frame of each second shows how
far the two have parted, and the adapter's clock is steered by a little: the way NTP steers that of
the host, without a jump.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

PERIOD_NS = 1_000_000_000
"""The clock is steered so often."""
LARGEST_ERROR_NS = 50_000_000
"""Beyond this one of the clocks has been set, or the adapter has been restarted."""
LARGEST_RATE = 1e-3

_PROPORTIONAL = 0.25e-9
_INTEGRAL = 0.03e-9
"""Per ns of error in a period of 1 s; together a time constant of 8 s at a damping of 0.7."""


@dataclass(frozen=True, slots=True)
class HardwareClock:
    """Where an adapter's clock stands."""

    hardware_ns: int
    host_ns: int
    """`hardware_ns`, `host_ns`: one instant in both clocks."""
    rate: float = 0.0
    """By how much the adapter's clock is slow, as learned so far."""
    steering: float = 0.0
    """The same with what is being made up for."""
    error_ns: int | None = None
    """The least that the kernel's stamps were later than the steered clock since `hardware_ns`."""


def advance(
    clock: HardwareClock | None, hardware_ns: NDArray[np.int64], kernel_ns: NDArray[np.int64]
) -> tuple[HardwareClock, NDArray[np.int64]]:
    """Take in the stamps of a block.

    Parameters
    ----------
    clock : HardwareClock or None
        None before the first block.
    hardware_ns, kernel_ns : (n,) int64, n > 0
        Both stamps of each frame.

    Returns
    -------
    clock : HardwareClock
        Where it stands now.
    t_ns : (n,) int64
        The hardware's stamps in the time of the host.
    """
    if clock is None:
        clock = _set(hardware_ns, kernel_ns)
    t_ns = _told(clock, hardware_ns)
    error_ns = int((kernel_ns - t_ns).min())
    if abs(error_ns) > LARGEST_ERROR_NS:
        clock = _set(hardware_ns, kernel_ns)
        t_ns, error_ns = _told(clock, hardware_ns), 0
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


def _told(clock: HardwareClock, hardware_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    since_ns = hardware_ns - clock.hardware_ns
    made_up_ns = np.rint(since_ns * clock.steering).astype(np.int64)
    return np.asarray(clock.host_ns + since_ns + made_up_ns, np.int64)


def _limited(rate: float) -> float:
    return min(max(rate, -LARGEST_RATE), LARGEST_RATE)
