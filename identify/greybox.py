"""The grey box: from a vector of unknowns to the state matrix and output rows of each mass state.

Unknowns are the logarithms of the physical parameters and, where the session states an
uncertainty, small corrections to what is nominally known: the place of a body sensor, the lateness
of a sample clock, the mass of a weight.  Each correction carries its standard uncertainty as a
prior, so that it widens the intervals of the parameters as much as it should and no more.
Derivatives are exact, by a complex step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE, Channel
from daq.vehicle import PARAMETER_NAMES, MassState, VehicleGeometry

from .decay import Clock
from .model import delta_mass, matrices, motion_row, state_matrix

_STEP = 1e-30  # complex step: no subtraction, so no lower limit from rounding


@dataclass(frozen=True, slots=True)
class System:
    """One mass state at one point of the unknowns, with its derivatives.

    Parameters
    ----------
    A : (14, 14) float64
        State matrix.
    dA : (P, 14, 14) float64
        Its derivative by each unknown.
    rows : mapping of channel name to (14,) float64
        Output row: channel = row . state.
    d_rows : mapping of channel name to (P, 14) float64
        Its derivative.
    """

    A: NDArray[np.float64]
    dA: NDArray[np.float64]
    rows: dict[str, NDArray[np.float64]]
    d_rows: dict[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class GreyBox:
    """Structure of the problem: what is unknown, and how it enters.

    Parameters
    ----------
    clocks : tuple of Clock
        Every sample clock of the session.
    mass_states : tuple of MassState
        With their added masses.
    geometry : VehicleGeometry or None
        The four lengths where they are measured; they are then no unknowns.
    """

    clocks: tuple[Clock, ...]
    mass_states: tuple[MassState, ...]
    geometry: VehicleGeometry | None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the physical parameters to be identified, 15 or 11."""
        return PARAMETER_NAMES if self.geometry is None else PARAMETER_NAMES[:11]

    @property
    def _channels(self) -> tuple[Channel, ...]:
        return tuple(channel for clock in self.clocks for channel in clock.channels)

    @property
    def _loose(self) -> tuple[str, ...]:
        """Channels whose mounting position is uncertain."""
        return tuple(c.name for c in self._channels if c.position_sigma_m > 0 and not c.at_cg)

    @property
    def _late(self) -> tuple[int, ...]:
        """Clocks whose lateness is uncertain."""
        return tuple(i for i, clock in enumerate(self.clocks) if clock.delay_sigma_s > 0)

    @property
    def _weights(self) -> tuple[tuple[str, int], ...]:
        """Weights whose mass is uncertain, as (mass state, position in its list)."""
        return tuple(
            (state.name, i)
            for state in self.mass_states
            for i, weight in enumerate(state.added.weights)
            if weight.sigma_kg > 0
        )

    @property
    def prior_sigma(self) -> NDArray[np.float64]:
        """Standard uncertainty of each unknown before any run, (P,); infinite for parameters."""
        by_name = {c.name: c.position_sigma_m for c in self._channels}
        places = [by_name[name] for name in self._loose for _ in "xy"]
        delays = [self.clocks[i].delay_sigma_s for i in self._late]
        states = {state.name: state.added.weights for state in self.mass_states}
        masses = [states[name][i].sigma_kg for name, i in self._weights]
        return np.array([np.inf] * len(self.parameters) + places + delays + masses)

    def unknowns(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the vector of unknowns for 15 parameters and no correction, (P,)."""
        n = len(self.parameters)
        corrections = np.zeros(len(self.prior_sigma) - n)
        return np.concatenate([np.log(theta[:n]), corrections])

    def theta(self, eta: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the 15 parameters at the unknowns `eta`."""
        n = len(self.parameters)
        identified = np.exp(eta[:n])
        if self.geometry is None:
            return identified
        g = self.geometry
        return np.concatenate([identified, [g.a, g.b, g.t_f, g.t_r]])

    def delays_s(self, eta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the lateness of each clock beyond its nominal one, (n_clocks,) s."""
        delays = np.zeros(len(self.clocks))
        first = len(self.parameters) + 2 * len(self._loose)
        delays[list(self._late)] = eta[first : first + len(self._late)]
        return delays

    def delay_index(self, clock: int) -> int | None:
        """Return which unknown is the lateness of a clock, None if it is exact."""
        if clock not in self._late:
            return None
        return len(self.parameters) + 2 * len(self._loose) + self._late.index(clock)

    def system(self, eta: NDArray[np.float64], mass_state: str) -> System:
        """Return state matrix, output rows and their derivatives for one mass state."""
        state = next(s for s in self.mass_states if s.name == mass_state)
        real = eta.astype(complex)
        A, rows = self._evaluate(real, state)
        dA, d_rows = [], []
        for p in range(len(eta)):
            stepped = real.copy()
            stepped[p] += 1j * _STEP
            A_p, rows_p = self._evaluate(stepped, state)
            dA.append(A_p.imag / _STEP)
            d_rows.append(rows_p.imag / _STEP)
        names = [channel.name for channel in self._channels]
        by_channel = np.array(d_rows)  # (P, n_channels, 14)
        return System(
            A.real,
            np.array(dA),
            dict(zip(names, rows.real, strict=True)),
            {name: by_channel[:, i] for i, name in enumerate(names)},
        )

    def _evaluate(
        self, eta: NDArray[np.complex128], state: MassState
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        theta = self.theta(eta)
        M, C, K = matrices(theta)
        first = len(self.parameters) + 2 * len(self._loose) + len(self._late)
        masses = np.array([w.mass_kg for w in state.added.weights], dtype=complex)
        for p, (name, i) in enumerate(self._weights, start=first):
            if name == state.name:
                masses[i] += eta[p]
        A = state_matrix(M + delta_mass(state.added, theta[11], masses), C, K)
        return A, np.array([self._row(channel, eta, theta, A) for channel in self._channels])

    def _row(
        self,
        channel: Channel,
        eta: NDArray[np.complex128],
        theta: NDArray[np.complex128],
        A: NDArray[np.complex128],
    ) -> NDArray[np.complex128]:
        """Return the output row of a channel on the state (X, dX/dt), (14,)."""
        x, y = self._place(channel, eta, theta[11])
        row = motion_row(channel, x, y, theta[11:])
        zero = np.zeros(len(row))
        match TIME_DERIVATIVE[channel.quantity]:
            case 2:
                return np.asarray(row @ A[len(row) :])
            case 1:
                return np.concatenate([zero, row])
        return np.concatenate([row, zero])

    def _place(
        self, channel: Channel, eta: NDArray[np.complex128], a: complex
    ) -> tuple[complex, complex]:
        """Return where a body channel sits from the CG, m."""
        if channel.at_cg:
            return 0.0, 0.0
        x, y = channel.x_m + a, complex(channel.y_m)
        if channel.name in self._loose:
            p = len(self.parameters) + 2 * self._loose.index(channel.name)
            x, y = x + eta[p], y + eta[p + 1]
        return x, y
