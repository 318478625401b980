"""What commands show while something takes time: how much is done, and what is going on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import can
import pytest

import daq
from identify import Identification
from identify.plan import Advice
from tui.cli import run
from tui.jobs import comparing

from ..daq.small_campaign import bumps, small_codec
from ..daq.small_session import small_session
from ..identify.test_documents_by_hand import result
from .batches import refused_session, write_all
from .conftest import Stages
from .test_import import write_log
from .test_plan_tables import KNOWN

UDP = ["--interface", "udp_multicast", "--channel", "239.74.163.99", "--fast"]
Told = Callable[[float, str], None]


def test_a_plan_reads_expects_and_compares(stages: Stages, monkeypatch: pytest.MonkeyPatch) -> None:
    def advise(_: object, told: Told, __: object) -> Advice:
        told(0.5, "weighing")
        return Advice(KNOWN, (), ())

    def compare(_: object, told: Told, __: object) -> tuple[()]:
        told(0.5, "one run less")
        return ()

    monkeypatch.setattr("identify.plan.advise", advise)
    monkeypatch.setattr("identify.plan.compare_campaigns", compare)
    assert run(["plan"]) == 0
    assert stages == {
        "plan": [
            (0.05, "reading"),
            (0.1, "expecting the vehicle"),
            (0.45, "weighing"),
            (0.85, "one run less"),
        ]
    }


class Wire(can.BusABC):
    """A bus that takes everything."""

    channel_info = "wire"

    def __init__(self) -> None:
        self._is_shutdown = True  # nothing to close

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Take a frame."""


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.bus.interfaces.open_bus", lambda _: Wire())


@pytest.mark.usefixtures("wire")
def test_a_replay_counts_what_was_sent(stages: Stages, tmp_path: Path) -> None:
    log = write_log(tmp_path / "all.log", bumps(small_codec(), 1))
    assert run(["replay", str(log), *UDP]) == 0
    assert stages["replay"][-1] == (1.0, "1,200 frames")
    session = tmp_path / "s.h5"
    daq.write_session(session, small_session())
    assert run(["replay", str(session), *UDP]) == 0
    assert stages["replay"][-1] == (0.0, "152 frames"), "it is not known how many a session has"


def test_an_identification_is_read_first(
    stages: Stages, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def identify(_: object, told: Told) -> Identification:
        told(0.5, "fitting")
        return result()

    monkeypatch.setattr("identify.identify", identify)
    (file,) = write_all(tmp_path, refused_session, 1)
    assert run(["identify", str(file)]) == 0
    assert stages == {"identify": [(0.05, "reading"), (0.5, "fitting")]}


def test_a_comparison_says_how_many_sessions(
    stages: Stages, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def identified(paths: Sequence[str], told: Told) -> list[Any]:
        told(0.5, paths[0])
        return [result(), result(), result()]

    monkeypatch.setattr(comparing, "identified", identified)
    assert run(["compare", "a.h5", "b.h5", "c.h5"]) == 0
    assert stages == {"compare": [(0.0, "3 sessions"), (0.5, "a.h5")]}
