"""Files of every version of the schema are read for ever; what is in them is stated here."""

from pathlib import Path

import h5py
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from daq.channels import Quantity
from daq.runs import Excitation, Losses, RunStatus
from daq.session import read_session, validate_session
from daq.vehicle import BodyWeight, Corner, HubWeight
from dbc.codec import Quality
from dbc.words import Severity

V1 = Path(__file__).parent / "session_v1_2026-11.h5"


def test_session_v1_2026_11() -> None:
    session = read_session(V1)
    vehicle = session.vehicle
    assert vehicle.name == "Käfer 1303"
    assert vehicle.geometry is not None
    geometry = (vehicle.geometry.a, vehicle.geometry.b, vehicle.geometry.t_f, vehicle.geometry.t_r)
    assert geometry == (1.25, 1.5, 0.75, 0.7)
    assert (vehicle.structure.symmetric, vehicle.structure.tyre_damping) == (False, True)
    assert (vehicle.structure.anti_roll_bars, vehicle.structure.cg_offset) == (False, False)
    (fact,) = vehicle.facts
    assert (fact.quantity, fact.value, fact.sigma) == ("total_mass_kg", 1551.75, 0.5)

    hub, body, pitch = session.channels
    assert (hub.name, hub.signal, hub.corner) == ("hub_fl", "Hubs.fl", Corner.FRONT_LEFT)
    assert (hub.quantity, hub.unit, hub.sign) == (Quantity.HUB_ACCELERATION, "m/s2", 1.0)
    assert (body.x_m, body.y_m, body.position_sigma_m, body.at_cg) == (-1.25, 0.5, 0.01, False)
    assert (body.sign, body.gain, body.tare) == (-1.0, 1.5, 9.81)
    assert (body.delay_s, body.delay_sigma_s) == (0.002, 0.0005)
    assert (body.low_pass_hz, body.low_pass_order) == (80.0, 4)
    assert (pitch.quantity, pitch.unit, pitch.corner) == (Quantity.PITCH_RATE, "rad/s", None)

    baseline, added = session.mass_states
    assert (baseline.name, added.name, baseline.added.weights) == ("baseline", "added", ())
    assert added.added.weights == (
        BodyWeight(60.0, 0.25, 0.5, 0.1, 0.05),
        HubWeight(4.0, Corner.REAR_RIGHT, 0.01),
    )
    assert not added.added.matrix.any()

    first, second = session.runs
    assert (first.label, first.status, first.reasons) == (
        "baseline_bounce_1",
        RunStatus.ACCEPTED,
        (),
    )
    assert (first.excitation, first.bump_s, len(first.frames)) == (Excitation.BOUNCE, 0.25, 0)
    assert_allclose(first.groups[0].values["pitch"], -np.arange(100) / 50, rtol=1e-15)
    assert (second.label, second.status) == ("added_roll_1", RunStatus.REJECTED)
    assert second.reasons == ("too weak", "Prüfer: nochmal")
    assert second.t0_ns == 1_790_000_000_000_000_000
    assert second.losses == Losses(1, 2, 3, 4, 5, 6, 7, 8, 9)
    (event,) = second.events
    assert (event.t_ns, event.code) == (1_790_000_000_500_000_000, "bump")
    assert (event.value, event.text) == (12.5, "added_roll_1")

    (hubs,) = second.groups
    t_s = np.arange(200) * 0.01
    assert (hubs.name, list(hubs.values)) == ("Hubs", ["hub_fl", "body_z"])
    assert_allclose(hubs.time_s, t_s, atol=1e-15)
    assert_array_equal(hubs.t_ns, 1_790_000_000_000_000_000 + np.arange(200) * 10_000_000)
    assert_allclose(hubs.values["hub_fl"], t_s * t_s, atol=1e-15)
    expected = np.exp(-t_s) * np.sin(3 * np.pi * t_s)
    expected[17] = np.nan
    assert_allclose(hubs.values["body_z"], expected, atol=1e-12)
    assert_array_equal(hubs.quality, np.where(np.arange(200) == 17, Quality.MISSING, 0))

    frames = second.frames
    assert_array_equal(frames.t_ns - second.t0_ns, [0, 1_000_001, 2_000_002])
    assert frames.can_id.tolist() == [0x100, 0x1ABCDEF0, 0x7FF]
    assert (frames.flags.tolist(), frames.bus.tolist()) == ([0, 1, 24], [1, 1, 1])
    assert frames.length.tolist() == [8, 2, 64]
    assert_array_equal(frames.data.ravel(), np.arange(192))
    assert dict(session.provenance) == {
        "uuid": "golden",
        "created": "2026-11-21T00:00:00Z",
        "dbc": "BO_ é\n",
    }


def test_it_is_valid() -> None:
    findings = validate_session(V1)
    assert not [finding for finding in findings if finding.severity is not Severity.NOTE]


def test_an_older_file_lacks_the_newest_columns_and_is_read_with_their_defaults(
    tmp_path: Path,
) -> None:
    older = tmp_path / "older.h5"
    older.write_bytes(V1.read_bytes())
    with h5py.File(older, "r+") as file:
        channels = file["channels"]
        for name in set(channels) - {"channel", "name", "quantity", "unit", "corner"}:
            del channels[name]
        del file["session/facts"]
        for holder, prefix in (
            (file["session"], "structure_"),
            (file["runs/r002_added_roll_1"], "lost_"),
        ):
            for name in [name for name in holder.attrs if name.startswith(prefix)]:
                del holder.attrs[name]
    session = read_session(older)
    body = session.channels[1]
    assert (body.x_m, body.sign, body.gain, body.low_pass_order) == (0.0, 1.0, 1.0, 2)
    assert session.vehicle.facts == ()
    assert session.vehicle.structure.symmetric
    assert session.runs[1].losses == Losses()
    assert not [f for f in validate_session(older) if f.severity is Severity.ERROR]
