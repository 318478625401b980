"""Where a display listens, and what a terminal shows of it."""

from __future__ import annotations

import socket

import pytest

from daq.errors import InputError
from tui.display.link import address_of, host_in_link, is_loopback, link_lines, port_of, qr_lines
from tui.display.served import Served

LINK = "http://192.0.2.7:8010/Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmFyYmF6Zm9vYmF/"


def test_every_address_at_once_is_refused() -> None:
    for host in ("0.0.0.0", "::"):
        with pytest.raises(InputError, match="name one address"):
            address_of(host)
    assert address_of("192.0.2.7") == "192.0.2.7"
    assert address_of("bench.local") == "bench.local"


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(InputError, match=r"192\.0\.2\.7"):
        port_of("192.0.2.7")


def test_a_port_that_is_taken_is_passed_by() -> None:
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert port_of("127.0.0.1") not in (0, taken.getsockname()[1])


def test_loopback_is_told_from_the_network() -> None:
    assert [is_loopback(host) for host in ("127.0.0.1", "::1", "localhost")] == [True] * 3
    assert [is_loopback(host) for host in ("192.168.0.4", "bench.local")] == [False] * 2
    assert host_in_link("::1") == "[::1]"
    assert host_in_link("192.0.2.7") == "192.0.2.7"


def test_a_link_into_the_network_comes_with_a_warning_and_a_code() -> None:
    lines = list(link_lines(Served(LINK, "192.0.2.7", "493217"), colours=True))
    assert lines[0] == f"display: open {LINK}"
    assert lines[1].startswith("warning: ")
    assert "493 217" in lines[2]
    assert len(lines) > 15
    assert all(line.startswith("\x1b[") for line in lines[3:])
    assert len(list(link_lines(Served(LINK, "192.0.2.7", ""), colours=False))) == 2
    assert list(link_lines(Served(LINK, "127.0.0.1", ""), colours=True)) == [
        f"display: open {LINK}"
    ]


def test_the_code_fits_a_small_terminal_and_has_its_three_corners() -> None:
    lines = list(qr_lines(LINK))
    assert len(lines) <= 20
    assert len({len(line) for line in lines}) == 1
    assert len(lines[0]) <= 40
    corner = "█▀▀▀▀▀█"  # the first two rows of a finder, behind a margin of two
    assert lines[1][2:9] == corner
    assert lines[1][-9:-2] == corner
