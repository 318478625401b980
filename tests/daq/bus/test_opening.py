"""What each interface of python-can is opened with, and the one line where it cannot be."""

from __future__ import annotations

from typing import Any

import can
import pytest
from can.interfaces import BACKENDS

from daq.bench.config import BusConfig
from daq.bus.interfaces import open_bus
from daq.bus.link import Link
from daq.errors import BusError

COUNTING = {"canalystii", "cantact", "gs_usb", "iscan", "ixxat", "kvaser", "neousys", "neovi"}
COUNTING |= {"systec", "vector"}
CHANNELS = ["0", "1", "12", "can0", "PCAN_USBBUS1", "/dev/ttyUSB0@115200", "COM3", "239.74.163.2"]


@pytest.mark.parametrize("interface", sorted(BACKENDS))
def test_a_channel_reaches_its_interface_as_it_counts_or_names_them(
    interface: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = can.Bus(interface="virtual", channel="of a constructor")
    made: list[tuple[Any, ...]] = []

    def construct(*positional: Any, **named: Any) -> can.BusABC:
        made.append((positional, named["bitrate"]))
        return opened

    monkeypatch.setattr("can.interface._get_class_for_interface", lambda _: construct)
    for channel in CHANNELS:
        open_bus(BusConfig(interface, channel, 500_000))
        counts = interface in COUNTING and channel.isdecimal()
        assert made.pop() == ((int(channel) if counts else channel,), 500_000)
    open_bus(BusConfig(interface, "", 500_000))
    assert made == [((), 500_000)], "the interface chooses its own channel"
    opened.shutdown()


@pytest.mark.parametrize("interface", sorted(BACKENDS.keys() - {"virtual", "udp_multicast"}))
def test_an_interface_that_is_not_there_is_one_line_that_names_what_it_needs(
    interface: str,
) -> None:
    channel = ""
    with pytest.raises(BusError) as refused:
        open_bus(BusConfig(interface, channel, 500_000))
    text = str(refused.value)
    assert text.startswith(f"{interface} {channel}".rstrip() + ": cannot be opened: ")
    assert "\n" not in text
    assert "missing 1 required" not in text
    assert "is not defined" not in text
    if interface in COUNTING | {"pcan", "nican", "nixnet", "etas", "usb2can"}:
        assert "driver is installed: " in text


@pytest.mark.parametrize("raised", [SystemExit(1), KeyboardInterrupt(), MemoryError()])
def test_a_driver_that_ends_the_program_is_one_more_lost_bus(raised: BaseException) -> None:
    """The reader goes on, and opens the bus again."""

    class Fatal:
        name = "fatal"

        def read(self, timeout_s: float) -> Any:
            raise raised

        def losses(self) -> Any:
            raise raised

        def close(self) -> None:
            raise raised

    openings: list[int] = []

    def open_fatal(_: BusConfig, number: int) -> Any:
        openings.append(number)
        if len(openings) == 2:
            raise raised
        return Fatal()

    now_s = iter(range(0, 100_000, 10))
    link = Link(BusConfig("kvaser", "0", 500_000), 3, open_fatal, lambda: float(next(now_s)))
    for _ in range(7):
        assert not len(link.read(0.0))
    assert openings == [3] * 4
    assert not link.facts().connected
    assert type(raised).__name__ in link.facts().error
    link.close()
