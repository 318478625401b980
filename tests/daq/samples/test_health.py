import numpy as np
import pytest

from daq.runs import Losses
from daq.samples.converter import HealthState, advance, losses_added
from dbc.frames import FrameBatch, FrameFlag

from ..small_campaign import START_NS, blocks, small_codec

CODEC = small_codec()


def _frames(n: int) -> FrameBatch:
    """Two messages in turn, 1 ms each; what else a bus carries is added by the tests."""
    front, rear = CODEC.message("HUB_Front"), CODEC.message("HUB_Rear")
    data = np.empty((2 * n, 8), np.uint8)
    zeros = np.zeros(n)
    data[0::2] = CODEC.encode("HUB_Front", {"acc_fl": zeros}, counter_start=200)
    data[1::2] = CODEC.encode("HUB_Rear", {"acc_rl": zeros})
    return FrameBatch(
        START_NS + np.arange(2 * n) * 500_000,
        np.tile(np.array([front.can_id, rear.can_id], np.uint32), n),
        np.zeros(2 * n, np.uint16),
        np.zeros(2 * n, np.uint8),
        np.full(2 * n, 6, np.uint8),
        data,
    )


def _health(frames: FrameBatch, size: int) -> HealthState:
    state = HealthState()
    for block in blocks(frames, size):
        state = advance(CODEC.messages, state, CODEC.decode(block))
    return state


@pytest.mark.parametrize("size", [1, 7, 200, 10_000])
def test_lost_frames_are_counted_whatever_the_blocks(size: int) -> None:
    frames = _frames(1500)
    lost = np.zeros(len(frames), bool)
    lost[[100, 101, 102, 777]] = True
    lost[1200:1400] = True
    state = _health(frames.select(~lost), size)
    assert state.losses == Losses(counter_gaps=204)
    assert state.counters["HUB_Front"].missing == 2 + 100
    assert state.counters["HUB_Rear"].missing == 2 + 100
    received = sum(counter.received for counter in state.counters.values())
    assert received == len(frames) - 204


@pytest.mark.parametrize("size", [1, 50, 10_000])
def test_garbled_frames_are_counted_once(size: int) -> None:
    frames = _frames(500)
    data = frames.data.copy()
    data[[0, 1, 300, 302, 304, 999], 0] ^= 0x10
    garbled = FrameBatch(frames.t_ns, frames.can_id, frames.flags, frames.bus, frames.length, data)
    assert _health(garbled, size).losses == Losses(crc_bad=6)
    lost = np.arange(len(frames)) == 306
    assert _health(garbled.select(~lost), size).losses == Losses(crc_bad=6, counter_gaps=1)


def test_what_is_not_decoded_is_counted_by_kind() -> None:
    frames = _frames(100)
    flags, ids, length = frames.flags.copy(), frames.can_id.copy(), frames.length.copy()
    flags[[0, 2]] = FrameFlag.ERROR
    flags[4] = FrameFlag.REMOTE
    ids[[1, 3, 5]] = 0x7AB
    length[195] = 2
    batch = FrameBatch(frames.t_ns, ids, flags, frames.bus, length, frames.data)
    found = _health(batch, 10).losses
    assert (found.error_frames, found.remote_frames, found.unknown_id) == (2, 1, 3)
    assert found.wrong_length == 1


def test_a_frame_of_wrong_length_with_a_bad_checksum_is_counted_once() -> None:
    wide = np.zeros((100, 64), np.uint8)
    wide[:, :12] = 0x7F  # HUB_Front has 6 bytes, as issued; FD frames of 12 with its identifier
    n = np.arange(100)
    fd = np.full(100, FrameFlag.FD, np.uint16)
    front = CODEC.message("HUB_Front").can_id
    bus, length = np.zeros(100, np.uint8), np.full(100, 12, np.uint8)
    batch = FrameBatch(n, np.full(100, front, np.uint32), fd, bus, length, wide)
    losses = _health(batch, 10).losses
    assert (losses.crc_bad, losses.wrong_length, losses.measured) == (0, 100, 100)
    assert losses.words == "100 frames unusable"


def test_a_restart_of_a_sensor_is_reported_and_not_taken_for_loss() -> None:
    first, second = _frames(300), _frames(300)
    later = FrameBatch(
        second.t_ns + 300_000_000,
        second.can_id,
        second.flags,
        second.bus,
        second.length,
        second.data,
    )
    state = _health(FrameBatch.concatenate([first, later]), 100)
    assert state.losses.counter_gaps == 0
    assert {name: c.restarts for name, c in state.counters.items()} == {
        "HUB_Front": 1,
        "HUB_Rear": 1,
    }


def test_losses_are_added_field_by_field() -> None:
    one, other = Losses(*range(1, 10)), Losses(*range(10, 100, 10))
    both = losses_added(one, other)
    assert both == Losses(11, 22, 33, 44, 55, 66, 77, 88, 99)
