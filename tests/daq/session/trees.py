"""The tree of a session file, whole or with one thing in it changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from numpy.typing import NDArray

from daq.session import write_session
from daq.session.load import load_tree
from daq.session.tree import Dataset, Group

from ..small_session import small_session

RUN = "runs/r001_baseline_roll_1"
HUB = f"{RUN}/HUB_Front"
RAW = f"{RUN}/raw_bus0"


@cache
def tree() -> Group:
    """Return the tree of a session with one run."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "car.h5"
        session = small_session()
        write_session(path, replace(session, runs=session.runs[:1]))
        return load_tree(path)


def changed(group: Group, path: str, change: Callable[[Group], Group]) -> Group:
    """Return a tree with another group in the place of the one at a path."""
    if not path:
        return change(group)
    name, _, rest = path.partition("/")
    inner = changed(group.groups[name], rest, change)
    return replace(group, groups={**group.groups, name: inner})


def attribute(path: str, name: str, value: Any) -> Group:
    """Return the tree with another value of an attribute."""
    return changed(tree(), path, lambda g: replace(g, attributes={**g.attributes, name: value}))


def no_attribute(path: str, name: str) -> Group:
    """Return the tree without an attribute."""

    def change(group: Group) -> Group:
        kept = {key: value for key, value in group.attributes.items() if key != name}
        return replace(group, attributes=kept)

    return changed(tree(), path, change)


def column(path: str, name: str, values: NDArray[Any] | None) -> Group:
    """Return the tree with other values of a dataset, or without it."""

    def change(group: Group) -> Group:
        kept = {key: value for key, value in group.datasets.items() if key != name}
        if values is not None:
            about = group.datasets[name].attributes if name in group.datasets else {}
            kept[name] = Dataset(values, about)
        return replace(group, datasets=kept)

    return changed(tree(), path, change)


def member(path: str, name: str, *, there: bool) -> Group:
    """Return the tree with a group in it, empty, or without it."""

    def change(group: Group) -> Group:
        kept = {key: value for key, value in group.groups.items() if key != name}
        return replace(group, groups=kept | ({name: Group()} if there else {}))

    return changed(tree(), path, change)
