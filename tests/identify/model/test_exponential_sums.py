"""Sums over samples without a table are the sums of the table, whatever the times."""

from __future__ import annotations

import numpy as np
import pytest

from identify.model.exponential_sums import series_of, waves

RATES = np.array([-1.7 + 6j, -18 + 67j, -3.0, -628 + 628j, 0])
EVEN_S = np.asarray(0.0008 + 0.002000012 * np.arange(1144), dtype=np.float64)
TIMES = {
    "even": (EVEN_S, EVEN_S[:-1] + 1e-4),
    "a gap": (np.delete(EVEN_S, slice(300, 310)), EVEN_S),
    "few": (0.01 * np.arange(20), 0.01 * np.arange(20)),
    "one": (np.array([0.3]), np.array([0.3])),
}


@pytest.mark.parametrize("kind", TIMES)
def test_sums_are_those_of_a_table(kind: str) -> None:
    late_s = 0.003
    rng = np.random.default_rng(3)
    samples = [rng.standard_normal((len(time), 2)) for time in TIMES[kind]]
    seen = []
    for series in series_of(TIMES[kind], samples):
        at = waves(series, RATES, late_s)
        mixed, plain = at.grams()
        sums, plain_sums = at.with_samples(), at.sums()
        drawn = rng.standard_normal((2, len(series.members), 2, len(RATES)))
        amplitudes = np.asarray(drawn[0] + 1j * drawn[1], dtype=np.complex128)
        steps, rest = at.values(amplitudes)
        for i, member in enumerate(series.members):
            time, values = TIMES[kind][member] - late_s, samples[member]
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


def test_recordings_that_are_sampled_alike_are_handled_together() -> None:
    times = [EVEN_S, EVEN_S[:-1]]
    samples = [np.zeros((len(time), 1)) for time in times]
    (series,) = series_of(times, samples)
    assert series.members == (0, 1)
    assert series.count.tolist() == [1144, 1143]
