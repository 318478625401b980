"""Databases of several buses: one identifier on two of them is two messages."""

from __future__ import annotations

from pathlib import Path

import cantools.database
import pytest

from dbc import InputError, load_codec, parse_codec, read_dbc, split_by_bus

from .foreign_texts import FRAME, REAR, TWO_BUSES, arxml, kcd, message
from .test_foreign_databases import frames


@pytest.mark.parametrize(("bus", "factor"), [("Front & é", 0.5), ("Rear", 0.25)])
def test_a_bus_of_a_file_has_its_own_messages(tmp_path: Path, bus: str, factor: float) -> None:
    path = tmp_path / "car.kcd"
    path.write_text(TWO_BUSES, "utf-8")
    codec = load_codec(f"{path}#{bus}")
    assert not codec.left_out
    payload = (1000).to_bytes(8, "little")
    own = codec.decode(frames(FRAME, payload)).samples["Hub.az"].value.tolist()
    assert own == [1000 * factor]
    database = cantools.database.can.Database(strict=False)
    database.add_kcd_string(TWO_BUSES)
    theirs = [m for m in database.messages if (m.bus_name, m.name) == (bus, "Hub")]
    assert [m.decode(payload) for m in theirs] == [{"az": own[0]}]
    assert len(codec.messages) == (2 if factor == 0.5 else 1)


def test_without_a_bus_the_shared_identifier_is_left_out_and_said_how_to_name_it() -> None:
    codec = parse_codec(TWO_BUSES, "car.kcd")
    assert [m.name for m in codec.messages] == ["Own"]
    assert len(codec.left_out) == 2
    assert "0x123" in codec.left_out[0].text
    assert "name car.kcd#Front & é" in codec.left_out[0].text
    assert "name car.kcd#Rear" in codec.left_out[1].text


def test_a_message_that_a_gateway_passes_on_is_one() -> None:
    passed = [f'<Bus name="{n}">{message("Hub", 0.5, producer=n)}</Bus>' for n in "12"]
    codec = parse_codec(kcd(*passed), "car.kcd")
    assert [m.name for m in codec.messages] == ["Hub"]
    assert not codec.left_out


def test_one_identifier_twice_on_one_bus_stays_unknown() -> None:
    bus = (
        f'<Bus name="Only">{message("Hub", 0.5)}{message("Other", 0.25)}{message("C", 1, 1)}</Bus>'
    )
    codec = parse_codec(kcd(bus), "car.kcd")
    assert [m.name for m in codec.messages] == ["C"]
    assert len(codec.left_out) == 2
    assert "#" not in codec.left_out[0].text


def test_the_texts_of_the_buses_by_name() -> None:
    parts = split_by_bus(TWO_BUSES, "car.kcd")
    assert list(parts) == ["Empty", "Front & é", "Rear"]
    assert parts["Rear"] == kcd(REAR)
    assert parts["Empty"] == kcd('<Bus name="Empty"/>')
    assert split_by_bus("VERSION ''", "a.dbc") == {}
    assert split_by_bus(TWO_BUSES[:-30], "a.kcd") == {}
    assert split_by_bus(TWO_BUSES.replace("<Network", "<!DOCTYPE x><Network", 1), "a.kcd") == {}


def test_the_clusters_of_an_arxml_are_its_buses() -> None:
    one = arxml()
    start, stop = one.index("<CAN-CLUSTER>"), one.index("</ELEMENTS>")
    cluster = one[start:stop]
    assert cluster.endswith("</CAN-CLUSTER>")
    text = one[:stop] + cluster.replace(">Bus<", "> Other <") + one[stop:]
    parts = split_by_bus(text, "a.xml")
    assert parts["Bus"] == one
    assert list(parts) == ["Bus", "Other"]
    assert [m.name for m in parse_codec(parts["Other"], "a.xml").messages] == ["Hub"]


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("a.kcd", TWO_BUSES, r"a\.kcd: has no bus Side .*Front"),
        ("a.dbc", "VERSION ''\n", r"a\.dbc: has no bus Side .*without #Side"),
    ],
)
def test_a_bus_that_is_not_there(tmp_path: Path, name: str, text: str, why: str) -> None:
    (tmp_path / name).write_text(text, "utf-8")
    with pytest.raises(InputError, match=why):
        read_dbc(tmp_path / f"{name}#Side")


def test_a_file_whose_own_name_has_the_mark(tmp_path: Path) -> None:
    (tmp_path / "pot#Rear").write_text("one", "utf-8")
    (tmp_path / "pot").write_text(TWO_BUSES, "utf-8")
    assert read_dbc(tmp_path / "pot#Rear") == "one"
