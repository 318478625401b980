"""Another bench.toml within a recording, and bench checks that wait for each other."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from dataclasses import replace

import pytest

from daq.bench.campaign import Origin
from daq.bench.config import BusConfig, default_bench_text, load_bench
from daq.check import CheckReport
from daq.control.messages import CheckItem, Reply
from daq.recorder.orders import Checks, OrderError, configured
from dbc import FrameBatch
from dbc.finding import Finding, Severity

TEXT = default_bench_text()
OLD = replace(
    load_bench(None),
    text=TEXT,
    buses=(BusConfig("slcan", "/dev/ttyACM0", 250_000),),  # as the command line says
    dbc_name="the one in force",
    origin=Origin.REPLAYED,
)


def test_another_bench_keeps_buses_dbc_and_origin_in_force() -> None:
    text = TEXT.replace("repeats = 2", "repeats = 3")
    assert text != TEXT
    new = configured(OLD, text)
    assert new.campaign.repeats == 3
    assert new.text == text
    assert (new.buses, new.dbc_name, new.origin) == (OLD.buses, OLD.dbc_name, OLD.origin)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (TEXT + "[campaign]\n", "bench.toml"),
        ("x = 1\n" + TEXT, "unknown key x"),
        (TEXT.replace("IMU_Accel.acc_z", "IMU_Accel.acc_q"), "no signal"),
        (TEXT.replace("[bus]", '[bus]\nname = "other"'), "other buses"),
        (TEXT.replace('dbc = ""', 'dbc = "other.dbc"'), "another DBC"),
    ],
)
def test_a_bench_that_cannot_go_on_is_refused(text: str, why: str) -> None:
    with pytest.raises(OrderError, match=why):
        configured(OLD, text)


def test_four_checks_may_wait_and_each_gets_its_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    go_on = threading.Event()
    line = Finding("rate", Severity.WARNING, "slow", "message M", "set it", figures={"hz": 5.0})

    def checked(*_: object) -> CheckReport:
        assert go_on.wait(60.0)
        return CheckReport(1.0, 2, (line,))

    monkeypatch.setattr("daq.recorder.orders.check_bench", checked)
    checks = Checks()
    answers: list[Future[Reply]] = [Future() for _ in range(5)]
    for answer in answers[:4]:
        checks.begin(load_bench(None), FrameBatch.empty(), answer)
    with pytest.raises(OrderError, match="other checks"):
        checks.begin(load_bench(None), FrameBatch.empty(), answers[4])
    go_on.set()
    item = CheckItem("WARN", "message M", "slow", "set it", {"hz": 5.0})
    assert [answer.result(60.0).check for answer in answers[:4]] == [(item,)] * 4
    checks.begin(load_bench(None), FrameBatch.empty(), answers[4])  # those before are done
    assert answers[4].result(60.0).check == (item,)
    checks.close()


def test_a_check_that_fails_is_answered_with_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*_: object) -> CheckReport:
        raise ValueError("odd")

    monkeypatch.setattr("daq.recorder.orders.check_bench", failing)
    checks, answer = Checks(), Future[Reply]()
    checks.begin(load_bench(None), FrameBatch.empty(), answer)
    with pytest.raises(ValueError, match="odd"):
        answer.result(60.0)
    checks.close()
