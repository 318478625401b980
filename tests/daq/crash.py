"""Kills, crash images, failing operations, full and vanishing disks: `python -m tests.daq.crash`.

R1, R5, R17 and those with "record" in their name drive the whole command from outside; the others
drive the writer of the journal, in far larger numbers or on a clock of their own.

The figures reached are printed for the recorder's manual; any frame lost is an error.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from daq.control.address import control_address
from daq.control.exchange import Client
from daq.control.messages import SessionState, Start, Stop
from daq.journal.reader import recordings
from dbc.frames import FrameBatch

from .crash_frames import journal_of_runs, kill_derive, read_journal
from .crash_process import (
    KILLS_A_FOLDER,
    MORE_ROOM,
    PATIENCE_S,
    RATE_HZ,
    SOUND_DISK,
    Kills,
    Part,
    RecorderProcess,
    Sender,
    assert_gapless,
    cut,
    die_with_parent,
    kills,
    numbers_of,
    recovered,
    timed,
)
from .crash_writer import (
    KINDS,
    TAKINGS,
    disks_full,
    faults,
    images,
    mounted_disk,
    read_only_disk,
    run_full,
    take_away,
    unmounted,
)

_SMALL_MEMORY = "400000"
"""Memory for blocks that wait, bytes: a second of frames, in place of a minute."""


def fail_once(place: Path, kind: str, nth: int) -> int:
    """Record while one operation fails; return the number of frames sent."""
    place.mkdir(parents=True)
    disk = (kind, str(nth))
    with Sender(hot=False) as sender, RecorderProcess(place / "out", sender, disk) as recorder:
        recorder.wait_open()
        recorder.until(lambda status: bool(status.disk.failed or status.disk.warning))
        recorder.until(lambda status: not (status.disk.failed or status.disk.held_frames))
        recorder.until(lambda status: status.disk.recorded_frames > 0)  # an adapter opens slowly
        time.sleep(0.2)
        return _ended(place, recorder, sender, dropped=0)


def failure(folder: Path, i: int) -> int:
    """Let one operation fail, another kind and place for each `i`; return the frames sent."""
    place = folder / f"failure{i}"
    frames = fail_once(place, KINDS[i % len(KINDS)], 2 + i // len(KINDS) * 5 + i % 3)
    shutil.rmtree(place)
    return frames


@dataclass(frozen=True, slots=True)
class Full:
    """A full disk: frames sent, dropped and reported, and the time from room to recording, s."""

    kind: str
    sent: int
    dropped: int
    resumed_s: float


def fill_once(place: Path, size: int, *, drops: bool, mount: bool) -> Full:
    """Record until a disk is full, and on when it has room again.

    `drops`: with so little memory for what waits that frames are dropped.  `mount`: a disk of the
    kernel's, at whose reserve the recorder stops, in place of our own, which refuses to write.
    """
    held = _SMALL_MEMORY if drops else ""
    place.mkdir(parents=True)
    with ExitStack() as stack:
        disk = stack.enter_context(mounted_disk(place / "disk", size)) if mount else None
        folder = place / "out" if disk is None else place / "disk" / "out"
        shim = SOUND_DISK if disk else ("small", str(size))
        sender = stack.enter_context(Sender(hot=False))
        process = RecorderProcess(folder, sender, shim, held, beside=place)
        recorder = stack.enter_context(process)
        recorder.wait_open()
        recorder.until(lambda status: bool(status.disk.failed) and status.disk.held_frames > 0)
        if drops:
            recorder.until(lambda status: status.disk.dropped_frames > 0)
        else:
            time.sleep(1.0)
        if disk is None:
            (place / MORE_ROOM).touch()
        else:
            disk.give_back()
        given_s = time.monotonic()
        recorder.until(lambda status: not (status.disk.failed or status.disk.held_frames))
        resumed_s = time.monotonic() - given_s
        dropped = recorder.status().disk.dropped_frames
        assert (dropped > 0) == drops
        sent = _ended(place, recorder, sender, dropped, folder)
        return Full(disk.kind if disk else "our own", sent, dropped, resumed_s)


def fill(folder: Path, i: int) -> Full:
    """Let a disk run full, larger with `i`; every third costs frames, which are counted."""
    place = folder / f"full{i}"
    done = fill_once(place, 60_000 + i * 97_003, drops=i % 3 == 2, mount=i % 2 == 0)
    shutil.rmtree(place)
    return done


def _ended(
    place: Path, recorder: RecorderProcess, sender: Sender, dropped: int, folder: Path | None = None
) -> int:
    """End sender and recorder, recover, and compare; return the frames stored and dropped."""
    first, stop = sender.openings[-1], sender.pause()
    kept = stop - first - dropped
    recorder.until(lambda status: status.disk.recorded_frames >= kept)
    recorder.end()
    found = recovered(folder or place / "out", sender)
    # A recorder on a busy machine may have opened the line anew: `first` is from then on.
    numbers = found.numbers[found.numbers >= first]
    assert len(numbers) == kept, f"{kept - len(numbers)} frames lost"
    if not dropped:
        assert_gapless(found.numbers, sender)
    lost = found.lost
    assert found.dropped == dropped, lost.text
    assert (lost.blocks_missing > 0) == (dropped > 0), lost.text
    assert lost.bytes_cut == 0, lost.text
    return len(found.numbers) + dropped


# R17: the whole `bumpbench record` as a daemon through three campaigns, in real time ------------


DAEMON_CAMPAIGNS = 3


def daemon(folder: Path, seconds: float) -> int:
    """Lead a daemon through three campaigns with as long between; return the number of frames."""
    out = folder / "out"
    with Sender(hot=False) as sender, RecorderProcess(out, sender) as recorder:
        recorder.wait_open()
        recorder.status()  # from here on it listens
        began_s = time.monotonic()
        with_control = Client(control_address(out), "Anna", control=True)
        for campaign in range(1, DAEMON_CAMPAIGNS + 1):
            if campaign > 1:
                with_control.ask(Start(), PATIENCE_S)
            _sleep_until(began_s + (campaign - 0.5) / DAEMON_CAMPAIGNS * seconds)
            with_control.ask(Stop(), PATIENCE_S)
            recorder.until(
                lambda status: not status.recording and status.session.state is SessionState.READY
            )
            _sleep_until(began_s + campaign / DAEMON_CAMPAIGNS * seconds)
        stop = sender.pause()
        sent = np.arange(sender.openings[-1], stop)
        recorder.until(lambda status: status.storage.stored_frames == len(sent))
        with_control.close()
        recorder.end()
        said = [line for line in (recorder.place / "log").open() if "not_recording" in line]
    assert not said, said
    found = recordings(out / "journal")
    contents = [read_journal(each.segments) for each in found]
    spans = [each.head.campaign for each in contents]
    assert spans == [True, False] * DAEMON_CAMPAIGNS, spans
    assert not any(each.lost.any for each in contents)
    frames = FrameBatch.concatenate([each.frames for each in contents])
    assert np.array_equal(numbers_of(frames), sent), "a frame is missing or doubled"
    return len(sent)


def _sleep_until(deadline_s: float) -> None:
    time.sleep(max(deadline_s - time.monotonic(), 0.0))


# Kills, crash images, failing operations, full and vanishing disks: `python -m tests.daq.crash` ---


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign: how many, what each part does, and what is printed of all."""

    count: int
    parts: Callable[[Path, int], list[Part]]
    text: Callable[[Sequence[Any]], str]
    alone: bool = False
    """True if it holds the recorder to a time, so that nothing else may run."""


