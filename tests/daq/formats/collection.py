"""Every log in folders against python-can: `python -m tests.daq.formats.collection FOLDER ...`.

Each log that python-can reads (MF4 with asammdf) must be read frame for frame: identifier, kind,
payload, channel, and the time to 1 us, counted from the first frame.  Prints what differs, and what
only one of the two reads.
"""

from __future__ import annotations

import logging
import shutil
import sys
import warnings
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import can

from daq.errors import InputError
from daq.formats.log import read_log
from dbc import FrameBatch, FrameFlag

SUFFIXES = (".asc", ".blf", ".trc", ".log", ".csv", ".mf4", ".mdf", ".mfc", ".gz", ".txt")
_MOST_US = 1.01

Row = tuple[int, bool, bool, bool, bool, bool, bool, int, bytes]
"""Identifier, extended, remote, error, FD, BRS, ESI, length, payload."""


def by_python_can(path: Path) -> list[tuple[float, object, Row]]:
    """Return time, s, channel and the rest of each frame as python-can reads them.

    Raises whatever it raises.
    """
    with TemporaryDirectory() as folder:
        suffix = ".mf4" if path.suffix.lower() in (".mfc", ".mf4", ".mdf") else path.suffix.lower()
        if suffix == ".gz":
            suffix = "".join(path.suffixes[-2:]).lower()
        copy = Path(folder, f"log{suffix}")
        shutil.copy(path, copy)
        reader = can.LogReader(copy)
        try:
            return [(m.timestamp, m.channel, _row(m)) for m in reader]
        finally:
            reader.stop()


def _row(m: can.Message) -> Row:
    data = b"" if m.is_remote_frame else bytes(m.data)
    length = m.dlc if m.is_remote_frame else len(data)
    kind = (m.is_extended_id, m.is_remote_frame, m.is_error_frame)
    more = (m.is_fd, m.bitrate_switch, m.error_state_indicator)
    return (m.arbitration_id, *kind, *more, length, data)


def ours(path: Path) -> tuple[list[tuple[int, int, Row]], str]:
    """Return time, ns, bus and the rest of each frame, and the losses.  Raises InputError."""
    log = read_log(path)
    batch = FrameBatch.concatenate(list(log))
    flags = batch.flags
    marks = (
        FrameFlag.EXTENDED, FrameFlag.REMOTE, FrameFlag.ERROR,
        FrameFlag.FD, FrameFlag.BITRATE_SWITCH, FrameFlag.ERROR_STATE,
    )  # fmt: skip
    columns = [((flags & mark) != 0).tolist() for mark in marks]
    rows = []
    for i, (t_ns, can_id, bus, length) in enumerate(
        zip(
            batch.t_ns.tolist(), batch.can_id.tolist(),
            batch.bus.tolist(), batch.length.tolist(), strict=True,
        )
    ):  # fmt: skip
        data = b"" if columns[1][i] else batch.data[i, :length].tobytes()
        extended, remote, error, fd, brs, esi = (column[i] for column in columns)
        rows.append((t_ns, bus, (can_id, extended, remote, error, fd, brs, esi, length, data)))
    return rows, log.loss.text


def compare(path: Path, counts: Counter[str]) -> list[str]:
    """Return what is to be said of one log."""
    try:
        theirs = by_python_can(path)
    except Exception as error:
        theirs, refusal = [], f"{type(error).__name__}: {str(error)[:80]}"
    else:
        refusal = "" if theirs else "no frames"
    try:
        found, loss = ours(path)
    except InputError as error:
        if theirs:
            counts["refused, and python-can reads it"] += 1
            return [f"REFUSED {error}"]
        counts["refused by both"] += 1
        return [f"both refuse: {error}"]
    counts["logs read"] += 1
    counts["frames read"] += len(found)
    lines = [f"losses {path}: {loss}"] if loss else []
    if refusal:
        counts["read by us alone"] += 1
        return [*lines, f"python-can does not read {path}: {refusal}; {len(found)} frames here"]
    counts["frames of python-can"] += len(theirs)
    lines += [f"DIFFERS {path}: {what}" for what in _differences(found, theirs)]
    counts["logs equal"] += not any(line.startswith("DIFFERS") for line in lines)
    return lines


def _differences(
    found: list[tuple[int, int, Row]], theirs: list[tuple[float, object, Row]]
) -> list[str]:
    if len(found) != len(theirs):
        return [f"{len(found)} frames, python-can {len(theirs)}"]
    found = sorted(found, key=lambda f: (f[0], str(f[2])))
    first_ns = min(f[0] for f in found)
    first_s = min(t[0] for t in theirs)
    theirs = sorted(theirs, key=lambda t: (t[0], str(t[2])))
    late = max(
        abs((f[0] - first_ns) * 1e-3 - (t[0] - first_s) * 1e6)
        for f, t in zip(found, theirs, strict=True)
    )
    said = [f"times differ by up to {late:.1f} us"] if late > _MOST_US else []
    rows = [(f[2], t[2]) for f, t in zip(found, theirs, strict=True) if not _same(f[2], t[2])]
    if sorted(str(a) for a, _ in rows) != sorted(str(b) for _, b in rows):  # order at one time
        said.append(f"{len(rows)} frames, as {rows[0][0]} and {rows[0][1]}")
    pairs = {(f[1], t[1]) for f, t in zip(found, theirs, strict=True) if f[2] == t[2]}
    if len({bus for bus, _ in pairs}) != len(pairs) or len({c for _, c in pairs}) != len(pairs):
        said.append(f"buses and channels {sorted(map(str, pairs))}")
    return said


def _same(own: Row, their: Row) -> bool:
    """Return whether two frames are the same, but for what python-can has by default.

    It says of each error frame without identifier that it has one of 29 bits, and cuts frames of FD
    in the form of classic ones to 8 bytes.
    """
    if own[3] and their[3]:
        return (own[0], own[7:]) == (their[0], their[7:])
    is_cut = own[4] and not their[4] and len(own[8]) > len(their[8]) == 8
    return own == their or (is_cut and (own[:2], own[8][:8]) == (their[:2], their[8]))


def main() -> int:
    """Compare all logs below some folders."""
    logging.disable()
    warnings.simplefilter("ignore")
    counts: Counter[str] = Counter()
    faults = 0
    for folder in sys.argv[1:]:
        for path in sorted(Path(folder).rglob("*")):
            if path.suffix.lower() in SUFFIXES and path.is_file() and path.stat().st_size > 150:
                lines = compare(path, counts)
                faults += sum(line.startswith(("DIFFERS", "REFUSED")) for line in lines)
                sys.stdout.write("".join(f"{line}\n" for line in lines))
                sys.stdout.flush()
    sys.stdout.write("".join(f"{n:>10,} {name}\n" for name, n in sorted(counts.items())))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
