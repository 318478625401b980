"""Vehicle, runs, channels, certificate and highlights of a session made by hand, cell by cell."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from typing import Any

import numpy as np

from daq import session_from_arrays
from daq.channels import Channel, Quantity
from daq.runs import Event, Excitation, Losses, Run, RunStatus
from daq.sessions import Session
from daq.vehicle import (
    FORD_GRANADA,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Structure,
    Vehicle,
)
from dbc.frames import FrameBatch
from dbc.words import Finding, Severity
from identify import Identification, Judgement
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.fit.estimation import Estimation
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import Fit
from identify.report.content import (
    certificate_section,
    provenance_section,
    run_section,
    vehicle_section,
)
from identify.result import software_sha256

from .made import SOURCE, tables, texts

CHANNELS = (
    Channel("z_s", Quantity.BODY_ACCELERATION, "m/s2", "Imu.az", x_m=-1.2, y_m=0.34,
            sign=-1.0, gain=1.02, gain_sigma=0.005,
            delay_s=0.0025, delay_sigma_s=0.0005, serial_number="SN1", calibrated="2026-01-02"),
    Channel("cg", Quantity.BODY_DISPLACEMENT, "m", "Imu.z", at_cg=True),
    Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", "Hub.a", corner=Corner.REAR_LEFT),
    Channel("spare", Quantity.UNUSED, "", "Hub.b"),
)  # fmt: skip


def frames(n: int, first: int = 0) -> FrameBatch:
    one = np.ones(n, np.uint8)
    return FrameBatch(
        np.arange(first, first + n, dtype=np.int64), one.astype(np.uint32),
        one.astype(np.uint16), one, one, np.zeros((n, 8), np.uint8),
    )  # fmt: skip


def run(repeat: int, status: RunStatus, reasons: tuple[str, ...], n_frames: int) -> Run:
    losses = Losses(bus_dropped=3, crc_bad=1) if repeat == 2 else Losses()
    events = (
        Event(1_000_000_000, "bump"), Event(2_500_000_000, "operator_note", text="door open"),
        Event(2_600_000_000, "reject", text='{"by": "AE", "label": "x_1", "reason": ""}'),
        Event(3_000_000_000, "run_end"),
    )  # fmt: skip
    return Run(
        "baseline", Excitation.ROLL, repeat, 1_000_000_000, 0.1, (), status, reasons, losses,
        events if repeat == 1 else (), frames(n_frames, repeat),
    )  # fmt: skip


def session(**provenance: str) -> Session:
    runs = (
        run(1, RunStatus.ACCEPTED, (), 1234),
        run(2, RunStatus.REJECTED, ("a wheel lifted", "by AE"), 2),
    )
    states = (
        MassState("baseline"),
        MassState("added", AddedMass((HubWeight(5.0, Corner.REAR_LEFT),))),
    )
    return Session(Vehicle("Granada"), CHANNELS, states, runs, provenance)


def result() -> Identification:
    return Identification(Judgement((), 1.0), {}, noise={"z_s": 0.03})


def test_channels_stand_with_their_place_scale_and_lateness() -> None:
    channels = tables(provenance_section(session(), result(), SOURCE))["Channels"]
    assert texts(channels) == [
        ["z_s", "body acceleration", "x -1.200, y 0.340 m", "-1.02 ± 0.5 %", "2.50 ± 0.50",
         "0.030000", "m/s²", "Imu.az"],
        ["cg", "body displacement", "CG", "1, exact", "0.00 ± 0.00", "", "m", "Imu.z"],
        ["hub", "hub acceleration", "RL", "1, exact", "0.00 ± 0.00", "", "m/s²", "Hub.a"],
        ["spare", "unused", "", "", "", "", "", "Hub.b"],
    ]  # fmt: skip


def test_a_trace_names_file_hashes_programs_and_what_persons_wrote() -> None:
    notes = [{"label": "baseline_roll_1", "text": "rain", "by": "AE"}]
    waived = [{"subject": "hub", "reason": "taped", "by": "AE"}]
    made = session(
        uuid="one", software_name="bench", bench_toml="[bus]", dbc="BO_ 1\udce4", verdicts="[]",
        notes=json.dumps(notes), overrides=json.dumps(waived),
    )  # fmt: skip
    section = provenance_section(made, result(), SOURCE)
    assert texts(tables(section)["Trace"]) == [
        ["libraries", "numpy 2.1, scipy 1.14"],
        ["uuid", "one"],
        ["software name", "bench"],
        ["note", "baseline_roll_1: rain (AE)"],
        ["warning overridden", "hub: taped (AE)"],
        ["sha256 of the DBC", hashlib.sha256(b"BO_ 1\xe4").hexdigest()],
    ]
    assert texts(tables(section)["Settings of the recording: bench.toml"]) == [["[bus]"]]
    bare = provenance_section(replace(session(), runs=()), result(), SOURCE)
    assert [block.title for block in bare.blocks] == ["Trace", "Channels"]


def test_runs_stand_with_status_stretch_frames_losses_and_reasons() -> None:
    section = run_section(session(), replace(result(), estimation=estimation()))
    found = tables(section)
    first, second = texts(found["Runs of the session"])
    assert first == ["baseline_roll_1", "✓ accepted", "0.250", "0.750", "1,234", "none", ""]
    losses = "bus dropped 3, crc bad 1"
    assert second == [
        "baseline_roll_2", "✕ rejected", "", "", "2", losses, "a wheel lifted; by AE",
    ]  # fmt: skip
    assert texts(found["Notes, faults and decisions during the runs"]) == [
        ["baseline_roll_1", "1.500", "operator note", "door open"],
        ["baseline_roll_1", "1.600", "reject", "by AE, label x_1"],
    ]
    rejected = replace(session().runs[0], status=RunStatus.REJECTED)
    section = run_section(replace(session(), runs=(rejected,)), result())
    assert texts(tables(section)["Runs of the session"])[0][2:4] == ["", ""]
    assert run_section(replace(session(), runs=()), result()).blocks == ()


def estimation() -> Estimation:
    """Return a fit of one run with uncertain weight, lateness, place and motion ratio."""
    travel = Channel(
        "travel", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.FRONT_LEFT,
        motion_ratio_sigma=0.02, delay_sigma_s=0.001,
    )  # fmt: skip
    body = Channel("z_s", Quantity.BODY_ACCELERATION, "m/s2", position_sigma_m=0.005)
    weight = BodyWeight(50.0, -1.0, 0.5, 0.2, 0.1, 0.003)
    box = GreyBox(
        (ChannelGroup("travel", (travel,)), ChannelGroup("imu", (body,))),
        (MassState("baseline"), MassState("added", AddedMass((weight,)))),
        None,
        facts=(Fact(FactQuantity.WHEELBASE, 2.75, 0.01),),
    )
    truth = FORD_GRANADA.to_array()
    eta = np.concatenate([box.unknowns(truth)[:15], np.arange(1, len(box.corrections) + 1) * 1e-3])
    variance = np.where(np.arange(len(eta)) < 15, 4e-6, 1e-6)
    fit = Fit(eta, np.diag(variance), 1.0, {}, 1, True)
    time_s = np.arange(101) / 100.0
    record = Record(
        "baseline_roll_1", "baseline", 0.1,
        (Recording(ChannelGroup("imu", (body,)), time_s, np.ones((101, 1))),),
    )  # fmt: skip
    return Estimation(box, (record,), fit, (record.decay(0.25),), {}, {}, (), 1.0)


def test_the_vehicle_as_stated_and_how_it_agrees_with_the_fit() -> None:
    """The Granada's wheelbase is 1.25 + 1.51 m: one sigma of 10 mm above 2.75 m."""
    section = vehicle_section(session(), estimation())
    found = tables(section)
    assert texts(found["Model of the vehicle"]) == [
        ["sides", "left and right alike"],
        ["beyond the 15 parameters", "nothing"],
        ["lengths a, b, t_f, t_r", "identified"],
        ["facts", "none"],
        ["mass states", "baseline, added"],
    ]
    (fact,) = texts(found["Facts: scales and tape measure"])
    assert fact == ["wheelbase m", "2.7500", "0.010000", "2.7600", "-1.00"]
    weights = found["Weights of mass state added"]
    assert texts(weights) == [["hub RL", "", "", "", "", "5.0000", "0"]]
    assert "Weights of mass state baseline" not in found
    title = "Stated uncertainties: what the decays say of them"
    assert texts(found[title]) == [
        ["x of z_s", "5", "+1.000", "1.000", "mm", "+0.20"],
        ["y of z_s", "5", "+2.000", "1.000", "mm", "+0.40"],
        ["gain of travel", "2", "+0.300", "0.100", "%", "+0.15"],
        ["delay of travel", "1", "+4.000", "1.000", "ms", "+4.00"],
        ["weight 1 of state added", "0.1", "+0.005", "0.001", "kg", "+0.05"],
        ["x of weight 1 of state added", "3", "+6.000", "1.000", "mm", "+2.00"],
        ["y of weight 1 of state added", "3", "+7.000", "1.000", "mm", "+2.33"],
    ]


