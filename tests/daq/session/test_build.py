"""A session is built of the runs of a journal, with what was decided on them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import Bench
from daq.bus.source import HopLosses
from daq.channels import Channel, Quantity
from daq.journal.reader import HopCounts
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from daq.runlog import Code, entry, finding_record, verdict_entry
from daq.runs import Event, Excitation, Run, RunStatus
from daq.session import read_session
from daq.session.build import Derived, build_session, derive
from daq.sessions import Session
from daq.vehicle import Corner
from dbc import Codec, FrameBatch, Quality
from dbc.words import Finding, InputError, Severity

from ..small_campaign import PERIOD_S, START_NS, blocks, bumps, frames_at, small_bench, small_codec

CODEC = small_codec()
WEAK = Finding("too_weak", Severity.ERROR, "weak bump", "", "harder", 1.0, 6.0, "m/s2")
BUMP = Event(START_NS + 1_000_000_000, "bump", 9.0, "baseline_bounce_1")
RUN_END = Event(START_NS + 1_500_000_000, "run_end", 0.0, "baseline_bounce_1")
ACC_FL = Channel("acc_fl", Quantity.HUB_ACCELERATION, "", "HUB_Front.acc_fl", Corner.FRONT_LEFT)
TRAVEL = Channel("travel", Quantity.SUSPENSION_TRAVEL, "", "SUSP_Rear.travel_rr", Corner.REAR_RIGHT)
PITCH = Channel("pitch", Quantity.PITCH_RATE, "", "IMU_Rate.rate_y")
YAW = Channel("yaw", Quantity.UNUSED, "", "IMU_Rate.rate_z")
NO_HOPS = HopCounts(np.zeros(0, np.int64), np.zeros((0, 4), np.int64))


def _bench(*channels: Channel) -> Bench:
    """Return a bench whose runs last, with `BUMP`, from 0.9 s to 1.5 s of the recording."""
    return replace(small_bench(), channels=channels)


def _frames(codec: Codec, message: str, n: int = 2000, **signals: float) -> FrameBatch:
    """Frames in the message's cycle from the start on, each signal n times the same value."""
    layout = codec.message(message)
    given = signals or {layout.signals[0].name: 0.0}
    cycle_ns = round((layout.cycle_s or 0.001) * 1e9)
    data = codec.encode(message, {name: np.full(n, value) for name, value in given.items()})
    return frames_at(START_NS + np.arange(n) * cycle_ns, data, layout.can_id, layout.length)


def _merge(*batches: FrameBatch) -> FrameBatch:
    return FrameBatch.concatenate(batches).by_time()


def _session(bench: Bench, frames: FrameBatch, hops: HopCounts = NO_HOPS) -> Session:
    return build_session(bench, CODEC, frames, (BUMP, RUN_END), hops, {"uuid": "x"})


def _run(bench: Bench, frames: FrameBatch) -> Run:
    return _session(bench, frames).runs[0]


def test_values_are_si_with_polarity_scale_and_zero() -> None:
    channels = (ACC_FL, replace(TRAVEL, sign=-1.0, gain=1.5, tare=0.01), PITCH, YAW)
    frames = _merge(
        _frames(CODEC, "HUB_Front", acc_fl=1.5),
        _frames(CODEC, "SUSP_Rear", travel_rr=20.0),
        _frames(CODEC, "IMU_Rate", rate_y=90.0, rate_z=-45.0),
    )
    session = _session(_bench(*channels), frames)
    values = {name: v for g in session.runs[0].groups for name, v in g.values.items()}
    expected = {
        "acc_fl": 1.5 * 9.80665,
        "travel": -1.5 * 0.020 - 0.01,
        "pitch": math.pi / 2,
        "yaw": -math.pi / 4,
    }
    assert values.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_allclose(values[name], value, rtol=1e-12)
    assert [channel.unit for channel in session.channels] == ["m/s2", "m", "rad/s", "rad/s"]


def test_a_run_is_the_window_around_its_bump() -> None:
    frames = _frames(CODEC, "HUB_Front", acc_fl=1.0)
    run = _run(_bench(ACC_FL), frames)
    assert (run.mass_state, run.excitation, run.repeat) == ("baseline", Excitation.BOUNCE, 1)
    assert (run.status, run.reasons) == (RunStatus.ACCEPTED, ())
    assert run.t0_ns == BUMP.t_ns - 100_000_000
    assert run.events == (BUMP, RUN_END)
    np.testing.assert_array_equal(run.frames.t_ns, frames.t_ns[900:1500])
    np.testing.assert_array_equal(run.frames.data, frames.data[900:1500])
    (group,) = run.groups
    np.testing.assert_allclose(group.time_s, np.arange(600) * 1e-3, atol=1e-9)
    np.testing.assert_array_equal(group.t_ns, run.frames.t_ns)


