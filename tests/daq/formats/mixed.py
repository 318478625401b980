"""Frames of every kind, as python-can's messages and as short texts for tables of tests."""

from __future__ import annotations

from dataclasses import dataclass, replace

import can
import numpy as np

from dbc import FrameBatch, FrameFlag

START_S = 1_760_000_000
FD_LENGTHS = (0, 1, 5, 8, 12, 16, 20, 24, 32, 48, 64)


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame; microseconds count from START_S."""

    t_us: int
    can_id: int
    length: int
    data: bytes
    bus: int = 0
    extended: bool = False
    remote: bool = False
    error: bool = False
    fd: bool = False
    brs: bool = False
    esi: bool = False
    sent: bool = False


def mixed(n: int, seed: int = 1) -> list[Frame]:
    """Return n frames: standard, extended, remote, error, FD with BRS and with ESI."""
    rng = np.random.default_rng(seed)
    frames = []
    for i in range(n):
        kind = ("std", "ext", "std", "rtr", "fd", "brs", "esi", "err")[i % 8]
        extended = kind == "ext" or bool(rng.integers(2) and kind not in ("std", "err"))
        fd = kind in ("fd", "brs", "esi")
        length = int(rng.choice(FD_LENGTHS)) if fd else int(rng.integers(9))
        frames.append(
            Frame(
                t_us=i * 997,
                can_id=int(rng.integers(1 << 29 if extended else 1 << 11)),
                length=length,
                data=b"" if kind == "rtr" else rng.bytes(length),
                bus=int(rng.integers(3)),
                extended=extended,
                remote=kind == "rtr",
                error=kind == "err",
                fd=fd,
                brs=kind in ("brs", "esi"),
                esi=kind == "esi",
                sent=bool(rng.integers(2)) and kind != "err",
            )
        )
    # A payload that looks like the mark of an object in a BLF.
    frames[0] = replace(frames[0], length=8, data=b"xxLOBJ\x20\x00")
    return frames


def message(frame: Frame) -> can.Message:
    return can.Message(
        timestamp=START_S + frame.t_us * 1e-6,
        arbitration_id=frame.can_id,
        dlc=frame.length,
        data=frame.data or None,
        channel=frame.bus,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        is_error_frame=frame.error,
        is_fd=frame.fd,
        bitrate_switch=frame.brs,
        error_state_indicator=frame.esi,
        is_rx=not frame.sent,
    )


FLAGS = {
    "extended": ("x", FrameFlag.EXTENDED),
    "remote": ("r", FrameFlag.REMOTE),
    "error": ("e", FrameFlag.ERROR),
    "fd": ("f", FrameFlag.FD),
    "brs": ("b", FrameFlag.BITRATE_SWITCH),
    "esi": ("s", FrameFlag.ERROR_STATE),
    "sent": ("t", FrameFlag.TRANSMITTED),
}
"""Letter and flag of each property of a frame."""


def frames_in(batch: FrameBatch) -> list[Frame]:
    """Return a batch as frames; stamps to the microsecond."""
    frames = []
    for i in range(len(batch)):
        flags, length = int(batch.flags[i]), int(batch.length[i])
        marks = {name: bool(flags & flag) for name, (_, flag) in FLAGS.items()}
        t_us = round((int(batch.t_ns[i]) - START_S * 1_000_000_000) / 1000)
        data = b"" if marks["remote"] else batch.data[i, :length].tobytes()
        frames.append(Frame(t_us, int(batch.can_id[i]), length, data, int(batch.bus[i]), **marks))
    return frames


def batch_of(frames: list[Frame]) -> FrameBatch:
    """Return frames as a batch, the inverse of `frames_in`."""
    flags = [sum(flag for name, (_, flag) in FLAGS.items() if getattr(f, name)) for f in frames]
    return FrameBatch(
        np.array([START_S * 1_000_000_000 + f.t_us * 1000 for f in frames]),
        np.array([f.can_id for f in frames], np.uint32),
        np.array(flags, np.uint16),
        np.array([f.bus for f in frames], np.uint8),
        np.array([f.length for f in frames], np.uint8),
        np.frombuffer(b"".join(f.data.ljust(64, b"\0") for f in frames), np.uint8).reshape(-1, 64),
    )


def shown(batch: FrameBatch) -> list[str]:
    """Return frames as ``time in ns, bus, identifier, length, data, letters of its flags``.

    Letters: x extended, r remote, e error, f FD, b bit rate switch, s error state, t transmitted.
    """
    lines = []
    for i in range(len(batch)):
        flags, length = int(batch.flags[i]), int(batch.length[i])
        letters = "".join(letter for letter, flag in FLAGS.values() if flags & flag)
        # Bytes behind the payload are shown too if they are not zero: none may be left there.
        data = batch.data[i, :length].tobytes().hex() + "!" * bool(batch.data[i, length:].any())
        parts = [f"{batch.t_ns[i]}", f"{batch.bus[i]}", f"{batch.can_id[i]:X}", f"{length}"]
        lines.append(" ".join([*parts, data or "-", letters or "-"]))
    return lines
