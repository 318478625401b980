"""Frames as short texts, so that a table of tests can be read."""

from __future__ import annotations

from dbc import FrameBatch, FrameFlag

_LETTERS = {
    "x": FrameFlag.EXTENDED,
    "r": FrameFlag.REMOTE,
    "e": FrameFlag.ERROR,
    "f": FrameFlag.FD,
    "b": FrameFlag.BITRATE_SWITCH,
    "s": FrameFlag.ERROR_STATE,
    "t": FrameFlag.TRANSMITTED,
}


def shown(batch: FrameBatch) -> list[str]:
    """Return frames as ``time in ns, bus, identifier, length, data, letters of its flags``.

    Letters: x extended, r remote, e error, f FD, b bit rate switch, s error state, t transmitted.
    """
    lines = []
    for i in range(len(batch)):
        flags, length = int(batch.flags[i]), int(batch.length[i])
        letters = "".join(letter for letter, flag in _LETTERS.items() if flags & flag)
        # Bytes behind the payload are shown too if they are not zero: none may be left there.
        data = batch.data[i, :length].tobytes().hex() + "!" * bool(batch.data[i, length:].any())
        parts = [f"{batch.t_ns[i]}", f"{batch.bus[i]}", f"{batch.can_id[i]:X}", f"{length}"]
        lines.append(" ".join([*parts, data or "-", letters or "-"]))
    return lines
