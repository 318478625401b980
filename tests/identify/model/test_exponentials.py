"""Exponentials and their sums against plain tables; chi-squared against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.special import chdtrc, chdtri

from daq.vehicle import FORD_GRANADA
from identify.model.chi_squared import chance_of_more, exceeded_by_chance
from identify.model.exponentials import LowPass, Spectrum, series_of, spectrum, waves_of
from identify.model.matrices import physical_model

NO_FILTER = LowPass(np.zeros(0, dtype=complex))
TIMES = np.array([0.0, 0.013, 0.2, 1.7])


def _systems() -> dict[str, NDArray[np.float64]]:
    vehicle = np.asarray(physical_model(FORD_GRANADA).A)
    overdamped = np.array([[0.0, 1.0], [-4.0, -5.0]])  # poles -1 and -4
    equal = np.array([[-1.0, 0.0], [0.0, -1.0 - 1e-12]])
    return {"vehicle": vehicle, "overdamped": overdamped, "equal": equal}


@pytest.mark.parametrize("name", ["vehicle", "overdamped", "equal"])
def test_free_decay_is_the_matrix_exponential(name: str) -> None:
    A = _systems()[name]
    n = len(A)
    modes = spectrum(A)
    rng = np.random.default_rng(1)
    row, x0 = rng.standard_normal(n), rng.standard_normal(n)
    modal = (row @ modes.V) * (modes.W @ x0)
    on_basis = (modes.to_real[:, :n] @ modal).real
    expected = [row @ expm(A * t) @ x0 for t in TIMES]
    np.testing.assert_allclose(modes.basis(TIMES) @ on_basis, expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("name", ["vehicle", "overdamped", "equal"])
def test_slope_of_the_propagator_is_its_derivative(name: str) -> None:
    A = _systems()[name]
    n = len(A)
    modes = spectrum(A)
    rng = np.random.default_rng(2)
    row, x0 = rng.standard_normal(n), rng.standard_normal(n)
    dA = rng.standard_normal((n, n)) * np.abs(A).max() * (A != 0)
    change = modes.change(dA[None])
    seen = modes.outputs((row @ modes.V)[None], change, NO_FILTER)
    plain, timed = modes.propagator_slope(seen, change, modes.W @ x0)
    slope = modes.basis(TIMES) @ modes.on_real_basis(plain, timed)[0, :, 0]
    # The block matrix exponential holds the exact derivative (Van Loan 1978).
    expected = [row @ expm(np.block([[A, dA], [0 * A, A]]) * t)[:n, n:] @ x0 for t in TIMES]
    np.testing.assert_allclose(slope, expected, rtol=1e-7, atol=1e-9 * np.max(np.abs(expected)))


def test_a_motion_without_oscillation_may_come_before_those_with_it() -> None:
    poles = np.array([-2.0, complex(-1.0, 0.5), complex(-1.0, -0.5)])
    whole = np.eye(3, dtype=np.complex128)
    modes = Spectrum(poles, whole, whole, np.zeros((6, 6), dtype=complex), np.array([0, 1]))
    alone, wave = np.exp(-2.0 * TIMES), np.exp(complex(-1.0, 0.5) * TIMES)
    columns = np.column_stack([alone, wave.real, wave.imag])
    np.testing.assert_allclose(modes.basis(TIMES)[:, :3], columns, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(modes.basis(TIMES)[:, 3:], TIMES[:, None] * columns, atol=1e-12)


# Sums over samples without a table are the sums of the table, whatever the times -----------------

RATES = np.array([-1.7 + 6j, -18 + 67j, -3.0, -628 + 628j, 0])
EVEN_S = np.asarray(0.0008 + 0.002000012 * np.arange(1144), dtype=np.float64)
TIMES_EXPONENTIAL_SUMS = {
    "even": (EVEN_S, EVEN_S[:-1] + 1e-4),
    "a gap": (np.delete(EVEN_S, slice(300, 310)), EVEN_S),
    "few": (0.01 * np.arange(20), 0.01 * np.arange(20)),
    "one": (np.array([0.3]), np.array([0.3])),
}


@pytest.mark.parametrize("kind", TIMES_EXPONENTIAL_SUMS)
def test_sums_are_those_of_a_table(kind: str) -> None:
    late_s = 0.003
    rng = np.random.default_rng(3)
    samples = [rng.standard_normal((len(time), 2)) for time in TIMES_EXPONENTIAL_SUMS[kind]]
    seen = []
    for series in series_of(TIMES_EXPONENTIAL_SUMS[kind], samples):
        at = waves_of(series, RATES, late_s)
        mixed, plain = at.grams()
        sums, plain_sums = at.with_samples(), at.sums()
        drawn = rng.standard_normal((2, len(series.members), 2, len(RATES)))
        amplitudes = np.asarray(drawn[0] + 1j * drawn[1], dtype=np.complex128)
        steps, rest = at.values(amplitudes)
        for i, member in enumerate(series.members):
            time, values = TIMES_EXPONENTIAL_SUMS[kind][member] - late_s, samples[member]
            wave = np.exp(np.outer(time, RATES))
            table = np.hstack([wave, time[:, None] * wave])
            for found, expected in (
                (mixed[i], table.conj().T @ table),
                (plain[i], table.T @ table),
                (sums[i], values.T @ table),
                (plain_sums[i], table.sum(axis=0)),
                (series.power[i], np.sum(values**2, axis=0)),
            ):
                np.testing.assert_allclose(
                    found, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max()
                )
            whole = steps[i].swapaxes(1, 2).reshape(-1, 2)
            left = len(time) - len(whole)
            np.testing.assert_allclose(
                np.vstack([whole, rest[i, :left]]), (wave @ amplitudes[i].T).real, atol=1e-12
            )
            seen.append(member)
    assert sorted(seen) == [0, 1]


# Against SciPy's, and against the printed tables -------------------------------------------------


@pytest.mark.parametrize(
    ("freedom", "chance", "value"),
    [(1, 0.05, 3.841), (2, 0.05, 5.991), (3, 0.001, 16.266), (10, 0.01, 23.209)],
)
def test_the_printed_tables(freedom: int, chance: float, value: float) -> None:
    assert exceeded_by_chance(freedom, chance) == pytest.approx(value, abs=5e-4)
    assert chance_of_more(freedom, value) == pytest.approx(chance, rel=1e-3)


@pytest.mark.parametrize("freedom", [1, 2, 7, 40, 301, 2000])
def test_like_scipy_from_one_degree_to_thousands(freedom: int) -> None:
    for chance in (0.05, 1e-3, 1e-6, 1e-12):
        value = exceeded_by_chance(freedom, chance)
        assert value == pytest.approx(chdtri(freedom, chance), rel=1e-12)
        assert chance_of_more(freedom, value) == pytest.approx(chance, rel=1e-9)
    for value in (0.1, 0.5 * freedom, 1.5 * freedom):
        assert chance_of_more(freedom, value) == pytest.approx(chdtrc(freedom, value), rel=1e-9)


def test_nothing_is_less_than_zero() -> None:
    assert chance_of_more(3, 0.0) == 1.0
    assert chance_of_more(0, 0.0) == 1.0
