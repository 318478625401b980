"""The real input: a car simulated in one process, recorded in another, over two kinds of bus.

Real time, 4,000 frames a second, stamped on arrival by a busy user-space process: the sensors'
clocks must be recovered from their counters for this to work.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from ..daq.adapters import own_group, pty_pair

PATIENCE_S = 150
WRITTEN_S = 25
"""A recorder that has all runs builds its session file within this."""
TRIES = 4
TRANSPORTS = ("udp_multicast", "slcan")
EVERY, BOUNCE = ('["bounce", "pitch", "roll"]', '["bounce"]')
"""Kinds of bump, as bench.toml writes them; each is driven once in each mass state."""

Document = dict[str, dict[str, Any]]


@contextmanager
def _first() -> Iterator[None]:
    """Let what plays, carries and records in real time go before other tests, where allowed."""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, -15)  # processes that are started inherit it
    try:
        yield
    finally:
        os.setpriority(os.PRIO_PROCESS, 0, before)


def _start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "tui", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _result(
    process: subprocess.Popen[str], allowed: set[int], patience_s: float = PATIENCE_S
) -> dict[str, Any]:
    out, err = process.communicate(timeout=patience_s)
    assert process.returncode in allowed, err
    document = json.loads(out)
    assert isinstance(document, dict)
    return document


def _wait_for_journal(folder: Path, recorder: subprocess.Popen[str]) -> None:
    deadline_s = time.monotonic() + 30
    while not list(folder.glob("journal/*")):
        assert recorder.poll() is None, recorder.communicate()
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


def _campaign(transport: str, folder: Path, kinds: str) -> Document | None:
    """Run the campaign over one transport; None where a run is missing at its end.

    A host that is kept from sending for 0.25 s makes a silence, for which the recorder rejects the
    run, as it should; the car then goes on with the next bump and not with that one.
    """
    running: list[subprocess.Popen[str]] = []
    with _first(), pty_pair() as (left, right):
        group = own_group(77)
        sender, receiver = (group, group) if transport == "udp_multicast" else (left, right)
        bench = folder / "bench.toml"
        default = (Path(__file__).parents[2] / "daq" / "bench.toml").read_text()
        once = default.replace("repeats = 2", "repeats = 1")
        bench.write_text(once.replace(EVERY, kinds))
        bus = ["--interface", transport, "--channel"]
        try:
            out = ["--out", str(folder), "--json"]
            recorder = _start("record", str(bench), *bus, receiver, *out)
            running.append(recorder)
            _wait_for_journal(folder, recorder)
            car = _start("simulate", str(bench), *bus, sender, "--seed", "5", "--json")
            running.append(car)
            simulated = _result(car, {0})
            # A lost frame is no failure of the recorder as long as it says so (exit code 3).
            return {"simulate": simulated, "record": _result(recorder, {0, 3}, WRITTEN_S)}
        except subprocess.TimeoutExpired:
            return None
        finally:
            for process in running:
                if process.poll() is None:
                    process.kill()
                process.communicate()


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Document]:
    """Return what records the car over a transport, once, and identifies the session."""

    @cache
    def recorded(transport: str, kinds: str) -> Document:
        for _ in range(TRIES):
            document = _campaign(transport, tmp_path_factory.mktemp(transport), kinds)
            if document is not None:
                break
        assert document is not None
        if kinds != EVERY:
            return document
        session = str(document["record"]["session"])
        return {**document, "identify": _result(_start("identify", session, "--json"), {0})}

    return recorded


@pytest.mark.parametrize(
    ("transport", "kinds"),
    [
        ("udp_multicast", BOUNCE),
        *(pytest.param(way, EVERY, marks=pytest.mark.long) for way in TRANSPORTS),
    ],
)
def test_every_run_is_recorded_and_labelled(
    results: Callable[[str, str], Document], transport: str, kinds: str
) -> None:
    document = results(transport, kinds)
    runs = document["record"]["runs"]
    assert [run["label"] for run in runs] == [
        f"{state}_{bump}_1" for state in ("baseline", "added") for bump in json.loads(kinds)
    ]
    missing = sum(run["losses"]["counter_gaps"] for run in runs)
    assert missing < 0.001 * document["simulate"]["frames"]
    for run in runs:
        assert run["status"] == "accepted", run["reasons"]
        assert run["losses"]["crc_bad"] == run["losses"]["unknown_id"] == 0


@pytest.mark.long
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_the_car_is_found_within_its_intervals(
    results: Callable[[str, str], Document], transport: str
) -> None:
    document = results(transport, EVERY)
    found, truth = document["identify"], document["simulate"]["truth"]
    assert found["verdict"] == "ok", found["reasons"]
    assert 0.9 < found["chi2_per_n"] < 1.1
    for name, estimate in found["parameters"].items():
        assert abs(estimate["value"] / truth[name] - 1) < 0.03, name
        assert abs(estimate["value"] - truth[name]) < 4 * estimate["std"], name