def test_garbled_lost_and_repeated_frames() -> None:
    frames = _frames(CODEC, "HUB_Front", acc_fl=1.0)
    data = frames.data.copy()
    data[[900, 1100, 1101, 1200], 0] ^= 1  # a flipped bit that the checksum finds
    keep = np.delete(np.arange(2000), [1300, 1301, 1202])
    keep = np.sort(np.append(keep, 1400))
    run = _run(_bench(ACC_FL), replace(frames, data=data).select(keep))
    (group,) = run.groups
    # The first has no counter and no neighbour; the repeated one is no second sample.
    sample = np.delete(np.arange(901, 1500), [1300 - 901, 1301 - 901, 1202 - 901])
    np.testing.assert_allclose(group.time_s, (sample - 900) * 1e-3, atol=1e-9)
    value = dict(zip(sample.tolist(), group.values["acc_fl"].tolist(), strict=True))
    assert {k for k, v in value.items() if math.isnan(v)} == {1100, 1101, 1200}
    quality = dict(zip(sample.tolist(), group.quality.tolist(), strict=True))
    marked = {k: q for k, q in quality.items() if q}
    bad, gap = int(Quality.CRC_BAD), int(Quality.COUNTER_GAP)
    assert marked == {1100: bad, 1101: bad, 1200: bad, 1203: gap, 1302: gap}
    assert (run.losses.crc_bad, run.losses.counter_gaps) == (4, 3)
    assert run.status is RunStatus.ACCEPTED


@pytest.mark.parametrize(
    ("n_hub", "rate", "reason"),
    [
        (1252, None, ""),  # an edge may be silent for 0.25 s, as for the recorder's verdict
        (1249, None, "the recording ended 0.25 s before the run did"),
        (1200, slice(0), "the recording ended 0.30 s before the run did"),
        (2000, slice(0), "no frame of IMU_Rate (0x101) was received"),
        (2000, slice(550), "IMU_Rate was received only from 0.00 to 0.20 s of 0.60 s"),
        (2000, slice(574, 2000), ""),  # from 0.248 s on
        (2000, slice(576, 2000), "IMU_Rate was received only from 0.25 to 0.60 s of 0.60 s"),
        (2000, slice(627), ""),  # to 0.352 s of 0.6 s
        (2000, slice(0, 576, 25), ""),  # slower than in the DBC: ten samples of 50 ms
        (2000, slice(624), "IMU_Rate was received only from 0.00 to 0.35 s of 0.60 s"),
    ],
)
def test_incomplete_runs_are_rejected_with_the_reason(
    n_hub: int, rate: slice | None, reason: str
) -> None:
    bench, frames = _bench(ACC_FL), _frames(CODEC, "HUB_Front", n_hub)
    if rate is not None:
        frames = _merge(frames, _frames(CODEC, "IMU_Rate").select(rate))
        bench = _bench(ACC_FL, PITCH)
    run = _run(bench, frames)
    assert run.reasons == ((reason,) if reason else ())
    assert run.status is (RunStatus.REJECTED if reason else RunStatus.ACCEPTED)


def test_every_attempt_is_a_run_with_what_was_decided_on_it() -> None:
    late_ns = BUMP.t_ns + 5_000_000_000
    events = [
        BUMP,
        RUN_END,
        verdict_entry(RUN_END.t_ns, BUMP.text, [WEAK]),
        replace(BUMP, t_ns=late_ns, text="baseline_bounce_7"),
        verdict_entry(late_ns, "baseline_bounce_7", []),
        entry(Code.REJECT, late_ns + 1, label="baseline_bounce_7", by="Ann", reason="foot on it"),
        replace(BUMP, t_ns=late_ns, text="added_warp_1"),
        replace(BUMP, t_ns=late_ns + 30_000_000_000, text="added_warp_2"),
        verdict_entry(late_ns, "added_warp_2", []),
    ]
    frames = _frames(CODEC, "HUB_Front", 10_000, acc_fl=1.0)
    runs = build_session(_bench(ACC_FL), CODEC, frames, events, NO_HOPS, {}).runs
    reported = {run.label: (run.status, run.reasons) for run in runs}
    assert reported == {
        "baseline_bounce_1": (RunStatus.REJECTED, ("weak bump",)),
        "baseline_bounce_7": (RunStatus.REJECTED, ("rejected by Ann: foot on it",)),
        "added_warp_1": (RunStatus.ACCEPTED, ()),
        # The recorder was content, but its frames are not there.
        "added_warp_2": (RunStatus.REJECTED, ("the recording ended 0.60 s before the run did",)),
    }


