"""The file of figures for a monitoring system: each figure of a status under its own name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from daq.control.messages import (
    Alarm,
    BusState,
    BusStatus,
    DiskStatus,
    QueueStatus,
    Status,
    StorageStatus,
)
from daq.control.monitoring import write_figures
from daq.runs import Losses

from ..a_status import a_status

STATUS = replace(
    a_status(),
    disk=DiskStatus(101, 102, 103, 0.5, held_frames=104),
    queue=QueueStatus(105, 106, 107),
    storage=StorageStatus(108, 109, 0.25),
    sensors_alive=110,
    sensors_expected=111,
    viewers=112,
    losses=Losses(bus_dropped=113, queue_dropped=114, counter_gaps=115),
    buses=(
        BusStatus("a", BusState.OK, 0.125, 1.0, 116, 117, 118),
        BusStatus("b", BusState.ERROR_PASSIVE, 0.0, 0.0, 0, 0, 0),
        BusStatus("c", BusState.BUS_OFF, 0.0, 0.0, 0, 0, 0),
    ),
)
FIGURES = {
    "recording": 1,
    "campaign": 1,
    "unstored_seconds": 0.25,
    "received_frames_total": 108,
    "stored_frames_total": 109,
    "status_seconds": 1.8e9,
    "recorded_frames": 103,
    "lag_seconds": 0.5,
    "disk_free_bytes": 101,
    "journal_bytes": 102,
    "held_frames": 104,
    "queue_blocks": 105,
    "queue_high_blocks": 106,
    "sensors_alive": 110,
    "sensors_expected": 111,
    "viewers": 112,
    "lost_frames bus_dropped": 113,
    "lost_frames queue_dropped": 114,
    "lost_frames counter_gaps": 115,
    "bus_up a": 1,
    "bus_up b": 1,
    "bus_up c": 0,
    "bus_load a": 0.125,
    "bus_frames a": 116,
    "bus_error_frames a": 117,
    "bus_reopened a": 118,
}


def written(folder: Path, status: Status) -> dict[str, float]:
    path = folder / "bumpbench.prom"
    write_figures(path, status)
    return {
        " ".join([sample.name.removeprefix("bumpbench_"), *sample.labels.values()]): sample.value
        for family in text_string_to_metric_families(path.read_text("utf-8"))
        for sample in family.samples
    }


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    return written(tmp_path_factory.mktemp("figures"), STATUS)


@pytest.mark.parametrize(("name", "value"), FIGURES.items())
def test_each_figure_has_its_name(figures: dict[str, float], name: str, value: float) -> None:
    assert figures[name] == value


def test_between_campaigns_and_where_nothing_is_stored_the_figures_are_zero(tmp_path: Path) -> None:
    alarm = Alarm("not_recording", "disk", "no frame is stored", "make room", 1)
    found = written(tmp_path, replace(STATUS, recording="", alarms=(alarm,)))
    assert (found["campaign"], found["recording"], found["alarms not_recording"]) == (0, 0, 1)
