"""The bench's screens as a test operates them: reach one, wait, and see what was ordered."""

import asyncio
from collections.abc import Callable

from textual.pilot import Pilot

from daq.bench.config import Bench
from daq.control.messages import CheckItem
from daq.vehicle import Corner
from tui.terminal.app import BenchApp

from .conftest import screen_text
from .fake_recorder import FakeRecorder

Make = Callable[..., BenchApp]


def check_items(**levels: float) -> tuple[CheckItem, ...]:
    rest = {f"travel_{c.lower()}": 0.0001 for c in Corner} | levels
    return (
        CheckItem("OK", "bus", "12000 frames in 3.00 s, about 38 % of the bit rate", "", {}),
        CheckItem("OK", "message IMU_Accel", "500.0 Hz, jitter 0.20 ms", "", {}),
        CheckItem("OK", "channel body_acc_z", "9.81 m/s2 at rest, +1 g", "", {"level": 9.81}),
        *(
            CheckItem("OK", f"channel {name}", f"{level:.4g} m at rest", "", {"level": level})
            for name, level in rest.items()
        ),
    )


async def until(pilot: Pilot[None], condition: Callable[[], object]) -> None:
    """Wait until something is so; two minutes at most, for a busy machine."""
    clock = asyncio.get_running_loop().time
    end_s = clock() + 120.0
    while not condition():
        assert clock() < end_s, screen_text(pilot.app)
        await pilot.pause(0.02)


def shows(app: BenchApp, text: str) -> bool:
    return text in screen_text(app)


async def reach(pilot: Pilot[None], kind: type) -> None:
    app = pilot.app
    assert isinstance(app, BenchApp)
    await until(pilot, lambda: isinstance(app.screen, kind) and app.bench is not None)
    await pilot.pause()


def bench_of(recorder: FakeRecorder) -> Bench:
    return recorder.bench


def orders_of(recorder: FakeRecorder, kind: type) -> list[object]:
    return [order for order in recorder.orders if isinstance(order, kind)]
