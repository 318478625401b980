"""Damaged, changed and misleading session files are refused, implausible ones are named."""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from daq.runs import RunStatus, SampleGroup
from daq.session import read_session, validate_session, write_session
from daq.session.reading import check_session
from daq.sessions import Session
from daq.vehicle import AddedMass, MassState
from dbc.words import InputError, Severity
from tui.cli import run

from ..small_session import small_session
from .test_session import plain

RUN = "runs/r001_baseline_roll_1"
HUB = f"{RUN}/HUB_Front"


SESSION = small_session()


@pytest.fixture(scope="module")
def one_run(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("session") / "car.h5"
    write_session(path, replace(SESSION, runs=SESSION.runs[:1]))
    return path.read_bytes()


@pytest.fixture(scope="module")
def without_checksums(one_run: bytes) -> bytes:
    """Return a file as older programs wrote it."""
    image = BytesIO(one_run)
    with h5py.File(image, "r+") as file:
        for place in ("session", "config", "channels", "mass_states", "runs", RUN):
            del file[place].attrs["content_sha256"]
    return image.getvalue()


@pytest.fixture
def path(tmp_path: Path, one_run: bytes) -> Path:
    (tmp_path / "car.h5").write_bytes(one_run)
    return tmp_path / "car.h5"


def _refused(path: Path, what: str) -> None:
    with pytest.raises(InputError, match=what) as refused:
        read_session(path)
    assert str(refused.value).isprintable()


def _errors(path: Path) -> list[str]:
    found = validate_session(path)
    return [f"{f.where}: {f.text}" for f in found if f.severity is Severity.ERROR]


def _added(path: Path) -> None:
    """Add results: HDF5 drops the checksum of the bytes, and those of the content are left."""
    with h5py.File(path, "r+") as file:
        file["identification/1/x"] = np.zeros(3)


def _all_are_refused(path: Path, damaged: Iterable[bytes]) -> None:
    for raw in damaged:
        path.write_bytes(raw)
        with pytest.raises(InputError):
            read_session(path)


def test_no_flipped_bit_changes_a_session_silently(path: Path) -> None:
    """`make fuzz` tries thousands."""
    written, rng = path.read_bytes(), random.Random(41)
    damaged = []
    for _ in range(40):
        raw = bytearray(written)
        raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
        damaged.append(bytes(raw))
    _all_are_refused(path, damaged)


def test_a_flip_in_the_header_of_a_dataset_that_h5py_does_not_see_is_refused(path: Path) -> None:
    """Length, type and filters of a dataset: h5py gives other values and no error."""
    _added(path)
    whole, written = read_session(path), path.read_bytes()
    truth = whole.runs[0].groups[0].values["hub_fl"]
    with h5py.File(path) as file:
        header = h5py.h5o.get_info(file[f"{HUB}/hub_fl"].id).addr
    silent = []
    for place, bit in product(range(header + 32, header + 130, 4), (0, 5)):
        raw = bytearray(written)
        raw[place] ^= 1 << bit
        noisy = suppress(OSError, RuntimeError, KeyError, ValueError, TypeError)
        with noisy, h5py.File(BytesIO(raw)) as file:
            if not np.array_equal(file[f"{HUB}/hub_fl"][()], truth, equal_nan=True):
                silent.append(bytes(raw))
    assert len(silent) > 2
    _all_are_refused(path, silent)


def test_a_changed_session_is_refused_by_the_commands(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with h5py.File(path, "r+") as file:
        file[f"{HUB}/hub_fl"][100:] = 0.0
    assert run(["inspect", str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"/{RUN} was changed or damaged after the file was written" in line
    assert run(["validate", str(path)]) == 1
    assert f"error: /{RUN}: was changed or damaged" in capsys.readouterr().out


def _incremented(place: str) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        values = file[place][()]
        values.flat[0] += 1
        file[place][...] = values

    return edit


@pytest.mark.parametrize(
    ("edit", "part"),
    [
        (_incremented("mass_states/added/mass_kg"), "/mass_states"),
        (_incremented("config/dbc"), "/config"),
        (_incremented(f"{RUN}/raw_bus0/data"), f"/{RUN}"),
        (lambda file: file[f"{HUB}/hub_fl"].attrs.modify("units", "mm/s2"), f"/{RUN}"),
        (lambda file: file.__delitem__(RUN), "/runs"),
        (lambda file: file[RUN].attrs.modify("content_sha256", "0" * 64), "/runs"),
    ],
)
def test_an_edited_value_name_or_attribute_is_named_with_its_part(
    path: Path, edit: Callable[[h5py.File], None], part: str
) -> None:
    with h5py.File(path, "r+") as file:
        edit(file)
    _refused(path, f"{part} was changed or damaged")
    assert _errors(path)


def test_results_beside_a_session_do_not_change_it(path: Path) -> None:
    before = read_session(path)
    with h5py.File(path, "r+") as file:
        file["identification/1/x"] = np.zeros(3)
        file["identification"].attrs["by"] = "me"
        file.attrs["_NCProperties"] = "version=2"
        file.attrs["link"] = file.ref
    assert plain(read_session(path)) == plain(before)
    assert not _errors(path)


def test_a_session_of_an_older_version_is_read_and_noted(
    path: Path, without_checksums: bytes
) -> None:
    path.write_bytes(without_checksums)
    assert [run.label for run in read_session(path).runs] == [SESSION.runs[0].label]
    (note,) = validate_session(path)
    assert (note.severity, note.where) == (Severity.NOTE, "/")
    assert "has no checksums" in note.text


def _external(file: h5py.File) -> None:
    del file[HUB]["hub_fl"]
    file[HUB].create_dataset("hub_fl", (500,), "f8", external=[("secret.txt", 0, 4000)])


def _virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((500,), "f8")
    layout[:] = h5py.VirtualSource("secret.h5", "x", (500,))
    file[HUB].create_virtual_dataset("other", layout)


def _bomb(file: h5py.File) -> None:
    size = (128 << 20) // 8 + 64 * 200_000
    file["config"].create_dataset("x", (size,), "f8", compression="gzip", chunks=(2**20,))


def _link(file: h5py.File) -> None:
    del file[HUB]["hub_fl"]
    file[f"{HUB}/hub_fl"] = h5py.ExternalLink("secret.h5", "x")


def _new(**more: object) -> Callable[[h5py.File], None]:
    return lambda file: file["config"].create_dataset("x", **more)


@pytest.mark.parametrize(
    ("harm", "what"),
    [
        (_external, "is not a dataset of this file"),
        (_virtual, "is not a dataset of this file"),
        (_link, "was changed or damaged"),
        (_bomb, "too much"),
        (_new(shape=(2**45,), dtype="f8", chunks=(1024,)), "too much"),
        (_new(shape=(1,), dtype="f8", chunks=(2**24,), maxshape=(None,)), "too much"),
        (_new(data=["text"], dtype=h5py.string_dtype()), "x has type object"),
        (_new(data=np.zeros(3, [("a", "f8"), ("b", "i4")])), "which no session has"),
        (_new(data=np.zeros((2, 2, 2))), r"x has shape \(2, 2, 2\)"),
        (_new(data=h5py.Empty("f8")), "x has shape None"),
        (lambda file: file.attrs.modify("schema_version", 2), "has schema version 2"),
        (lambda file: file.attrs.modify("schema", "other"), "not a bench session"),
    ],
)
def test_what_no_session_states_is_refused(
    path: Path, harm: Callable[[h5py.File], None], what: str
) -> None:
    with h5py.File(path, "r+") as file:
        harm(file)
    _refused(path, what)


def test_what_is_no_session_is_refused(tmp_path: Path, path: Path) -> None:
    (tmp_path / "empty.h5").touch()
    (tmp_path / "prose.h5").write_text("no HDF5 \x1b[31m")
    (tmp_path / "cut.h5").write_bytes(path.read_bytes()[:-5000])
    os.mkfifo(tmp_path / "pipe.h5")
    for name, what in {
        "absent.h5": "no such file",
        ".": "is a directory",
        "empty.h5": "is empty",
        "prose.h5": "is not an HDF5 file",
        "cut.h5": "is not an HDF5 file, or is cut off",
        "pipe.h5": "is not a regular file",
    }.items():
        _refused(tmp_path / name, what)


# What breaks the schema in a file of an older or another program ----------------------------------


def _without(name: str) -> Callable[[h5py.File], None]:
    return lambda file: file.__delitem__(name)


def _attribute(place: str, name: str, value: object = None) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        if value is None:
            del file[place].attrs[name]
        else:
            file[place].attrs[name] = value

    return edit


def _instead(name: str, values: object) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        del file[name]
        file[name] = values

    return edit


@pytest.mark.parametrize(
    ("edit", "where", "what"),
    [
        (_without("channels/unit"), "/channels/unit", "is absent"),
        (_instead("channels/gain", np.full(4, b"a")), "/channels/gain", "has type |S1"),
        (_attribute("session", "vehicle"), "/session", "has no attribute vehicle"),
        (_attribute("session", "a_m"), "/session", "has not all of a_m, b_m"),
        (_attribute("session", "structure_symmetric", "yes"), "/session", "not of type int"),
        (
            _instead("mass_states/added/delta_mass", np.eye(6)),
            "/mass_states/added/delta_mass",
            "shape (6, 6)",
        ),
        (_attribute(RUN, "t0_ns", 1.5), f"/{RUN}", "attribute t0_ns 1.5, not of type int"),
        (_attribute(RUN, "sample_groups", "HUB_Front\nX"), f"/{RUN}/X", "is absent"),
        (_without(f"{RUN}/events"), f"/{RUN}/events", "is absent"),
        (
            _instead(f"{RUN}/raw_bus0/data", np.zeros((3, 9), "u1")),
            f"/{RUN}/raw_bus0/data",
            "shape (3, 9)",
        ),
        (
            _instead("channels/name", np.array([b"x", b"hub_fr", b"az", b"pitch"])),
            "/channels",
            "does not describe hub_fl",
        ),
        (_instead("mass_states/added/delta_mass", np.full((7, 7), np.inf)), "/", "not finite"),
        (_instead("channels/x_m", np.zeros(9)), "/", "zip()"),
        (_instead(f"{HUB}/hub_fl", np.zeros(499)), "/", "has shape (499,)"),
        (_attribute(RUN, "excitation", "sneeze"), "/", "sneeze"),
    ],
)
def test_what_breaks_the_schema_is_named(
    path: Path,
    without_checksums: bytes,
    edit: Callable[[h5py.File], None],
    where: str,
    what: str,
) -> None:
    path.write_bytes(without_checksums)
    with h5py.File(path, "r+") as file:
        edit(file)
    findings = [f for f in validate_session(path) if f.severity is Severity.ERROR]
    assert any(f.where == where and what in f.text for f in findings), findings


# What is hard to believe in a session: each limit on both sides -----------------------------------

PLAUSIBLE_RUN = SESSION.runs[0]
IMU = PLAUSIBLE_RUN.groups[1]
PLACE = "/runs/r001_baseline_roll_1"


def _found(**changes: Any) -> list[tuple[str, str]]:
    """Return severity and place of each finding on a session with some parts changed."""
    session: Session = replace(SESSION, **changes)
    return [(f.severity.name.lower(), f.where) for f in check_session(session)]


def _of_run(**changes: Any) -> list[tuple[str, str]]:
    return _found(runs=(replace(PLAUSIBLE_RUN, **changes),))


def test_the_session_itself_is_plausible() -> None:
    assert not _found()
    assert not _found(vehicle=replace(SESSION.vehicle, geometry=None))


def _with_mass(added: AddedMass) -> list[tuple[str, str]]:
    return _found(mass_states=(MassState("baseline"), MassState("added", added)))


@pytest.mark.parametrize(
    ("largest", "apart", "good"),
    [(1, 0.9e-9, True), (1, 1.1e-9, False), (1e6, 0.9e-3, True), (1, np.nan, 0), (1, np.inf, 0)],
)
def test_a_mass_matrix_is_finite_and_symmetric(largest: float, apart: float, good: bool) -> None:
    matrix = largest * np.eye(7)
    matrix[5, 2] = apart
    found = _with_mass(AddedMass(matrix=matrix))
    assert found == ([] if good else [("error", "/mass_states/added")])


def test_a_channel_has_a_sign_and_time_increases() -> None:
    for sign, good in ((-1.0, True), (0.5, False)):
        az = replace(SESSION.channels[2], sign=sign)
        found = _found(channels=(*SESSION.channels[:2], az, SESSION.channels[3]))
        assert found == ([] if good else [("error", "/channels az")])
    for middle_s, good in ((0.125, True), (0.25, False), (np.nan, False)):
        found = _of_run(groups=(replace(IMU, time_s=np.array([0.0, middle_s, 0.25])),))
        assert found == ([] if good else [("error", f"{PLACE}/A_IMU")])


def test_a_channel_without_a_value_is_found() -> None:
    group = PLAUSIBLE_RUN.groups[0]
    silent = replace(group, values={**group.values, "hub_fl": np.full(len(group.time_s), np.nan)})
    assert _of_run(groups=(silent,)) == [("warning", f"/{HUB}/hub_fl")]


def test_an_accepted_run_has_samples() -> None:
    nothing = SampleGroup("A_IMU", np.zeros(0), np.zeros(0, np.int64), {}, np.zeros(0, np.uint8))
    accepted = {"status": RunStatus.ACCEPTED, "reasons": ()}
    assert not _of_run(**accepted, groups=(nothing, PLAUSIBLE_RUN.groups[0]))
    assert _of_run(**accepted, groups=(nothing,)) == [("error", PLACE)]
