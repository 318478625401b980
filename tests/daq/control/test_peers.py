"""Who is in control, and the limits of orders, with a case on each side of every one."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from pydantic import TypeAdapter, ValidationError

from daq.control.orders import (
    Accept,
    AskCheck,
    AskHistory,
    Hello,
    Mark,
    Note,
    OverrideWarning,
    Reject,
)
from daq.control.server import Peers

ALIVE = f"{os.getpid()}-a"


def ended_process() -> str:
    """Return the id of a client whose process has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return f"{process.pid}-b"


@pytest.mark.parametrize(("silent_s", "name"), [(5.0, "Ann"), (5.1, "")])
def test_a_controller_is_gone_after_five_silent_seconds(silent_s: float, name: str) -> None:
    peers = Peers()
    peers.seen(ALIVE, 100.0)
    assert peers.hello(ALIVE, Hello("Ann", True), 100.0) == ""
    assert peers.controller(100.0 + silent_s) == name
    assert peers.in_control(ALIVE)


@pytest.mark.parametrize(("silent_s", "name"), [(1.0, "Ann"), (1.1, "")])
def test_a_dead_controller_is_gone_after_one_second(silent_s: float, name: str) -> None:
    peers, client = Peers(), ended_process()
    peers.seen(client, 100.0)
    assert peers.hello(client, Hello("Ann", True), 100.0) == ""
    assert peers.controller(100.0 + silent_s) == name


def test_viewers_are_those_heard_of_within_five_seconds() -> None:
    peers = Peers()
    for client, t_s in ((ALIVE, 100.0), ("x-1", 100.0), ("x-2", 102.0)):
        peers.seen(client, t_s)
        peers.hello(client, Hello(client, client == ALIVE), t_s)
    assert peers.viewers(105.0) == 2
    assert peers.viewers(105.1) == 1
    peers.seen("x-2", 105.1)
    assert peers.name("x-1") == "x-1"  # forgotten
    assert peers.viewers(107.1) == 1


def test_control_goes_to_another_only_if_it_is_free_released_or_taken_over() -> None:
    peers = Peers()
    peers.seen(ALIVE, 100.0)
    peers.hello(ALIVE, Hello("Ann", True), 100.0)
    assert "Ann is in control" in peers.hello("x-1", Hello("Ben", True), 101.0)
    assert peers.hello("x-1", Hello("Ben", True, take_over=True), 101.0) == ""
    assert peers.in_control("x-1")
    assert not peers.in_control(ALIVE)
    peers.hello("x-1", Hello("Ben"), 102.0)
    assert peers.controller(102.0) == ""
    assert peers.hello(ALIVE, Hello("Ann", True), 102.0) == ""


LIMITS: tuple[tuple[type, str, object, object], ...] = (
    (AskHistory, "seconds", 60, 60.1),
    (AskHistory, "seconds", 1e-3, 0),
    (AskCheck, "seconds", 10, 10.1),
    (AskCheck, "seconds", 1e-3, 0),
    (Accept, "reason", "x" * 500, "x" * 501),
    (Reject, "reason", "x" * 500, "x" * 501),
    (Mark, "text", "x" * 200, "x" * 201),
    (Note, "text", "x" * 2000, "x" * 2001),
    (Note, "text", "x", ""),
    (OverrideWarning, "subject", "x" * 200, "x" * 201),
    (OverrideWarning, "reason", "x" * 500, "x" * 501),
    (OverrideWarning, "reason", "x", ""),
)
OTHERS: dict[type, dict[str, object]] = {
    Accept: {"label": "baseline_bounce_1"},
    OverrideWarning: {"subject": "az", "reason": "known"},
}


@pytest.mark.parametrize(("order", "field", "allowed", "refused"), LIMITS)
def test_an_order_holds_no_more_than_it_may(
    order: type, field: str, allowed: object, refused: object
) -> None:
    adapter: TypeAdapter[object] = TypeAdapter(order)
    whole = OTHERS.get(order, {})
    assert adapter.validate_python(whole | {field: allowed})
    with pytest.raises(ValidationError, match=field):
        adapter.validate_python(whole | {field: refused})


def test_a_client_that_asks_once_is_no_viewer() -> None:
    """`bumpbench status`, repeated by a script, must not keep a demonstration alive."""
    peers = Peers()
    for client, attends in (("x-1", False), ("x-2", True)):
        peers.seen(client, 100.0)
        peers.hello(client, Hello(client, attends=attends), 100.0)
    assert peers.viewers(100.0) == 1