def _each(part: Callable[[Path, int], Any]) -> Callable[[Path, int], list[Part]]:
    """Return what makes a part of each of so many."""
    return lambda folder, count: [partial(part, folder, i) for i in range(count)]


def _whole(part: Callable[[Path, int], str]) -> Callable[[Path, int], list[Part]]:
    """Return what makes one part of all."""
    return lambda folder, count: [partial(part, folder, count)]


def _only(texts: Sequence[str]) -> str:
    (text,) = texts
    return text


def _kills(folder: Path, count: int) -> list[Part]:
    size = KILLS_A_FOLDER
    firsts = range(0, count, size)
    return [partial(kills, folder, first, min(size, count - first)) for first in firsts]


def _killed(done: Sequence[Kills]) -> str:
    flight = [n / RATE_HZ * 1e3 for some in done for n in some.in_flight] or [0.0]
    return (
        f"{sum(some.kills for some in done)} kills of `record` in {len(done)} folders, every other"
        f" unthrottled, {sum(some.read for some in done):,} frames read,"
        f" {sum(some.runs for some in done)} runs recovered: 0 acknowledged lost, 0 doubled; in"
        f" flight {np.median(flight):.0f} ms, at most {max(flight):.0f} ms"
    )


def _images(folder: Path, count: int) -> str:
    beyond = images(folder, count)
    return f"{count} crash images: 0 acknowledged lost, 0 wrong; {beyond} held more than that"


def _faults(folder: Path, count: int) -> str:
    failed = faults(folder, range(1, count + 1))
    return f"{failed} failing operations (EIO, ENOSPC, short, fdatasync): 0 lost, 0 doubled"


def _failed(frames: Sequence[int]) -> str:
    return (
        f"{len(frames)} failing operations of `record`: 0 of {sum(frames):,} frames lost, 0 doubled"
    )


