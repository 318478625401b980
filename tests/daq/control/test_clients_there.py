"""A recorder that no client watches looks at its frames less often."""

from __future__ import annotations

import time
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import pytest

from daq.control import peers
from daq.control.address import control_address
from daq.control.client import Client
from daq.control.messages import Reply
from daq.control.orders import AskStatus, Order
from daq.control.server import Server

from ..a_status import a_status

PATIENCE_S = 60.0


def no_order(order: Order, by: str) -> Future[Reply]:
    raise AssertionError(f"{order} by {by}")


def test_whether_a_client_is_there_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(peers, "LEASE_S", 0.5)
    address = control_address(tmp_path)
    server = Server(no_order, address)
    deadline_s = time.monotonic() + PATIENCE_S
    try:
        assert not server.has_clients()
        viewer = Client(address, "viewer", control=False)
        assert server.has_clients()  # at once, not only with the next status
        server.publish(a_status(1), None)
        while viewer.ask(AskStatus()).status != replace(a_status(1), viewers=1):
            assert time.monotonic() < deadline_s
        assert server.has_clients()
        viewer.close()
        while server.has_clients():
            assert time.monotonic() < deadline_s
            server.publish(a_status(2), None)
            time.sleep(0.02)
    finally:
        server.close()


def test_news_are_waited_for_as_long_as_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = Server(no_order, control_address(tmp_path))
    waits: list[float] = []
    try:
        viewer = Client(control_address(tmp_path), "viewer", control=False)
        try:
            began_s = time.monotonic()
            monkeypatch.setattr(viewer, "_next", lambda until_s: waits.append(until_s - began_s))
            assert viewer.news(100.0) is None
        finally:
            viewer.close()
    finally:
        server.close()
    assert waits == [pytest.approx(100.0, abs=50.0)]
