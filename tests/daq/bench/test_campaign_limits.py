from __future__ import annotations

from pathlib import Path

import pytest

from daq.bench.bench_tables import campaign_limits
from daq.bench.config import parse_bench
from daq.errors import InputError


@pytest.mark.parametrize(
    ("key", "accepted", "refused", "limits"),
    [
        ("repeats", ("1", "100"), ("0", "101"), (1.0, 100.0, False)),
        ("bump_height_mm", ("0.001", "0.5", "200.0"), ("0.0", "200.1"), (0.0, 200.0, True)),
        ("accept_after_s", ("0.0", "60.0"), ("-0.01", "60.1"), (0.0, 60.0, False)),
    ],
)
def test_numbers_of_a_campaign_have_a_lowest_and_a_highest(
    key: str,
    accepted: tuple[str, ...],
    refused: tuple[str, ...],
    limits: tuple[float, float, bool],
) -> None:
    for number in accepted:
        parse_bench(f"[campaign]\n{key} = {number}\n", "bench.toml", Path())
    for number in refused:
        with pytest.raises(InputError, match=key):
            parse_bench(f"[campaign]\n{key} = {number}\n", "bench.toml", Path())
    assert campaign_limits(key) == limits