def test_the_last_bench_toml_holds_and_what_persons_said_goes_along(tmp_path: Path) -> None:
    bench = small_bench()
    head = JournalHead(bench.text, bench.dbc_text, "test 1", START_NS, 5, "ab" * 16)
    newer = bench.text.replace('name = "Ford Granada"', 'name = "Other car"')
    with JournalWriter(tmp_path, head) as journal:
        journal.append(_frames(CODEC, "HUB_Front"), HopLosses())
        journal.append_events(
            [
                BUMP,
                verdict_entry(BUMP.t_ns, BUMP.text, [WEAK]),
                Event(BUMP.t_ns, "alarm", text="x" * 300),
                Event(START_NS, Code.BENCH, text=newer),
                entry(Code.NOTE, START_NS, text="wet floor", label=BUMP.text, by="Ann"),
                entry(Code.OVERRIDE, START_NS, subject="bus", reason="known", by="Bob"),
            ]
        )
    derive(journal.paths, tmp_path / "session.h5")
    session = read_session(tmp_path / "session.h5")
    assert session.vehicle.name == "Other car"
    assert session.provenance["bench_toml"] == newer
    assert session.provenance["uuid"].replace("-", "") == "ab" * 16
    assert json.loads(session.provenance["verdicts"]) == {BUMP.text: [finding_record(WEAK)]}
    assert [event.code for event in session.runs[0].events] == ["bump", "alarm"]
    assert len(session.runs[0].events[1].text) == 160
    (note,) = json.loads(session.provenance["notes"])
    assert (note["text"], note["label"], note["by"]) == ("wet floor", BUMP.text, "Ann")
    (override,) = json.loads(session.provenance["overrides"])
    assert (override["subject"], override["reason"]) == ("bus", "known")


def test_losses_on_the_way_belong_to_the_run_in_which_they_happened() -> None:
    frames = _frames(CODEC, "HUB_Front")
    t_ns = START_NS + np.arange(1, 20) * 100_000_000
    counts = np.zeros((19, 4), np.int64)
    counts[3:] = [5, 6, 7, 8]  # before the run
    counts[12:] += [1, 2, 3, 4]  # in it
    counts[17:] += 100  # after it
    run = _session(_bench(ACC_FL), frames, HopCounts(t_ns, counts)).runs[0]
    assert (run.losses.bus_dropped, run.losses.bus_garbled, run.losses.queue_dropped) == (1, 2, 4)


@pytest.mark.parametrize("label", ["loaded_bounce_1", "baseline_jump_1", ""])
def test_a_bump_that_is_no_run_is_not_passed_over(label: str) -> None:
    bench = _bench(ACC_FL)
    stray = replace(BUMP, text=label)
    with pytest.raises(InputError, match=f"a bump '{label}', which is not a run"):
        build_session(bench, CODEC, _frames(CODEC, "HUB_Front"), (stray,), NO_HOPS, {})


# How much of a run may be missing, and its events -------------------------------------------------

MS = 1_000_000
BEGAN, ENDED = BUMP.t_ns - 100 * MS, BUMP.t_ns + 500 * MS


def test_events_within_a_run_are_kept_and_long_texts_cut() -> None:
    kept = [
        Event(BEGAN, "alarm", 1.0, "first"),
        Event(BUMP.t_ns, "alarm", 2.0, "ä" * 80),
        Event(ENDED, "alarm", 3.0, "last"),
    ]
    long = Event(BUMP.t_ns + 1, "alarm", 4.0, "ä" * 80 + "b")
    others = [
        Event(BEGAN - 1, "alarm", 5.0, "before"),
        Event(ENDED + 1, "alarm", 6.0, "after"),
    ]
    frames = _frames(CODEC, "HUB_Front")
    events = (BUMP, RUN_END, *kept, long, *others)
    run = build_session(_bench(ACC_FL), CODEC, frames, events, NO_HOPS, {}).runs[0]
    short = replace(long, text="ä" * 78 + "...")
    assert sorted(run.events, key=lambda event: event.value) == (
        sorted((RUN_END, *kept, short, BUMP), key=lambda event: event.value)
    )


