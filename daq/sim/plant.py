"""Defines the simulated car: seven degrees of freedom with a force balance, spring by spring.

The matrices of Eqs. 3-10 are not used here; they are assembled in `identify.model.matrices`, and a
test ensures that both agree.  Axes and degrees of freedom are those of `daq.vehicle`.
Displacements are counted from the pose in which every spring and tyre has its free length, so the
loads under gravity follow from the balance and are not given.  Rotations are small: lever arms are
those of the level car.  A tyre can only push: where it would have to pull, the wheel is off the
ground.  Friction, damper curves, bars, stops and other deviations from the linear car are those of
`imperfections`.

Within the arrays of the balance axis 0 is the degree of freedom or the corner and axis 1 is time or
the car, so that one function serves a single instant, a whole record, and several cars at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .dampers import DamperLaw
from .friction import FrictionLaw

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Progression:
    """Nonlinear springs, stops and tyres, by deflections from the unloaded car's rest.

    Arrays are (4, 1) unless stated otherwise, and have n columns for several cars.
    """

    pose: Array
    """(7, 1) Pose of the unloaded car at rest, from the free length of all springs."""
    ride_m: Array
    """Compression of each suspension from its free length in that pose, m."""
    squash_m: Array
    """Compression of each tyre from its free length in that pose, m."""
    quadratic_n_m2: Array
    """Force of the spring per square of the compression above `ride_m`, N/m2."""
    cubic_n_m3: Array
    """Force of the spring per cube of that compression, N/m3."""
    stop_gap_m: Array
    """Compression above `ride_m` at which the bump stop is touched, m."""
    stop_n_m: Array
    """Stiffness of the stop, N/m."""
    tyre_n_m2: Array
    """Force of the tyre per square of the squash above `squash_m`, N/m2."""
    tyre_turn_m: Array
    """Squash relative to `squash_m` below which the square term has no effect, m: a tyre that
    becomes softer as it is relieved does not become stiffer again."""

    def suspension_n(self, compression: Array) -> Array:
        """Return the force of springs and stops in addition to linear springs, N, (4, n)."""
        u = compression - self.ride_m
        bent = (self.quadratic_n_m2 + self.cubic_n_m3 * u) * u * u
        return np.asarray(bent + self.stop_n_m * np.maximum(u - self.stop_gap_m, 0.0))

    def tyre_n(self, squash: Array) -> Array:
        """Return the force of tyres in addition to linear springs, N, (4, n)."""
        beyond = np.maximum(squash - self.squash_m, self.tyre_turn_m)
        return np.asarray(self.tyre_n_m2 * beyond * beyond)


@dataclass(frozen=True, slots=True)
class Mounts:
    """Rubber between dampers and body, in series with the damper; (4, 1) each."""

    stiffness_n_m: Array
    """Stiffness of each mount, N/m; zero if the damper is bolted to the body."""
    elastic: NDArray[np.bool_]
    """True for corners with a mount."""


@dataclass(frozen=True, slots=True)
class Plant:
    """A car in one state of loading, ready for the force balance; or several, side by side."""

    corner_x_m: Array
    """(4, 1) Position at which suspension and body meet, forward of the CG of the baseline body,
    m."""
    corner_y_m: Array
    """(4, 1) Position at which suspension and body meet, to the left of that CG, m."""
    suspension_n_m: Array
    """(4, 1) Stiffness of each corner's spring, N/m."""
    bar_n_m: Array
    """(4, 1) Stiffness of its axle's anti-roll bar, N/m."""
    damper: DamperLaw
    """Force of each damper by its speed."""
    friction: FrictionLaw
    """Friction of each corner."""
    mounts: Mounts | None
    """Rubber in series with the dampers, if there is any."""
    tyre_n_m: Array
    """(4, 1) Stiffness of each tyre, N/m."""
    tyre_damping_ns_m: Array
    """(4, 1) Damping of each tyre, N s/m."""
    weight_n: Array
    """(7, 1) Gravity on each degree of freedom: N, and N m about the baseline CG."""
    inertia: Array
    """(7, 7) Minus the inertia forces of unit accelerations, one column each; kg, kg m, kg m2."""
    mobility: Array
    """(7, 7) Accelerations from forces, the inverse of `inertia`; (n, 7, 7) for several cars."""
    progression: Progression | None = None
    """Progressive stiffness of springs and tyres, if there is any."""

    @property
    def smooth(self) -> bool:
        """True if no force has a kink at standstill or at a gap."""
        return self.damper.straight and self.progression is None and not self.remembers

    @property
    def remembers(self) -> bool:
        """True if forces depend on the past: friction and mounts have their own deflections."""
        return self.friction.present or self.mounts is not None

    def accelerated(self, total_n: Array) -> Array:
        """Return the accelerations that forces make, (7, n)."""
        if self.mobility.ndim == 2:
            return np.asarray(self.mobility @ total_n)
        return np.asarray((self.mobility @ total_n.T[:, :, None])[:, :, 0].T)


@dataclass(frozen=True, slots=True)
class Memory:
    """State of friction and mounts at each corner, (4, n) each."""

    friction: Array
    """Deflection of rubber and seals, relative to the deflection at which the corner slides."""
    mount_m: Array
    """Deflection of the damper's mount, m, positive when its damper pushes body and wheel apart."""


def blank_memory(n: int) -> Memory:
    """Return the memory of `n` cars without memory, or with unloaded friction."""
    return Memory(np.zeros((4, n)), np.zeros((4, n)))


def corner_motion(plant: Plant, body: Array) -> Array:
    """Return the heave of the body at the corners, (4, n), from its three motions, (3, n)."""
    return np.asarray(body[0] - plant.corner_x_m * body[1] + plant.corner_y_m * body[2])


def side_by_side(plants: Sequence[Plant]) -> Plant:
    """Return several cars as one plant with a column for each, to be computed together.

    Raises ValueError if some have knees or progressive springs and others do not.
    """
    joined: dict[str, Any] = {
        f.name: _joined([getattr(plant, f.name) for plant in plants])
        for f in fields(Plant)
        if f.name not in ("inertia", "mobility")
    }
    inertia = np.stack([plant.inertia for plant in plants])
    mobility = np.stack([plant.mobility for plant in plants])
    return Plant(**joined, inertia=inertia, mobility=mobility)


def _joined(parts: Sequence[Any]) -> Any:
    """Return arrays, or dataclasses of arrays, joined as columns."""
    first = parts[0]
    if any(type(part) is not type(first) for part in parts):
        raise ValueError("these cars have different elements")
    if first is None:
        return None
    if isinstance(first, np.ndarray):
        return np.concatenate(parts, axis=-1)
    columns = {f.name: _joined([getattr(part, f.name) for part in parts]) for f in fields(first)}
    return type(first)(**columns)
