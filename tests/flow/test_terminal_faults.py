"""Faults of the demo at the operator's terminal: named in plain words, and the way on.

One of the motion, one of the frames and one of the plug.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from daq.control.messages import Phase
from daq.runs import RunStatus

from .bench_terminal import demo_bench, seat, terminal_on

SPEED = 6.0
SAID = {
    "double-bump": ("DOUBLE BUMP", "bump once"),
    "lost-frames": ("LOST FRAMES", "cable and plugs"),
    "unplug": ("BUS LOST", "plug the bus in"),
}
"""What the banner says, and a word of its advice."""


@pytest.mark.parametrize(
    "fault",
    [
        "unplug",
        pytest.param("double-bump", marks=pytest.mark.long),
        pytest.param("lost-frames", marks=pytest.mark.long),
    ],
)
def test_a_fault_is_named_and_the_campaign_goes_on(fault: str, tmp_path: Path) -> None:
    why, todo = SAID[fault]

    async def act() -> None:
        app = terminal_on(bench.folder)
        async with seat(app, (140, 40)) as operator:

            def is_rejected() -> bool:
                return app.status is not None and app.status.phase is Phase.REJECTED

            await operator.until(operator.sees("SPACE starts"))
            await operator.pilot.press("space")
            await operator.until(lambda: is_rejected() and "REJECTED" in operator.text)
            banner = operator.text
            assert f"{why}: " in banner
            assert todo in banner.lower()
            await operator.until(lambda: bool(app.status and app.status.tallies[0].accepted >= 2))
            assert app.status is not None
            assert app.status.runs[1].status is RunStatus.REJECTED
            await operator.until(operator.sees("baseline bounce 2  rejected"))

    with demo_bench(tmp_path, SPEED, 3, fault) as bench:
        bench.started()
        bench.skip_to_bumps()
        asyncio.run(act())
