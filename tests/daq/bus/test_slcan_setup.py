"""How an slcan adapter is opened: its line, and the commands of the LAWICEL protocol."""

from __future__ import annotations

from typing import Any

import pytest

from daq.bus.slcan.adapter import open_slcan


class Line:
    """A serial line that keeps what is written."""

    timeout = 0.0
    in_waiting = 0

    def __init__(self) -> None:
        self.written = b""

    def write(self, data: bytes) -> None:
        self.written += data

    def close(self) -> None:
        """Do nothing."""


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, dict[str, Any], Line]]:
    """Return the lines that were opened, and how."""
    made: list[tuple[str, dict[str, Any], Line]] = []

    def serial_for_url(device: str, **options: Any) -> Line:
        made.append((device, options, Line()))
        return made[-1][2]

    monkeypatch.setattr("serial.serial_for_url", serial_for_url)
    return made


@pytest.mark.parametrize(
    ("channel", "device", "baud"),
    [
        ("/dev/ttyACM0", "/dev/ttyACM0", 115_200),
        ("/dev/ttyUSB0@3000000", "/dev/ttyUSB0", 3_000_000),
        ("/dev/ttyUSB0@", "/dev/ttyUSB0", 115_200),
    ],
)
def test_a_line_has_115200_baud_if_no_other_rate_is_named(
    opened: list[tuple[str, dict[str, Any], Line]], channel: str, device: str, baud: int
) -> None:
    source = open_slcan(channel, 500_000, 3)
    ((name, options, line),) = opened
    assert (name, options["baudrate"]) == (device, baud)
    assert options["exclusive"] is True
    assert (options["timeout"], options["write_timeout"]) == (0, 1)
    assert source.name == f"slcan {channel}"
    source.close()
    assert line.written == b"C\rS6\rO\rC\r"


@pytest.mark.parametrize(
    ("bitrate", "code"),
    [(10_000, "S0"), (20_000, "S1"), (50_000, "S2"), (100_000, "S3"), (125_000, "S4"),
     (250_000, "S5"), (500_000, "S6"), (750_000, "S7"), (1_000_000, "S8"), (83_300, "S9")],
)  # fmt: skip
def test_each_bit_rate_has_its_command(
    opened: list[tuple[str, dict[str, Any], Line]], bitrate: int, code: str
) -> None:
    open_slcan("x", bitrate, 0)
    assert opened[0][2].written == f"C\r{code}\rO\r".encode()
