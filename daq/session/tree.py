"""Defines a session file as plain data: groups, attributes and arrays, without HDF5 objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from numpy.typing import NDArray


class Part(StrEnum):
    """Names the part of a session file that is read."""

    WHOLE = "whole"
    SAMPLES = "samples"
    """Without raw frames, half of a file, without attributes of datasets, and those for viewers."""


Attribute = str | int | float | tuple[str, ...] | tuple[int, ...] | tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Dataset:
    """One dataset."""

    values: NDArray[Any]
    """Values: integers, floats or byte strings of fixed length."""
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    """Attributes of simple types."""


@dataclass(frozen=True, slots=True)
class Group:
    """One group with its content."""

    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    """Attributes of simple types."""
    groups: Mapping[str, Group] = field(default_factory=dict)
    """Groups in it, in order of their names."""
    datasets: Mapping[str, Dataset] = field(default_factory=dict)
    """Datasets in it, in order of their names."""

    def group(self, name: str) -> Group:
        """Return a subgroup.

        Raises ValueError if it is absent.
        """
        if name not in self.groups:
            raise ValueError(f"group {name} is absent")
        return self.groups[name]

    def values(self, name: str) -> NDArray[Any]:
        """Return the values of a dataset in this group.

        Raises ValueError if it is absent.
        """
        if name not in self.datasets:
            raise ValueError(f"dataset {name} is absent")
        return self.datasets[name].values

    def attribute(self, name: str) -> Attribute:
        """Return an attribute of this group.

        Raises ValueError if it is absent.
        """
        if name not in self.attributes:
            raise ValueError(f"attribute {name} is absent")
        return self.attributes[name]

    def all_datasets(self) -> Iterator[Dataset]:
        """Yield every dataset below, in the order of the tree."""
        yield from self.datasets.values()
        for group in self.groups.values():
            yield from group.all_datasets()