def test_what_a_vehicle_has_beyond_the_usual_is_named() -> None:
    facts = (Fact("m_s", 1.0, 1.0), Fact("k_sf", 1.0, 1.0))
    car = Vehicle("car", FORD_GRANADA.geometry, Structure(False, True, True, True), facts)
    weight = BodyWeight(50.0, -1.0, 0.5, 0.2, 0.1, 0.003)
    states = (MassState("laden", AddedMass((weight,))),)
    fitted = replace(estimation(), box=GreyBox((), (), None))
    made = replace(session(), vehicle=car, mass_states=states)
    found = tables(vehicle_section(made, fitted))
    assert [row[1] for row in texts(found.pop("Model of the vehicle"))] == [
        "each for itself", "anti roll bars, tyre damping, cg offset", "given", "2", "laden",
    ]  # fmt: skip
    assert {title: texts(table) for title, table in found.items()} == {
        "Weights of mass state laden": [
            ["body", "-1.000", "0.500", "0.200", "0.003", "50.000", "0.1"]
        ]
    }


# The certificate: what a result is cited by -------------------------------------------------------


def certificate(made: Session, result: Identification, **source: Any) -> dict[str, list[list[str]]]:
    given = replace(SOURCE, **{"issued": "", "operator": "A. Engineer", **source})
    section = certificate_section(made, result, given)
    return {title: texts(table) for title, table in tables(section).items()}


