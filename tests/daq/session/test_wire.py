"""A tree as a stream of bytes: it comes back as it was, or the stream is refused."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import pytest

from daq.errors import InputError
from daq.session.sandbox.wire import receive, send_error, send_tree
from daq.session.tree import Dataset, Group

TREE = Group(
    {"text": "µ", "number": 7, "row": (1.5, 2.5)},
    {"inner": Group({}, {}, {"b": Dataset(np.array([[1, 2], [3, 4]], ">i4").T, {"units": "s"})})},
    {
        "a": Dataset(np.arange(3.0)),
        "empty": Dataset(np.zeros((0, 4), "u1")),
        "names": Dataset(np.array([b"x", b"yz"])),
        "single": Dataset(np.array(5, "u2")),
    },
)


def _sent(tree: Group = TREE) -> bytes:
    stream = io.BytesIO()
    send_tree(stream, tree)
    return stream.getvalue()


def test_a_tree_comes_back_as_it_was() -> None:
    found = receive(io.BytesIO(_sent()), 1 << 20)
    assert found.attributes == TREE.attributes
    assert list(found.datasets) == ["a", "empty", "names", "single"]
    for own, other in zip(found.all_datasets(), TREE.all_datasets(), strict=True):
        assert own.values.dtype == other.values.dtype
        np.testing.assert_array_equal(own.values, other.values)
        assert own.attributes == other.attributes
    assert found.group("inner").values("b").tolist() == [[1, 3], [2, 4]]


def test_an_error_is_raised_where_it_is_received() -> None:
    stream = io.BytesIO()
    send_error(stream, InputError("a.h5", "is damaged", "build it again"))
    stream.seek(0)
    with pytest.raises(InputError) as raised:
        receive(stream, 1)
    error = raised.value
    assert (error.where, error.what, error.advice) == ("a.h5", "is damaged", "build it again")


def test_arrays_may_have_so_many_bytes_together() -> None:
    size = 3 * 8 + 0 + 2 * 2 + 2 + 4 * 4
    assert receive(io.BytesIO(_sent()), size).attributes
    with pytest.raises(ValueError, match="too large"):
        receive(io.BytesIO(_sent()), size - 1)


def test_a_stream_that_breaks_off_is_refused() -> None:
    whole = _sent()
    for cut in (0, 7, 8, 20, len(whole) - 1):
        with pytest.raises(ValueError, match="stopped early"):
            receive(io.BytesIO(whole[:cut]), 1 << 20)


def _stream(datasets: dict[str, Any], data: bytes = b"") -> io.BytesIO:
    head = json.dumps({"tree": {"attributes": {}, "datasets": datasets, "groups": {}}}).encode()
    return io.BytesIO(len(head).to_bytes(8, "little") + head + data)


@pytest.mark.parametrize(
    ("dtype", "shape", "why"),
    [
        ("<c16", [1], "type that no session has"),
        ("O", [1], "type that no session has"),
        ("V8", [1], "type that no session has"),
        ("<f8", [-1], "type that no session has"),
        ("<f8", [-1, -1], "type that no session has"),
        ("<f8", [1 << 28, 2], "too large"),
        ("<f8", [(1 << 28) + 1], "too large"),
        ("<f8", [1 << 28], "stopped early"),
        ("<i8", [2], "stopped early"),
    ],
)
def test_arrays_that_no_session_has_are_refused(dtype: str, shape: list[int], why: str) -> None:
    stream = _stream({"x": {"attributes": {}, "dtype": dtype, "shape": shape}})
    with pytest.raises(ValueError, match=why):
        receive(stream, 1 << 40)


def test_an_outline_has_256_mib_at_most() -> None:
    for size, why in ((256 << 20, "stopped early"), ((256 << 20) + 1, "outline is too large")):
        with pytest.raises(ValueError, match=why):
            receive(io.BytesIO(size.to_bytes(8, "little")), 1)
