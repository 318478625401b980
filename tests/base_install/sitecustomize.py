"""A Python whose python-can does not load asammdf and pandas, as where they are not installed.

On the path of the processes that tests start: each would take 0.8 s of CPU for them.
"""

from __future__ import annotations

import sys
from importlib.abc import MetaPathFinder
from typing import Any


class _NotForPythonCan(MetaPathFinder):
    """Finds no asammdf while python-can looks for it; any other import gets it."""

    def find_spec(self, name: str, *_: Any) -> None:
        reader = sys.modules.get("can.io.mf4")
        if name == "asammdf" and getattr(getattr(reader, "__spec__", None), "_initializing", False):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, _NotForPythonCan())
