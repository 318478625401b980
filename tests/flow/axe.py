"""The accessibility engine axe-core, in a page of the browser; npm fetches it where it is run."""

from __future__ import annotations

import json
import subprocess
import tarfile
import tempfile
from functools import cache
from pathlib import Path

from .chromium import Tab

PACKAGE = "axe-core@4.12.1"
SERIOUS = ("serious", "critical")
RUN = """axe.run().then(found => JSON.stringify(
    found.violations.map(v => [v.impact, v.id, v.nodes[0].html.slice(0, 200)])))"""


@cache
def source() -> str:
    """Return the script of axe-core; raises CalledProcessError if npm cannot fetch it."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["npm", "pack", PACKAGE, "--silent"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        (packed,) = Path(folder).glob("*.tgz")
        with tarfile.open(packed) as archive:
            script = archive.extractfile("package/axe.min.js")
            assert script is not None
            return script.read().decode()


async def assert_accessible(tab: Tab, where: str) -> None:
    """Raise AssertionError if axe finds anything serious in what a page shows now."""
    await tab.value(f"if (!window.axe) {{ {source()} }}")
    answer = await tab.order("Runtime.evaluate", expression=RUN, awaitPromise=True)
    found = json.loads(answer["result"]["value"])
    serious = [violation for violation in found if violation[0] in SERIOUS]
    assert not serious, f"{where}: {serious}"
