"""Kills, crash images, failing operations, full and vanishing disks: `python -m tests.daq.crash`.

R1, R5, R17 and those with "record" in their name drive the whole command from outside; the others
drive the writer of the journal, in far larger numbers or on a clock of their own.

The figures reached are printed for the recorder's manual; any frame lost is an error.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .crash_broken import failures, fills
from .crash_daemon import daemon
from .crash_derive import journal_of_runs, kill_derive, rates
from .crash_faults import faults
from .crash_full import disks_full
from .crash_images import images
from .crash_kills import kills
from .crash_power import cuts
from .crash_sender import RATE_HZ
from .crash_slow import slow_disk
from .crash_taken import TAKINGS, read_only, take_away, unmounted


def _kills(folder: Path, count: int) -> str:
    done = kills(folder, count)
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


def _failures(folder: Path, count: int) -> str:
    frames = failures(folder, count)
    return f"{count} failing operations of `record`: 0 of {frames:,} frames lost, 0 doubled"


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


def _fills(folder: Path, count: int) -> str:
    done = fills(folder, count)
    kinds = ", ".join(sorted({full.kind for full in done}))
    return (
        f"{len(done)} full disks ({kinds}) of `record`: {sum(full.sent for full in done):,} frames"
        f" sent, {sum(full.dropped for full in done):,} dropped and reported exactly, 0 others"
        f" lost; taken up {max(full.resumed_s for full in done):.1f} s after room came back"
    )


def _power(folder: Path, count: int) -> str:
    done = cuts(folder, count)
    if done is None:
        return "no power cut tried: disks cannot be mounted here"
    frames = sum(acknowledged for acknowledged, _ in done)
    return (
        f"{len(done)} power cuts (ext4) of `record`: 0 of {frames:,} acknowledged frames lost, 0"
        " doubled"
    )


def _taken(folder: Path, count: int) -> str:
    slowest = 0.0
    for i in range(count):
        for name, how in TAKINGS.items():
            slowest = max(slowest, take_away(folder / f"{name}{i}" / "journal", how))
        read_only(folder / f"read-only{i}")
        told_s = unmounted(folder / f"unmounted{i}")
        slowest = max(slowest, told_s or 0.0)
    mounted = "" if told_s is not None else " (no right to mount: not unmounted)"
    return (
        f"{count} x {', '.join(TAKINGS)}, read-only, unmounted{mounted}: known in {slowest:.1f} s"
    )


def _derive(folder: Path, count: int) -> str:
    segments = journal_of_runs(folder / "small", 200_000)
    done = kill_derive(folder, segments, count)
    verified, derived = rates(folder / "large", 4_000_000)
    return (
        f"{count} kills in mid-derivation, {done.writing} of them while it wrote:"
        f" {done.absent} left no file, {done.whole} a whole one;"
        f" derived again bit-equal; {verified / 1e6:.1f} M frames/s verified,"
        f" {derived / 1e6:.1f} M frames/s derived"
    )


def _slow(folder: Path, seconds: int) -> str:
    slow = slow_disk(folder, seconds)
    return (
        f"{seconds} s with fdatasync taking 1 s: 0 of {slow.frames:,} frames lost; queue at most"
        f" {slow.queue_high} of {slow.queue_room} blocks"
    )


def _daemon(folder: Path, seconds: int) -> str:
    frames = daemon(folder, seconds)
    return f"{seconds} s of a daemon through three campaigns: 0 of {frames:,} frames lost"


CAMPAIGNS: dict[str, tuple[Callable[[Path, int], str], int]] = {
    "R1": (_kills, 200),
    "R2": (_images, 3000),
    "R3": (_faults, 200),
    "R3_record": (_failures, 40),
    "R4": (_full, 20),
    "R4_record": (_fills, 30),
    "R5": (_power, 10),
    "R6": (_taken, 3),
    "R7": (_derive, 50),
    "R16": (_slow, 15),
    "R17": (_daemon, 300),
}


def main() -> int:
    """Run the campaigns; sizes can be given, like `--R1 20`."""
    parser = argparse.ArgumentParser(description="Kill, fill and take away what a recorder needs.")
    for name, (_, count) in CAMPAIGNS.items():
        parser.add_argument(f"--{name}", type=int, default=count)
    sizes = vars(parser.parse_args())
    code = 0
    for name, (campaign, _) in CAMPAIGNS.items():
        if not sizes[name]:
            continue
        with tempfile.TemporaryDirectory() as folder:
            began_s = time.monotonic()
            try:
                text = campaign(Path(folder), sizes[name])
            except AssertionError as error:
                text, code = f"FAILED: {error}", 1
            sys.stdout.write(f"{name}  {text}  [{time.monotonic() - began_s:.0f} s]\n")
            sys.stdout.flush()
    return code


if __name__ == "__main__":
    sys.exit(main())
