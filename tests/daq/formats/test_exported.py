"""Exports that stand alone: each read back is the same session, digit for digit."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.io import loadmat

from daq.errors import InputError
from daq.formats.description import NAME, describe, description_of, sidecar_of, text_of
from daq.formats.export import CsvStyle, export_session, format_of
from daq.formats.exported import exported_session
from daq.runs import Run
from daq.sessions import Session
from dbc.frames import FrameBatch

from ..small_session import small_session

SUFFIXES = (".mf4", ".mat", ".parquet", ".csv", ".uff")


@pytest.fixture(scope="module")
def session() -> Session:
    about = {"bench_toml": "name = 'Wagen süß'\n", "dbc": 'VERSION "\udce9"\n', "uuid": "1"}
    whole = small_session()
    odd = replace(whole.runs[0], bump_s=float("nan"))
    return replace(whole, runs=(odd, *whole.runs[1:]), provenance=about)


def _bare(run: Run) -> Run:
    return replace(run, groups=(), frames=FrameBatch.empty(), bump_s=0.0)


def exported(session: Session, folder: Path, suffix: str) -> Path:
    path = folder / f"car{suffix}"
    export_session(session, path, format_of(path))
    return sidecar_of(path) if suffix == ".csv" else path


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_export_is_the_session_again(tmp_path: Path, session: Session, suffix: str) -> None:
    found = exported_session(exported(session, tmp_path, suffix))
    assert found is not None
    assert found.channels == session.channels
    assert found.vehicle == session.vehicle
    assert found.provenance == session.provenance
    for got, state in zip(found.mass_states, session.mass_states, strict=True):
        assert (got.name, got.added.weights) == (state.name, state.added.weights)
        assert_array_equal(got.added.matrix, state.added.matrix)
    for got_run, run in zip(found.runs, session.runs, strict=True):
        assert str(_bare(got_run)) == str(_bare(run))
        assert_array_equal(got_run.bump_s, run.bump_s)
        for got_group, group in zip(got_run.groups, run.groups, strict=True):
            assert got_group.name == group.name
            assert_array_equal(got_group.time_s, group.time_s)
            assert list(got_group.values) == list(group.values)
            for name, values in group.values.items():
                assert_array_equal(got_group.values[name], values)
            assert_array_equal(got_group.quality, group.quality)
            if suffix in (".mf4", ".mat", ".parquet"):
                assert_array_equal(got_group.t_ns, group.t_ns)


def test_csv_in_another_style(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "car.csv"
    export_session(session, path, format_of(path), style=CsvStyle(";", ","))
    found = exported_session(sidecar_of(path))
    assert found is not None
    assert_array_equal(found.runs[0].groups[0].time_s, session.runs[0].groups[0].time_s)


def test_matlab_has_all_of_it_as_structs(tmp_path: Path, session: Session) -> None:
    held = loadmat(exported(session, tmp_path, ".mat"), simplify_cells=True)
    assert held["config"]["bench_toml"] == session.provenance["bench_toml"]
    state = session.mass_states[-1]
    weight = held["mass_states"][state.name]["weights"][0]
    assert weight["mass_kg"] == asdict(state.added.weights[0])["mass_kg"]
    channel = session.channels[0]
    assert held["channels"][channel.name]["delay_s"] == channel.delay_s
    event = held["runs"][session.runs[0].label]["events"]
    assert np.size(event) == len(session.runs[0].events)


def test_mf4_carries_bench_and_databases(tmp_path: Path, session: Session) -> None:
    import asammdf

    with asammdf.MDF(exported(session, tmp_path, ".mf4")) as mdf:
        names = {str(block.file_name) for block in mdf.attachments}
        number = next(
            n for n, block in enumerate(mdf.attachments) if str(block.file_name) == "bench.toml"
        )
        text = mdf.extract_attachment(number)[0]
    assert names == {NAME, "bench.toml", "bench.dbc"}
    shown = text if isinstance(text, str) else bytes(text).decode()
    assert shown == session.provenance["bench_toml"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_damaged_export_is_refused_or_read(tmp_path: Path, session: Session, suffix: str) -> None:
    path = exported(session, tmp_path, suffix)
    raw = path.read_bytes()
    rng = np.random.default_rng(3)
    for n in range(12):
        damaged = bytearray(raw)
        at = int(rng.integers(len(raw)))
        if n % 2:
            del damaged[at:]
        else:
            damaged[at : at + 20] = rng.bytes(20)
        path.write_bytes(damaged)
        with suppress(InputError):  # a change of a value is no damage that can be seen
            exported_session(path)


def test_a_description_is_checked(session: Session) -> None:
    text = text_of(describe(session))
    assert text_of(description_of(text, "a")) == text
    for old, new, why in (
        ('"version": 1', '"version": 2', "version 2"),
        ('"excitation": "roll"', '"excitation": "jump"', r"runs\.0\.excitation"),
        ('"t0_ns"', '"t1_ns"', r"runs\.0\.t0_ns"),
        ("{", "", "the text"),
    ):
        with pytest.raises(InputError, match=why):
            description_of(text.replace(old, new, 1), "a")


def test_a_sidecar_names_no_file_elsewhere(tmp_path: Path, session: Session) -> None:
    sidecar = exported(session, tmp_path, ".csv")
    text = sidecar.read_text("utf-8").replace('"file": "car_', '"file": "../car_', 1)
    sidecar.write_text(text, "utf-8")
    with pytest.raises(InputError, match="not a file next to it"):
        exported_session(sidecar)


def test_a_universal_file_with_a_hole_behind_it_is_not_read_to_its_end(
    tmp_path: Path, session: Session
) -> None:
    path = exported(session, tmp_path, ".uff")
    with path.open("r+b") as file:
        file.truncate(10 << 30)
    began_s = process_time()
    with pytest.raises(InputError, match="has content that is not a dataset"):
        exported_session(path)
    assert process_time() - began_s < 2.0


def test_a_log_without_attachments_is_not_searched_for_one(
    tmp_path: Path, session: Session
) -> None:
    path = tmp_path / "log.mf4"
    header = b"##HD" + bytes(4) + (104).to_bytes(8, "little") + (6).to_bytes(8, "little")
    path.write_bytes(b"MDF     4.10    ".ljust(64, b"\0") + header.ljust(104, b"\0"))
    with path.open("r+b") as file:
        file.truncate(10 << 30)
    began_s = process_time()
    assert exported_session(path) is None
    assert process_time() - began_s < 1.0


def test_an_export_to_csv_is_found_by_the_name_it_was_given(
    tmp_path: Path, session: Session
) -> None:
    export_session(session, tmp_path / "car.csv", format_of(tmp_path / "car.csv"))
    assert not (tmp_path / "car.csv").exists()
    found = exported_session(tmp_path / "car.csv")
    assert found is not None
    assert [run.label for run in found.runs] == [run.label for run in session.runs]
    assert exported_session(tmp_path / "other.csv") is None
