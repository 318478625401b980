"""A database of several buses becomes a sensor for each, on the bus where its messages come."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import bench_codec, load_bench
from daq.bench.databases import Database, each_bus, stored_text
from daq.check.find_sensors import find_sensors, traffic_of
from dbc import FrameBatch

from ...dbc.foreign_texts import FRONT, REAR, kcd, message

CAR = kcd(FRONT, REAR.replace("</Bus>", message("Far", 1.0, 0x300) + "</Bus>"))
DATABASES = each_bus(Database("car.kcd", CAR))


def traffic(*sent: tuple[int, int]) -> FrameBatch:
    """Return 20 frames of each bus and identifier, 10 ms apart, with a count as payload."""
    n = 20 * len(sent)
    number: np.ndarray = np.arange(n)
    data = np.zeros((n, 8), np.uint8)
    data[:, 0] = number // len(sent)
    bus, can_id = (np.array(column)[number % len(sent)] for column in zip(*sent, strict=True))
    length = np.full(n, 8, np.uint8)
    stamps = number * 10_000_000 // len(sent)
    flags = np.zeros(n, np.uint16)
    return FrameBatch(stamps, can_id.astype(np.uint32), flags, bus.astype(np.uint8), length, data)


def test_each_bus_of_a_file_is_a_database() -> None:
    assert [each.name for each in DATABASES] == ["car.kcd#Front & é", "car.kcd#Rear"]
    plain = Database("one.kcd", kcd(REAR))
    assert each_bus(plain) == (plain,)


@pytest.mark.parametrize(
    ("sent", "expected", "absent"),
    [
        (
            ((0, 0x123), (0, 0x300), (1, 0x123), (1, 0x200)),
            {("front", 1, True), ("rear", 0, True)},
            (),
        ),
        (((0, 0x123), (0, 0x200)), {("front", 0, True)}, ("car.kcd#Rear",)),
        (
            ((0, 0x123), (1, 0x123), (1, 0x200)),  # what the one is not, the other is
            {("front", 1, True), ("rear", 0, True)},
            (),
        ),
        (((1, 0x123),), {("front", 1, False), ("rear", 1, False)}, ()),  # may be either
        ((), {("front", 0, True), ("rear", 1, True)}, ()),
    ],
)
def test_the_bus_of_a_file_is_where_most_of_its_messages_come(
    sent: tuple[tuple[int, int], ...],
    expected: set[tuple[str, int, bool]],
    absent: tuple[str, ...],
) -> None:
    found, missing = find_sensors(DATABASES, traffic_of(traffic(*sent)) if sent else None)
    named = {(f.sensor.name.partition("_")[0], f.sensor.bus, f.surely) for f in found}
    assert (named, missing) == (expected, absent)


def test_databases_whose_own_names_have_the_mark_are_no_rivals() -> None:
    pots = [
        Database(f"pot#{n}.kcd", kcd(f'<Bus name="B">{message("M", 1.0, n)}</Bus>')) for n in (1, 2)
    ]
    found, _ = find_sensors(pots, traffic_of(traffic((0, 1), (0, 2))))
    assert [f.surely for f in found] == [True, True]


def test_a_bench_decodes_one_identifier_by_the_bus_of_its_file(tmp_path: Path) -> None:
    (tmp_path / "car.kcd").write_text(CAR, "utf-8")
    (tmp_path / "bench.toml").write_text(
        '[[bus]]\ninterface = "virtual"\nchannel = "a"\n'
        '[[bus]]\ninterface = "virtual"\nchannel = "b"\n'
        '[[sensor]]\nname = "rear"\ndbc = "car.kcd#Rear"\nbus = 0\n'
        '[[sensor]]\nname = "front"\ndbc = "car.kcd#Front & é"\nbus = 1\n'
        '[[channel]]\nname = "x"\nsignal = "rear.Hub.az"\nquantity = "unused"\n'
        '[[channel]]\nname = "y"\nsignal = "front.Hub.az"\nquantity = "unused"\n',
        "utf-8",
    )
    bench = load_bench(tmp_path / "bench.toml")
    assert bench.dbc_text == stored_text(DATABASES[::-1])
    codec = bench_codec(bench)
    assert not codec.left_out
    decoded = codec.decode(traffic((0, 0x123), (1, 0x123))).samples
    assert decoded["rear.Hub.az"].value.tolist() == [0.25 * k for k in range(20)]
    assert decoded["front.Hub.az"].value.tolist() == [0.5 * k for k in range(20)]
