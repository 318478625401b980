from __future__ import annotations

from pathlib import Path

import pytest

from daq.bench.bench_tables import campaign_limits
from daq.bench.config import parse_bench
from daq.errors import InputError


@pytest.mark.parametrize(
    ("key", "accepted", "refused"),
    [
        ("repeats", ("1", "100"), ("0", "101")),
        ("bump_height_mm", ("1.0", "200.0"), ("0.99", "200.1")),
        ("accept_after_s", ("0.0", "60.0"), ("-0.01", "60.1")),
    ],
)
def test_numbers_of_a_campaign_have_a_lowest_and_a_highest(
    key: str, accepted: tuple[str, str], refused: tuple[str, str]
) -> None:
    for number in accepted:
        parse_bench(f"[campaign]\n{key} = {number}\n", "bench.toml", Path())
    for number in refused:
        with pytest.raises(InputError, match=key):
            parse_bench(f"[campaign]\n{key} = {number}\n", "bench.toml", Path())
    assert campaign_limits(key) == tuple(float(number) for number in accepted)
