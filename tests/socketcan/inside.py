"""Checks SocketCAN on a kernel that has it; run by `guest.py` as the only program of a machine."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
import traceback
from collections.abc import Callable

import numpy as np

from daq.bus.error_frames import ControllerState, describe_error_frame
from daq.bus.socketcan import SocketCanSource, open_socketcan
from daq.bus.source import BusError
from dbc.frames import FrameBatch, FrameFlag

HOUR_NS = 3600 * 10**9


def main() -> None:
    """Run every check and print the result of each as TAP."""
    checks: list[Callable[[], str]] = [
        frames_of_64_bytes,
        kernel_stamps,
        exact_loss,
        interface_down_and_up,
        interface_deleted,
        error_frame,
        clock_step,
        two_cards,
        link_state,
        whole_recorder,
    ]
    say("\nTAP version 13")  # on a line of its own, after what the BIOS does to the screen
    for number, check in enumerate(checks, 1):
        ip("link", "add", "vcan0", "type", "vcan")
        ip("link", "set", "vcan0", "mtu", "72", "up")
        try:
            say(f"ok {number} - {check.__name__}: {check()}")
        except Exception:
            say(f"not ok {number} - {check.__name__}")
            say("# " + traceback.format_exc().replace("\n", "\n# "))
        subprocess.run(["ip", "link", "del", "vcan0"], check=False, capture_output=True)
    say(f"1..{len(checks)}")


def say(line: str) -> None:
    """Print to the console."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def ip(*arguments: str) -> str:
    """Call `ip` and return what it says."""
    return subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True).stdout


def sender(channel: str) -> socket.socket:
    """Return a socket that sends raw frames."""
    sending = socket.socket(socket.AF_CAN, socket.SOCK_RAW, 1)
    sending.setsockopt(101, 5, 1)  # CAN_RAW_FD_FRAMES
    sending.bind((channel,))
    return sending


def classic(can_id: int, data: bytes) -> bytes:
    """Return a `struct can_frame`."""
    return can_id.to_bytes(4, "little") + bytes([len(data), 0, 0, 0]) + data.ljust(8, b"\0")


def read_all(source: SocketCanSource) -> FrameBatch:
    """Read until nothing comes for half a second."""
    blocks = [source.read(0.5)]
    while len(blocks[-1]):
        blocks.append(source.read(0.5))
    return FrameBatch.concatenate(blocks)


def frames_of_64_bytes() -> str:
    """FD and classic frames, standard and extended, arrive as they were sent, as echoes."""
    source = open_socketcan("vcan0", 2)
    with sender("vcan0") as sending:
        sending.send((0x123).to_bytes(4, "little") + bytes([64, 1, 0, 0]) + bytes(range(64)))
        sending.send(classic(0x80000000 | 0x1ABCDEF0, b"abc"))
        sending.send(classic(0x40000000 | 0x7FF, b"")[:4] + bytes([5]) + bytes(11))
        batch = read_all(source)
    source.close()
    assert list(batch.can_id) == [0x123, 0x1ABCDEF0, 0x7FF]
    sent, fd = FrameFlag.TRANSMITTED, FrameFlag.FD | FrameFlag.BITRATE_SWITCH
    assert list(batch.flags) == [sent | fd, sent | FrameFlag.EXTENDED, sent | FrameFlag.REMOTE]
    assert list(batch.length) == [64, 3, 5]
    assert bytes(batch.data[0]) == bytes(range(64))
    return "64 bytes with bit rate switch, 29-bit identifier, remote frame"


def kernel_stamps() -> str:
    """Stamps are the kernel's and lie around the moment of sending."""
    source = open_socketcan("vcan0", 0)
    with sender("vcan0") as sending:
        for _ in range(50):  # the kernel takes a while to begin with it
            sending.send(classic(1, b""))
            source.read(0.1)
        before_ns = time.time_ns()
        sending.send(classic(2, b""))
        after_ns = time.time_ns()
        stamp_ns = int(source.read(1.0).t_ns[0])
    restamped = source.losses().restamped
    source.close()
    assert before_ns <= stamp_ns <= after_ns
    assert restamped == 0
    return f"within the {(after_ns - before_ns) / 1e3:.0f} us of sending"


def exact_loss() -> str:
    """Frames that do not fit into the buffer are counted exactly, even the last ones."""
    source = open_socketcan("vcan0", 0)
    count = 30_000
    with sender("vcan0") as sending:
        for i in range(count):
            sending.send(classic(i & 0x7FF, bytes(8)))
    began_s = time.thread_time()
    received = len(read_all(source))
    spent_s = time.thread_time() - began_s
    dropped = source.losses().bus_dropped
    source.close()
    assert dropped > 0
    assert received + dropped == count
    cost_us = spent_s / received * 1e6
    return f"{received} received + {dropped} dropped = {count}; {cost_us:.1f} us a frame (emulated)"