def _full(folder: Path, sizes: int) -> str:
    done = disks_full(folder, sizes, full_s=90.0)
    kinds = ", ".join(sorted({full.kind for full in done}))
    return (
        f"{len(done)} full disks ({kinds}): 0 recorded lost,"
        f" {sum(full.dropped for full in done):,} frames dropped and reported exactly; alarm"
        f" {max(full.alarm_s for full in done):.1f} s, taken up"
        f" {max(full.resumed_s for full in done):.1f} s after room came back, memory"
        f" +{max(full.grown_bytes for full in done) / 1e6:.0f} MB"
    )


def _filled(done: Sequence[Full]) -> str:
    kinds = ", ".join(sorted({full.kind for full in done}))
    return (
        f"{len(done)} full disks ({kinds}) of `record`: {sum(full.sent for full in done):,} frames"
        f" sent, {sum(full.dropped for full in done):,} dropped and reported exactly, 0 others"
        f" lost; taken up {max(full.resumed_s for full in done):.1f} s after room came back"
    )


def _power(done: Sequence[tuple[int, int] | None]) -> str:
    cuts = [each for each in done if each is not None]
    if not cuts:
        return "no power cut tried: disks cannot be mounted here"
    frames = sum(acknowledged for acknowledged, _ in cuts)
    return (
        f"{len(cuts)} power cuts (ext4) of `record`: 0 of {frames:,} acknowledged frames lost, 0"
        " doubled"
    )


def _taken(folder: Path, count: int) -> str:
    slowest = 0.0
    for i in range(count):
        for name, how in TAKINGS.items():
            slowest = max(slowest, take_away(folder / f"{name}{i}" / "journal", how))
        run_full(read_only_disk(folder / f"read-only{i}"), 0.0, full_s=3.0)
        told_s = unmounted(folder / f"unmounted{i}")
        slowest = max(slowest, told_s or 0.0)
    mounted = "" if told_s is not None else " (no right to mount: not unmounted)"
    return (
        f"{count} x {', '.join(TAKINGS)}, read-only, unmounted{mounted}: known in {slowest:.1f} s"
    )


def _derive(folder: Path, count: int) -> str:
    segments = journal_of_runs(folder / "small", 200_000)
    done = kill_derive(folder, segments, count)
    return (
        f"{count} kills in mid-derivation, {done.writing} of them while it wrote:"
        f" {done.absent} left no file, {done.whole} a whole one;"
        " derived again bit-equal"
    )


def _daemon(folder: Path, seconds: int) -> str:
    frames = daemon(folder, seconds)
    return f"{seconds} s of a daemon through three campaigns: 0 of {frames:,} frames lost"


CAMPAIGNS = {
    "R17": Campaign(300, _whole(_daemon), _only, alone=True),
    "R1": Campaign(200, _kills, _killed),
    "R2": Campaign(3000, _whole(_images), _only),
    "R3": Campaign(200, _whole(_faults), _only),
    "R3_record": Campaign(40, _each(failure), _failed),
    "R4": Campaign(20, _whole(_full), _only),
    "R4_record": Campaign(30, _each(fill), _filled),
    "R5": Campaign(10, _each(cut), _power),
    "R6": Campaign(3, _whole(_taken), _only),
    "R7": Campaign(50, _whole(_derive), _only),
}


def main() -> int:
    """Run the campaigns; sizes can be given, like `--R1 20`, 0 for none."""
    parser = argparse.ArgumentParser(description="Kill, fill and take away what a recorder needs.")
    parser.add_argument("--jobs", type=int, default=(os.cpu_count() or 1) + 1)
    for name, campaign in CAMPAIGNS.items():
        parser.add_argument(f"--{name}", type=int, default=campaign.count)
    sizes = vars(parser.parse_args())
    wanted = [name for name in CAMPAIGNS if sizes[name]]
    code, began_s = 0, time.monotonic()
    spawned = multiprocessing.get_context("spawn")  # threads and locks of this process stay here
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(sizes["jobs"], spawned, die_with_parent) as jobs,
    ):
        for alone in (True, False):
            begun = {
                name: [jobs.submit(timed, part) for part in _parts(folder, name, sizes[name])]
                for name in wanted
                if CAMPAIGNS[name].alone is alone
            }
            for name, parts in begun.items():
                results, why, seconds = zip(*(part.result() for part in parts), strict=True)
                failed = "; ".join(filter(None, why))
                code = code or int(bool(failed))
                text = f"FAILED: {failed}" if failed else CAMPAIGNS[name].text(results)
                sys.stdout.write(f"{name}  {text}  [{sum(seconds):.0f} s]\n")
                sys.stdout.flush()
    sys.stdout.write(f"{time.monotonic() - began_s:.0f} s in all, {sizes['jobs']} at a time\n")
    return code


def _parts(folder: str, name: str, size: int) -> list[Part]:
    place = Path(folder, name)
    place.mkdir()
    return CAMPAIGNS[name].parts(place, size)


if __name__ == "__main__":
    sys.exit(main())
