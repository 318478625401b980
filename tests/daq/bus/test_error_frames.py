"""The numbers are those of linux/can/error.h."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.bus.error_frames import ControllerState, ErrorClass, describe_error_frame
from daq.bus.source import wire_bits
from dbc import FrameBatch, FrameFlag

ERROR_FLAG = 0x20000000


def of(can_id: int, data: str = "") -> tuple[ControllerState | None, str]:
    said = describe_error_frame(can_id, bytes.fromhex(data))
    return said.state, said.text


@pytest.mark.parametrize(
    ("can_id", "bit", "text"),
    [
        (0x001, ErrorClass.TX_TIMEOUT, "sending timed out"),
        (0x002, ErrorClass.LOST_ARBITRATION, "arbitration lost"),
        (0x004, ErrorClass.CONTROLLER, "controller"),
        (0x008, ErrorClass.PROTOCOL, "protocol violated"),
        (0x010, ErrorClass.TRANSCEIVER, "transceiver"),
        (0x020, ErrorClass.NO_ACK, "no node acknowledges"),
        (0x040, ErrorClass.BUS_OFF, "bus-off"),
        (0x080, ErrorClass.BUS_ERROR, "bus error"),
        (0x100, ErrorClass.RESTARTED, "controller restarted"),
    ],
)
def test_each_class_has_its_bit_and_its_word(can_id: int, bit: ErrorClass, text: str) -> None:
    for flagged in (can_id, can_id | ERROR_FLAG):
        said = describe_error_frame(flagged, bytes(8))
        assert said.classes == bit
        assert said.text == text
        assert (said.tx_errors, said.rx_errors, said.overrun) == (None, None, False)


@pytest.mark.parametrize(
    ("data_1", "state", "overrun", "text"),
    [
        (0x00, None, False, "controller"),
        (0x01, None, True, "receive buffer overflow"),
        (0x02, None, False, "transmit buffer overflow"),
        (0x04, ControllerState.WARNING, False, "many receive errors"),
        (0x08, ControllerState.WARNING, False, "many transmit errors"),
        (0x10, ControllerState.PASSIVE, False, "passive by receive errors"),
        (0x20, ControllerState.PASSIVE, False, "passive by transmit errors"),
        (0x40, ControllerState.ACTIVE, False, "error-active again"),
        (0x3C, ControllerState.PASSIVE, False, "passive by transmit errors"),
        (0x0D, ControllerState.WARNING, True, "receive buffer overflow"),
    ],
)
def test_the_controller_byte_shows_state_and_overrun(
    data_1: int, state: ControllerState | None, overrun: bool, text: str
) -> None:
    said = describe_error_frame(0x004, bytes([0, data_1, 0, 0, 0, 0, 0, 0]))
    assert said.state is state
    assert said.overrun is overrun
    assert text in said.text


@pytest.mark.parametrize(
    ("tx", "rx", "state"),
    [
        (0, 0, ControllerState.ACTIVE),
        (95, 95, ControllerState.ACTIVE),
        (96, 0, ControllerState.WARNING),
        (0, 127, ControllerState.WARNING),
        (128, 0, ControllerState.PASSIVE),
        (0, 255, ControllerState.PASSIVE),
    ],
)
def test_counters_are_read_where_the_frame_says_so_and_show_the_state(
    tx: int, rx: int, state: ControllerState
) -> None:
    said = describe_error_frame(0x200, bytes([0, 0, 0, 0, 0, 0, tx, rx]))
    assert (said.tx_errors, said.rx_errors, said.state) == (tx, rx, state)
    assert said.text == f"{tx} transmit and {rx} receive errors counted"


def test_bus_off_is_bus_off_whatever_the_counters_say() -> None:
    assert of(0x240, "0000000000000000")[0] is ControllerState.BUS_OFF
    assert of(0x044, "0010000000000000")[0] is ControllerState.BUS_OFF
    assert of(0x100)[0] is ControllerState.ACTIVE


@pytest.mark.parametrize(
    ("can_id", "data", "text"),
    [
        (0x088, "0000041A", "protocol violated (bit stuffing), bus error"),
        (0x008, "00008819", "protocol violated (dominant bit not sent, while sending)"),
        (0x028, "00000019", "protocol violated, no node acknowledges"),
        (0x000, "", "unknown error"),
        (0x400, "", "unknown error"),
    ],
)
def test_details_are_given_in_words(can_id: int, data: str, text: str) -> None:
    assert of(can_id, data)[1].startswith(text)


# The time of a frame on the wire, in bits counted by hand -----------------------------------------

FD = FrameFlag.FD
FAST = FrameFlag.FD | FrameFlag.BITRATE_SWITCH


@pytest.mark.parametrize(
    ("flags", "length", "bits"),
    [
        (0, 0, 47),
        (0, 8, 47 + 64),
        (FrameFlag.EXTENDED, 8, 67 + 64),
        (FD, 64, 47 + 512),
        (FAST, 64, 47 + 128),  # its data four times as fast
        (FAST | FrameFlag.EXTENDED, 12, 67 + 24),
    ],
)
def test_bits_of_a_frame_with_one_stuff_bit_in_thirty(flags: int, length: int, bits: int) -> None:
    one = np.ones(2, np.uint8)
    frames = FrameBatch(
        np.arange(2), one.astype(np.uint32), np.array([flags, 0], np.uint16), 0 * one,
        np.array([length, 8], np.uint8), np.zeros((2, 64), np.uint8),
    )  # fmt: skip
    assert wire_bits(frames) == pytest.approx([bits * 31 / 30, 111 * 31 / 30])


def test_the_controller_byte_means_nothing_in_frames_of_other_classes() -> None:
    said = describe_error_frame(0x080, bytes.fromhex("0021000000000000"))
    assert said.state is None
    assert not said.overrun


def test_older_drivers_send_counters_with_a_change_of_state_and_no_class_for_them() -> None:
    said = describe_error_frame(0x004, bytes.fromhex("0008000000006000"))
    assert (said.tx_errors, said.rx_errors) == (0x60, 0)
    assert said.state is ControllerState.WARNING
    # data[6..7] of a bus error belong to the driver
    assert describe_error_frame(0x088, bytes.fromhex("0000000000000102")).tx_errors is None


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 0xFFFFFFFF), st.binary(max_size=64))
def test_whatever_comes_is_one_printable_line(can_id: int, data: bytes) -> None:
    said = describe_error_frame(can_id, data)
    assert said.text
    assert said.text.isprintable()


@pytest.mark.parametrize(
    ("bit", "violation"),
    [
        (0x01, "single bit"), (0x02, "frame format"), (0x04, "bit stuffing"),
        (0x08, "dominant bit not sent"), (0x10, "recessive bit not sent"), (0x20, "overload"),
        (0x40, "active error flag"), (0x80, "while sending"),
    ],
)  # fmt: skip
def test_each_violation_has_its_bit(bit: int, violation: str) -> None:
    """CAN_ERR_PROT_*, data[2]."""
    assert of(0x008, f"0000{bit:02x}")[1] == f"protocol violated ({violation})"
