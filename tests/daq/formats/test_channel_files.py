"""Channels of CSV, MF4, MAT and Parquet: what is read, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from daq.channels import Channel, Quantity
from daq.derive.from_columns import bump_run, bumps_in, recording
from daq.errors import InputError
from daq.formats.columns.read import read_columns
from daq.runs import Excitation, Losses, Run, RunStatus, SampleGroup
from daq.sessions import Session
from daq.vehicle import Corner, MassState, Vehicle
from dbc.frames import FrameBatch

from .channel_files import WRITERS, again, mapped

HUB = """
[[channel]]
name = "hub_fl"
signal = "fl"
quantity = "hub_acceleration"
corner = "FL"
"""
T = np.arange(400) / 200.0
FL = np.sin(9.0 * T)


def _run(repeat: int) -> Run:
    rng = np.random.default_rng(repeat)

    def group(name: str, rate_hz: float, *names: str) -> SampleGroup:
        n = round(3.5 * rate_hz)
        time_s = np.arange(n) / rate_hz + 1e-5 * rng.random(n)
        values = {each: rng.standard_normal(n) for each in names}
        return SampleGroup(
            name, time_s, np.rint(time_s * 1e9).astype(np.int64), values, np.zeros(n, np.uint8)
        )

    groups = (group("HUB", 200.0, "hub_fl", "hub_fr"), group("IMU", 50.0, "az", "pitch"))
    return Run(
        "baseline", Excitation.BOUNCE, repeat, 0, 0.2, groups, RunStatus.ACCEPTED, (), Losses(), (),
        FrameBatch.empty(),
    )  # fmt: skip


@pytest.fixture(scope="module")
def session() -> Session:
    channels = (
        Channel("hub_fl", Quantity.HUB_ACCELERATION, corner=Corner.FRONT_LEFT, delay_s=0.002),
        Channel("hub_fr", Quantity.HUB_ACCELERATION, corner=Corner.FRONT_RIGHT),
        Channel("az", Quantity.BODY_ACCELERATION, x_m=-1.25, position_sigma_m=0.01),
        Channel("pitch", Quantity.PITCH_RATE),
    )
    return Session(Vehicle("car"), channels, (MassState("baseline"),), (_run(1), _run(2)), {})


@pytest.mark.parametrize("suffix", WRITERS)
def test_channels_come_back_digit_for_digit(tmp_path: Path, session: Session, suffix: str) -> None:
    found = again(session, '[vehicle]\nname = "car"\n', tmp_path / f"car{suffix}")
    assert [replace(c, signal="", signal_unit="") for c in found.channels] == list(session.channels)
    assert [run.label for run in found.runs] == ["baseline_bounce_1", "baseline_bounce_2"]
    for got, run in zip(found.runs, session.runs, strict=True):
        assert got.status is RunStatus.ACCEPTED, got.reasons
        for got_group, group in zip(got.groups, run.groups, strict=True):
            assert_allclose(got_group.time_s - 0.03125, group.time_s, rtol=0, atol=1e-13)
            assert list(got_group.values) == list(group.values)
            for name, values in group.values.items():
                assert_array_equal(got_group.values[name], values)


BUMPS = """
[trigger]
level = 3.0
pre_s = 0.5
post_s = 1.0
rest_s = 0.2
"""


def test_the_trigger_finds_the_bumps(tmp_path: Path) -> None:
    import pandas as pd

    t = np.arange(4000) / 500.0
    value = np.zeros(4000)
    for onset in (700, 2700):  # 1.4 s, 5.4 s; the second sample is the second away from rest
        value[onset : onset + 100] = 20.0 * np.sin(np.arange(100) / 5.0 + 0.5)
    path = tmp_path / "a.csv"
    pd.DataFrame({"fl": value, "fr": value}).to_csv(path, index=False)
    known = mapped(path, f'{BUMPS}[time]\nrate_hz = 500.0\n{HUB}signal_unit = "m/s2"\n')
    found = recording(known, read_columns(path, known.columns))
    onsets = bumps_in(known, found)
    assert [event.t_ns for event in onsets] == [1_400_000_000, 5_400_000_000]
    step = known.bench.campaign.steps[0]
    run = bump_run(known, found, step, onsets[1])
    assert (run.t0_ns, run.status) == (4_900_000_000, RunStatus.ACCEPTED)
    assert run.groups[0].time_s[[0, -1]] == pytest.approx([0.0, 1.498], abs=1e-9)
    assert t[2450] == 4.9
    assert_array_equal(run.groups[0].values["hub_fl"], value[2450:3200])
    early = replace(onsets[0], t_ns=200_000_000)
    assert bump_run(known, found, step, early).reasons == (
        "table 500 Hz reaches only from 0.30 to 1.50 s of 1.50 s",
    )


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", r"channel hub_fl: fl has no times in .*state column or rate_hz"),
        ('[time]\ncolumn = "fl"\n', "do not increase after 0.999991 s"),
        ('[time]\ncolumn = "t"\nunit = "g"\n', "its times t are in 'g'"),
        ('[time]\ncolumn = "u"\n', r"has no column 'u' .*it has, among 2: t, fl"),
        ('[time]\ncolumn = "t"\nrate_hz = 5\n', "either column or rate_hz"),
        ('[[run]]\nmass_state="x"\nexcitation="roll"\nstart_s=0\nstop_s=1\n', "'x' is not on this"),
        ("[[run]]\nstart_s=1\nstop_s=1\n", "run.0.mass_state"),
        ('dbc = "a.dbc"\n', "unknown key dbc"),
    ],
)
def test_what_a_map_gets_wrong_is_said(tmp_path: Path, text: str, why: str) -> None:
    import pandas as pd

    path = tmp_path / "a.csv"
    pd.DataFrame({"t": T, "fl": FL}).to_csv(path, index=False)

    def imported() -> object:
        known = mapped(path, f'{text}{HUB}signal_unit = "m/s2"\n')
        return recording(known, read_columns(path, known.columns))

    with pytest.raises(InputError, match=why):
        imported()


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(10 << 30)


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda p: p.write_bytes(b""), "is empty"),
        (lambda p: p.write_text("nothing but\nwords here\n"), "is not a table of numbers"),
        (lambda p: p.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(500)), "is not a table of numbers"),
        (_sparse, "is not a table of numbers"),
        (lambda p: p.write_bytes(b"UnFinMF 4.10"), "was not finished by its logger"),
        (lambda p: p.write_bytes(b"\x89HDF\r\n\x1a\n"), "is HDF5"),
        (lambda p: p.write_text("a\n1\n2\n"), "is not a table of numbers"),
        (lambda p: p.mkdir(), "is not a regular file"),
    ],
)
def test_what_is_no_table_is_refused(
    tmp_path: Path, make: Callable[[Path], object], why: str
) -> None:
    path = tmp_path / "a.csv"
    make(path)
    with pytest.raises(InputError, match=why):
        read_columns(path, ())


@pytest.mark.parametrize(("last", "fits"), [(4_102_444_799.0, True), (4_102_444_800.0, False)])
def test_times_after_2100_are_in_another_unit(tmp_path: Path, last: float, fits: bool) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"t,fl [g]\n{last - 2.0!r},1\n{last - 1.0!r},2\n{last!r},3\n")
    known = mapped(path, f'[time]\ncolumn = "t"\n{HUB}')
    if fits:
        found = recording(known, read_columns(path, known.columns))
        assert found.start_ns == round(last - 2.0) * 1_000_000_000
        return
    with pytest.raises(InputError, match=r"its times t reach 4.1.*after 2100 \(state their unit"):
        recording(known, read_columns(path, known.columns))


def test_a_unit_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,fl [mm]\n0,1\n1,2\n")
    known = mapped(path, f'[time]\ncolumn = "t"\n{HUB}')
    with pytest.raises(InputError, match=r"fl has unit 'mm' in .*a.csv; hub_acceleration needs"):
        recording(known, read_columns(path, known.columns))
