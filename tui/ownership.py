"""Finds whether another distribution has one of our package names: the index has an `identify`."""

from __future__ import annotations

from importlib.metadata import packages_distributions
from importlib.util import find_spec
from pathlib import Path

_OURS = ("dbc", "daq", "identify", "tui")


def foreign_package() -> str:
    """Return in one line which package name another distribution has, and what to do; else ""."""
    root = Path(__file__).resolve().parents[1]
    owners = packages_distributions()
    for name in _OURS:
        spec = find_spec(name)
        found = Path(spec.origin).resolve() if spec and spec.origin else None
        others = [owner for owner in owners.get(name, []) if owner != "bumpbench"]
        if others or (found is not None and found.parents[1] != root):
            whose = f"the distribution {others[0]}" if others else "something else"
            return (
                f"package {name}: {whose} has that name, too ({found}) (uninstall or move it, then"
                " install bumpbench again; both work in separate environments)"
            )
    return ""