def test_a_certificate_cites_session_software_persons_sensors_and_what_was_waived() -> None:
    overrides = json.dumps([{"subject": "hub_fl", "reason": "taped: loose", "by": "AE"}])
    checks = [{"passed": False, "text": "too small"}, {"passed": True, "text": "whole"}]
    verdicts = json.dumps({f"baseline_roll_{n}": checks for n in (1, 2)})
    made = session(uuid="one", origin="simulated", overrides=overrides, verdicts=verdicts)
    quality = Judgement((Finding("wide", Severity.WARNING, "wide intervals"),), 1.0)
    cited = replace(result(), quality=quality, provenance=made.provenance)
    found = certificate(made, cited, issued="2026-11-22", approver="B. Head")
    assert dict(found["Result"]) == {
        "vehicle": "Granada",
        "data": "simulated, not measured",
        "verdict": "doubtful: Use the parameters with care.",
        "recorded": "not stated",
        "session": "one",
        "file": "car.h5",
        "sha256 of the file": "ab" * 32,
        "sha256 of the raw frames": "no raw frames",
        "software": "bumpbench 1.2",
        "sha256 of the software": software_sha256(),
        "report issued": "2026-11-22",
    }
    assert found["Signed"] == [
        ["operator", "A. Engineer", "", ""], ["approved by", "B. Head", "", ""],
    ]  # fmt: skip
    assert found["What was overridden, and why"] == [
        ["warning overridden", "hub_fl", "taped: loose (AE)"],
        ["run accepted by hand", "baseline_roll_1", "too small"],
        ["run not used", "baseline_roll_2", "a wheel lifted; by AE"],
    ]
    assert found["Sensors"] == [
        ["z_s", "body acceleration", "Imu.az", "SN1", "2026-01-02"],
        ["cg", "body displacement", "Imu.z", "not stated", "not stated"],
        ["hub", "hub acceleration", "Hub.a", "not stated", "not stated"],
    ]


def test_where_nothing_was_overridden_there_is_no_such_table() -> None:
    found = certificate(session_from_arrays([]), Identification(Judgement((), 1.0), {}))
    assert list(found) == ["Result", "Signed", "Sensors"]
    assert dict(found["Result"])["data"] == "origin not stated"
    assert dict(found["Result"])["report issued"] == "not stated"
