"""Which flat top and which run out of range is named, on runs made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from dbc.finding import Severity
from dbc.samples import Quality
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.trust import saturation
from identify.trust.saturation import saturation_findings

SENSOR, MOVING = (Channel(n, Quantity.BODY_ACCELERATION, "m/s2") for n in ("az", "moving"))


def record(label: str, tops: dict[float, tuple[int, float]]) -> Record:
    """Return noise at 1 kHz with tops at given times; motion at 0.3 s, and a bump of 0.1 s.

    The guard begins with the end of the bump, at 0.4 s.
    """
    values = np.random.default_rng(0).uniform(-30.0, 30.0, 1000)
    for at_s, (n, value) in tops.items():
        values[round(1000 * at_s) : round(1000 * at_s) + n] = value
    moving = np.resize([1.0, 1.0, -1.0, -1.0], 1000)
    moving[300:] += 50.0
    both = ChannelGroup("imu", (SENSOR, MOVING))
    recording = Recording(both, np.arange(1000) / 1000.0, np.column_stack([values, moving]))
    return Record(label, "baseline", 0.1, (recording,))


def group(flags: dict[float, int], channel: str = "az") -> Any:
    """Return samples of 1 kHz of which so many from each of some times on are out of range."""
    quality = np.zeros(1000, dtype=int)
    for at_s, n in flags.items():
        quality[round(1000 * at_s) : round(1000 * at_s) + n] = Quality.OUT_OF_RANGE
    time_s = np.arange(1000) / 1000.0
    return SimpleNamespace(
        name=f"of_{channel}", values={channel: 0}, quality=quality, time_s=time_s
    )


def judged(
    records: list[Record], groups: dict[str, list[Any]] | None = None
) -> list[tuple[str, Severity, str]]:
    runs = [
        SimpleNamespace(label=one.label, groups=(groups or {}).get(one.label, []))
        for one in records
    ]
    session: Any = SimpleNamespace(used_channels=(SENSOR,), accepted=runs)
    return [(f.code, f.severity, f.text) for f in saturation_findings(session, records)]


def test_the_longest_top_of_the_decay_is_named_first() -> None:
    """One on the bump is longer and does not count beside them."""
    tops = {0.35: (20, 50.0), 0.6: (6, 50.0), 0.8: (9, -40.0)}
    ((code, severity, text),) = judged([record("a_1", {0.7: (5, 45.0)}), record("b_1", tops)])
    assert (code, severity) == ("saturation", Severity.WARNING)
    assert ", 9 equal samples at -40 m/s2" in text
    assert text.index("az in b_1") < text.index("az in a_1")


def test_the_longest_top_on_the_bump_is_named() -> None:
    ((code, severity, text),) = judged(
        [record("a_1", {0.31: (5, 50.0), 0.35: (9, -40.0)}), record("b_1", {0.32: (6, 60.0)})]
    )
    assert (code, severity) == ("saturation", Severity.NOTE)
    assert ", 9 equal samples at -40 m/s2" in text


@pytest.mark.parametrize(
    ("first_s", "severity"), [(0.391, Severity.NOTE), (0.399, Severity.WARNING)]
)
def test_a_top_is_of_the_decay_whose_last_sample_lies_in_it(
    first_s: float, severity: Severity
) -> None:
    """Of six samples the last comes 5 ms after the first; the guard begins at 0.400 s."""
    ((_, found, _),) = judged([record("a_1", {first_s: (6, 50.0)})])
    assert found is severity


def test_the_run_with_most_samples_out_of_range_is_counted() -> None:
    runs = [record(f"{kind}_1", {}) for kind in "abc"]
    found = judged(
        runs,
        {
            "a_1": [group({0.1: 3, 0.7: 4})],
            "b_1": [group({0.8: 2})],
            "c_1": [group({0.05: 50}), group({0.6: 30}, "yaw")],  # on the bump; and not used
        },
    )
    ((code, severity, text),) = found
    assert (code, severity) == ("out_of_range", Severity.WARNING)
    assert text.startswith("7 samples")
    assert "of_az in a_1, of_az in b_1;" in text


def test_samples_out_of_range_on_the_bump_are_a_note() -> None:
    runs = [record("a_1", {}), record("b_1", {})]
    found = judged(runs, {"a_1": [group({0.31: 3})], "b_1": [group({0.2: 5})]})
    ((code, severity, text),) = found
    assert (code, severity) == ("out_of_range", Severity.NOTE)
    assert text.startswith("5 samples")
    assert "of_az in a_1, of_az in b_1;" in text


@pytest.mark.parametrize(("at_s", "severity"), [(0.398, Severity.NOTE), (0.402, Severity.WARNING)])
def test_the_decay_counts_from_the_guard_before_it(at_s: float, severity: Severity) -> None:
    ((_, found, _),) = judged([record("a_1", {})], {"a_1": [group({at_s: 1})]})
    assert found is severity


def test_runs_within_their_range_are_not_named() -> None:
    assert judged([record("a_1", {})], {"a_1": [group({})]}) == []


@pytest.mark.parametrize(("last_s", "severity"), [(0.499, Severity.NOTE), (0.5, Severity.WARNING)])
def test_the_sample_with_which_the_guard_begins_is_of_the_decay(
    monkeypatch: pytest.MonkeyPatch, last_s: float, severity: Severity
) -> None:
    """A decay from 0.51 s on has a guard from 0.50 s on."""
    monkeypatch.setattr(saturation, "decay_start_s", lambda _: 0.51)
    first_s = last_s - 0.005
    ((_, top, _),) = judged([record("a_1", {first_s: (6, 50.0)})])
    ((_, outside, _),) = judged([record("a_1", {})], {"a_1": [group({first_s: 6})]})
    assert (top, outside) == (severity, severity)