def interface_down_and_up() -> str:
    """Report that the interface was taken down; the same socket receives once it is up again."""
    source = open_socketcan("vcan0", 0)
    ip("link", "set", "vcan0", "down")
    assert len(source.read(1.0)) == 0
    assert source.interface_down
    began_s = time.monotonic()
    assert len(source.read(0.5)) == 0
    assert time.monotonic() - began_s >= 0.5  # waited for, not asked for again and again
    ip("link", "set", "vcan0", "up")
    with sender("vcan0") as sending:
        sending.send(classic(7, b"up"))
        assert list(source.read(1.0).can_id) == [7]
    assert not source.interface_down
    source.close()
    return "same socket receives again"


def interface_deleted() -> str:
    """Raise an error when the interface has gone, after its last frames."""
    source = open_socketcan("vcan0", 0)
    with sender("vcan0") as sending:
        sending.send(classic(9, b""))
    ip("link", "del", "vcan0")
    assert list(source.read(1.0).can_id) == [9]
    try:
        while True:
            source.read(0.1)
    except BusError as error:
        source.close()
        return str(error)


def error_frame() -> str:
    """Error frames are received and marked."""
    source = open_socketcan("vcan0", 0)
    with sender("vcan0") as sending:
        sending.send(classic(0x20000204, bytes([0, 0x20, 0, 0, 0, 0, 0x88, 0x11])))
        batch = source.read(1.0)
    source.close()
    assert batch.flags[0] & FrameFlag.ERROR
    said = describe_error_frame(int(batch.can_id[0]), bytes(batch.data[0, :8]))
    assert (said.state, said.tx_errors, said.rx_errors) == (ControllerState.PASSIVE, 0x88, 0x11)
    return said.text


def clock_step() -> str:
    """Set the clock of the host: stamps go on, nothing waits for it or is lost."""
    source = open_socketcan("vcan0", 0)
    with sender("vcan0") as sending:
        steps_ns = []
        for step_ns in (HOUR_NS, -HOUR_NS):
            sending.send(classic(1, b""))
            before_ns = int(source.read(1.0).t_ns[-1])
            time.clock_settime_ns(time.CLOCK_REALTIME, time.time_ns() + step_ns)
            began_s = time.monotonic()
            sending.send(classic(2, b""))
            steps_ns.append(int(source.read(1.0).t_ns[-1]) - before_ns)
            assert time.monotonic() - began_s < 1.0
    source.close()
    assert all(0 < step_ns < 10**9 for step_ns in steps_ns)
    return f"stamps go on by {steps_ns[0] / 1e9:+.3f} s and {steps_ns[1] / 1e9:+.3f} s"


def two_cards() -> str:
    """One emulated card receives, in order, what the other one sends at 200 Hz."""
    for channel in ("can0", "can1"):
        ip("link", "set", channel, "type", "can", "bitrate", "500000", "restart-ms", "100")
        ip("link", "set", channel, "up")
    source = open_socketcan("can1", 1)
    count, blocks = 200, []
    with sender("can0") as sending:
        for i in range(count):
            sending.send(classic(0x110, i.to_bytes(8, "big")))
            blocks.append(source.read(0.005))
    blocks.append(read_all(source))
    batch = FrameBatch.concatenate(blocks)
    losses = source.losses()
    source.close()
    assert [int.from_bytes(row[:8].tobytes(), "big") for row in batch.data] == list(range(count))
    assert not (batch.flags & FrameFlag.TRANSMITTED).any()
    assert (np.diff(batch.t_ns) > 0).all()
    assert losses.bus_dropped == losses.bus_garbled == 0
    return f"{len(batch)} of {count}"


def link_state() -> str:
    """State, bit rate and restart time of a controller are those of `ip`."""
    data = json.loads(ip("-details", "-json", "link", "show", "can0"))[0]["linkinfo"]["info_data"]
    reported = data["state"], data["bittiming"]["bitrate"], data["restart_ms"]
    assert reported == ("ERROR-ACTIVE", 500_000, 100)
    return f"{reported[0]}, {reported[1]} bit/s, restart after {reported[2]} ms"


def whole_recorder() -> str:
    """Record three interfaces; loading the recorder takes an emulated processor a while."""
    from .recorder_inside import recorder

    return recorder()


if __name__ == "__main__":
    main()
