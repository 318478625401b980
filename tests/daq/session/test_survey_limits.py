"""What a session file may claim: each limit on both sides, before anything of it is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from daq.errors import InputError
from daq.session.load import load_tree
from daq.session.schema import max_total_bytes
from daq.session.tree import Dataset, Group

Edit = Callable[[h5py.File], Any]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return a file that has no more of a session than its name."""
    path = tmp_path_factory.mktemp("session") / "car.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update({"schema": "bumpbench-session", "schema_version": 1})
        file.create_group("session")
        file.create_group("config")
    return path.read_bytes()


def _claim(shape: tuple[int, ...], **more: Any) -> Edit:
    return lambda file: file["config"].create_dataset("x", shape, **more)


CLAIMS: dict[str, tuple[Edit, str]] = {
    "6 groups deep": (lambda file: file.create_group("a/b/c/d/e/f"), ""),
    "7 groups deep": (lambda file: file.create_group("a/b/c/d/e/f/g"), "more than 6 deep"),
    "text of 4096 bytes": (_claim((1,), dtype="S4096"), ""),
    "text of 4097 bytes": (_claim((1,), dtype="S4097"), "S4097"),
    "signed": (_claim((2,), dtype="i2"), ""),
    "half floats": (_claim((2,), dtype="f2"), ""),
    "complex": (_claim((2,), dtype="c16"), "x has type"),
    "truth values": (_claim((2,), dtype="?"), "x has type"),
    "a single number": (_claim((), dtype="f8"), ""),
    "a table": (_claim((2, 3), dtype="f8"), ""),
    "a cube": (_claim((2, 3, 1), dtype="f8"), "shape"),
    "no shape": (lambda file: file["config"].create_dataset("x", data=h5py.Empty("f8")), "shape"),
    "2 GiB": (_claim((2**28,), dtype="f8", chunks=(1024,)), "datasets claim"),
    "more than 2 GiB": (
        _claim((2**28 + 1,), dtype="f8", chunks=(1024,)),
        "claims 2147483656 bytes",
    ),
    "chunks of 64 MiB": (_claim((1,), dtype="f8", chunks=(2**23,), maxshape=(None,)), ""),
    "larger chunks": (
        _claim((1,), dtype="f8", chunks=(2**23 + 1,), maxshape=(None,)),
        "chunks",
    ),
    "all our filters": (
        _claim((9,), dtype="f8", chunks=(9,), compression="gzip", shuffle=True, fletcher32=True),
        "",
    ),
    "another filter": (_claim((9,), dtype="i4", chunks=(9,), scaleoffset=0), "packed"),
    "a named type": (lambda file: file.__setitem__("t", np.dtype("f8")), "neither"),
}


@pytest.mark.parametrize("name", CLAIMS)
def test_what_a_file_claims(tmp_path: Path, whole: bytes, name: str) -> None:
    edit, why = CLAIMS[name]
    path = tmp_path / "car.h5"
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        edit(file)
    if not why:
        assert load_tree(path).group("session")
        return
    with pytest.raises(InputError, match=why):
        load_tree(path)


def test_all_datasets_together_may_claim_128_mib_and_64_times_the_file(
    tmp_path: Path, whole: bytes
) -> None:
    path = tmp_path / "car.h5"
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        for name in "ab":
            file.create_dataset(name, (2**23 + 40_000,), "f8", chunks=(1024,))
    assert path.stat().st_size < 10_000
    with pytest.raises(InputError, match="datasets claim"):
        load_tree(path)


@pytest.mark.parametrize(
    ("file_bytes", "total"),
    [
        (0, 134_217_728),
        (1, 134_217_792),
        (1 << 20, 134_217_728 + 67_108_864),
        (132_120_576, 8_589_934_592),
        (132_120_577, 8_589_934_592),
    ],
)
def test_how_much_a_file_may_unpack_to(file_bytes: int, total: int) -> None:
    assert max_total_bytes(file_bytes) == total


ATTRIBUTES: dict[str, tuple[Any, Any]] = {
    "text": ("Wagen Ü", "Wagen Ü"),
    "bytes": (np.bytes_(b"car"), "car"),
    "whole": (np.int32(-7), -7),
    "unsigned": (np.uint64(2**63), 2**63),
    "float": (np.float32(0.5), 0.5),
    "several": (np.array([1, 2]), (1, 2)),
    "several texts": (np.array([b"a", b"bc"]), ("a", "bc")),
    "4096 items": (np.zeros(4096), (0.0,) * 4096),
    "4097 items": (np.zeros(4097), None),
    "complex": (1j, None),
    "a table": (np.eye(2), (1.0, 0.0, 0.0, 1.0)),
}


@pytest.mark.parametrize("name", ATTRIBUTES)
def test_attributes_of_simple_types_are_kept(tmp_path: Path, whole: bytes, name: str) -> None:
    value, kept = ATTRIBUTES[name]
    path = tmp_path / "car.h5"
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file["config"].attrs["x"] = value
    assert load_tree(path).group("config").attributes.get("x") == kept


def test_a_tree_names_what_is_absent() -> None:
    inner = Group(datasets={"d": Dataset(np.zeros(2))})
    tree = Group({"a": 1}, {"g": inner}, {"e": Dataset(np.ones(3))})
    assert tree.attribute("a") == 1
    assert tree.group("g") is inner
    assert [d.values.tolist() for d in tree.all_datasets()] == [[1.0] * 3, [0.0] * 2]
    for ask, name in ((tree.group, "x"), (tree.values, "y"), (tree.attribute, "z")):
        with pytest.raises(ValueError, match=f"{name} is absent"):
            ask(name)
