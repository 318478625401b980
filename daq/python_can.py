"""Loads python-can without asammdf, which only its readers of MF4 need; no other module uses those.

Where asammdf is installed, `import can` loads it, and pandas with it: 0.7 s of CPU for each process
that opens a bus or writes a log, against 0.1 s without.
"""

from __future__ import annotations

import sys
from typing import Any

__all__ = ["can"]

_loaded: dict[str, Any] = sys.modules
_hidden = _loaded.setdefault("asammdf", None) is None  # None: an import of it fails
try:
    import can
finally:
    if _hidden:
        del _loaded["asammdf"]