# Sessions built from a journal, run by run: what reaches them, and that ---------------------------


NO_LOSSES = HopLosses()


class Recorded:
    """A journal to which runs are added; a bump every 1.2 s, with 0.6 s of frames around it."""

    def __init__(self, folder: Path) -> None:
        self.text = small_bench().text
        for key, value in (("pre_s", 0.1), ("post_s", 0.5), ("rest_s", 0.1)):
            self.text = re.sub(rf"^{key} = [^#\n]*", f"{key} = {value} ", self.text, flags=re.M)
        dbc = small_bench().dbc_text
        head = JournalHead(self.text, dbc, "test", START_NS, 0, "a" * 32, 1)
        self.writer = JournalWriter(folder / "journal", head)
        self.target = folder / "session_0001.h5"
        self._frames = bumps(small_codec(), 12)
        self.runs = 0

    def run(self) -> None:
        """Add a run, whose first block loses a frame, and the frames until the next."""
        self.runs += 1
        n = round(PERIOD_S * 1000)
        period = self._frames.select(slice((self.runs - 1) * n, self.runs * n))
        label = f"baseline_bounce_{self.runs}"
        bump_ns = int(period.t_ns[0]) + 500_000_000
        for k, block in enumerate(blocks(period)):
            self.writer.append(block, HopLosses(bus_dropped=self.runs - (k < 4)))
        self.writer.append_events([Event(bump_ns, Code.BUMP, 20.0, label)])
        self.writer.append_events([verdict_entry(bump_ns + 500_000_000, label, [])])
        self.writer.cut()

    def append(self, *events: Event) -> None:
        self.writer.append_events(events)
        self.writer.cut()

    def build(self) -> Derived:
        left = [path for path in self.writer.paths if path.exists()]
        return derive(left, self.target)


@pytest.fixture
def campaign(tmp_path: Path) -> Iterator[Recorded]:
    made = Recorded(tmp_path)
    with made.writer:
        yield made


def test_runs_verdicts_benches_and_late_frames_reach_the_session(campaign: Recorded) -> None:
    for number in (1, 2):
        campaign.run()
        derived = campaign.build()
        assert (derived.loss, len(derived.session.runs)) == ("", number)
        stored = read_session(campaign.target)
        assert [run.label for run in stored.runs] == [run.label for run in derived.session.runs]
    assert [run.losses.bus_dropped for run in stored.runs] == [1, 1]
    now_ns = START_NS + 2_400_000_000
    campaign.append(
        entry(Code.REJECT, now_ns, label="baseline_bounce_1", by="Ann", reason="slipped"),
        Event(START_NS, Code.BENCH, 0.0, campaign.text.replace('"Ford Granada"', '"Mine"')),
    )
    campaign.writer.append(bumps(small_codec(), 1, "HUB_Rear"), NO_LOSSES)  # a bus held up
    campaign.writer.cut()
    campaign.build()
    stored = read_session(campaign.target)
    assert stored.vehicle.name == "Mine"
    assert stored.runs[0].reasons[0] == "rejected by Ann: slipped"
    assert any(group.name == "HUB_Rear" for group in stored.runs[0].groups)
    built = campaign.target.read_bytes()
    campaign.build()
    assert campaign.target.read_bytes() == built
    assert list(campaign.target.parent.glob(".*")) == []


def test_missing_blocks_are_named_and_a_session_with_more_is_kept(campaign: Recorded) -> None:
    for _ in range(2):
        campaign.run()
    campaign.build()
    whole = campaign.target.read_bytes()
    campaign.writer.paths[0].unlink()
    left = [path for path in campaign.writer.paths if path.exists()]
    with pytest.raises(InputError, match="has more of baseline_bounce_1 than the journal now"):
        derive(left, campaign.target, replacing=False)
    assert campaign.target.read_bytes() == whole
    assert "missing before it" in campaign.build().loss
    campaign.target.write_bytes(b"mine")
    with pytest.raises(InputError, match="is no session or a changed one"):
        derive(left, campaign.target, replacing=False)


def test_a_segment_that_is_still_written_is_no_loss(campaign: Recorded) -> None:
    campaign.run()
    campaign.writer.append(bumps(small_codec(), 1).select(slice(0, 5)), NO_LOSSES)
    derived = derive(campaign.writer.paths, campaign.target)
    assert (derived.loss, len(derived.session.runs)) == ("", 1)
    assert read_session(campaign.target).provenance["journal_losses"] == "none"
