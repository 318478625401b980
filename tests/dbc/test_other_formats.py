"""Databases of other kinds than DBC: KCD, SYM and ARXML."""

from __future__ import annotations

from pathlib import Path
from time import process_time

import cantools.database
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc import InputError, load_codec, parse_codec, shipped_dbc

from .databases import FRAME, SYM_TEXT, TWO_BUSES, arxml, block, kcd, kcd_message, kcd_text

# KCD, SYM and ARXML against what they say; databases of several buses ---------------------------


@pytest.mark.parametrize("name", ["a.arxml", "a.xml", "a.dbc"])
def test_arxml_under_any_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(arxml())
    hub = load_codec(path).message("Hub")
    assert (hub.can_id, hub.is_extended, hub.length) == (FRAME, False, 8)
    assert hub.signal("az").unit == "m/s2"
    decoded = load_codec(path).decode(block([(0x3E8 << 4).to_bytes(8, "little")], FRAME))
    assert decoded["Hub.az"].value.tolist() == [490.0]


def test_sym_is_what_cantools_reads() -> None:
    codec = parse_codec(SYM_TEXT, "a.sym")
    theirs = cantools.database.can.Database(strict=False)
    theirs.add_sym_string(SYM_TEXT)
    payload = bytes([1, 0x23, 0x45, 0x67, 0x89, 0x40, 0x12, 0x45])
    for each in theirs.messages:
        decoded = codec.decode(block([payload], each.frame_id, each.is_extended_frame))
        values = each.decode(payload, decode_choices=False)
        ours = {name.partition(".")[2]: s.value.tolist() for name, s in decoded.samples.items()}
        assert {name: value[0] for name, value in ours.items() if value} == values
    assert codec.message("Pots").cycle_s == 0.01
    assert [s.sentinels for m in codec.messages for s in m.signals if s.name == "Mode"] == [(255,)]


def test_signals_of_one_name_have_the_value_of_their_selector() -> None:
    codec = parse_codec(kcd_text("Low"), "a.kcd")
    assert [s.name for s in codec.message("Limits").signals] == ["Which", "Low_m3", "Low_m4"]
    decoded = codec.decode(block([bytes([3, 10, 0, 0]), bytes([4, 0, 7, 0])], FRAME))
    assert decoded["Limits.Low_m3"].value.tolist() == [1.0]
    assert decoded["Limits.Low_m4"].value.tolist() == [7.0]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.arxml", arxml()[:-60], "not a valid ARXML"),
        ("a.arxml", arxml(100_000_000), r"a.arxml:\d+: .* lies outside any payload"),
        ("a.arxml", "<!DOCTYPE x [<!ENTITY a 'b'>]>" + arxml(), "ENTITY"),
        ("a.arxml", "no XML at all", "not a valid ARXML"),
        ("a.cdd", "<?xml version='1.0'?>\n<CANDELA dtdvers='5'></CANDELA>", "diagnostic"),
        ("a.kcd", TWO_BUSES.replace('length="16"', 'length="999999999"'), "outside any payload"),
        ("a.kcd", TWO_BUSES[:-30], "not a valid KCD"),
        ("a.kcd", kcd('<Bus name="Empty"/>'), "no messages"),
        ("a.sym", SYM_TEXT.replace("unsigned 12", "unsigned 999999999"), "outside any payload"),
        ("a.sym", SYM_TEXT.replace("00000023h", "1FFFFFFFh"), "more than 2,000 identifiers"),
        ("a.sym", "FormatVersion=5.0\n", "not a valid SYM"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(name: str, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        parse_codec(text, name)
    assert str(caught.value).isprintable()


def test_an_identifier_of_two_buses_is_left_out_unless_both_mean_the_same() -> None:
    codec = parse_codec(TWO_BUSES, "car.kcd")
    assert [m.name for m in codec.messages] == ["Own"]
    assert ["of another" in each.text for each in codec.left_out] == [True, True]
    passed = [f'<Bus name="{n}">{kcd_message("Hub", 0.5, producer=n)}</Bus>' for n in "12"]
    gateway = parse_codec(kcd(*passed), "car.kcd")
    assert [m.name for m in gateway.messages] == ["Hub"]
    hubs = kcd_message("Hub", 0.5) + kcd_message("Other", 1)
    twice = f'<Bus name="B">{hubs}{kcd_message("C", 1, 1)}</Bus>'
    assert [m.name for m in parse_codec(kcd(twice), "car.kcd").messages] == ["C"]


# Databases with random faults: each is read, repaired or refused in one line --------------------

TEXTS = {"dbc": shipped_dbc(), "kcd": TWO_BUSES, "sym": SYM_TEXT, "arxml": arxml()}
PIECES = (
    '"',
    ";",
    "\n",
    "BO_ ",
    " SG_ ",
    "VAL_ ",
    "SG_MUL_VAL_ ",
    "-",
    "99999",
    "ü",
    "<",
    ">",
)


def outcome(rng: np.random.Generator, kind: str) -> str:
    """Return what becomes of a text with one to four faults: read, repaired or refused."""
    text = TEXTS[kind]
    for _ in range(rng.integers(1, 5)):
        at, width = int(rng.integers(len(text) + 1)), int(rng.integers(1, 40))
        piece = PIECES[rng.integers(len(PIECES))]
        change = rng.integers(4)
        if change == 0:  # cut off
            text = text[: max(at, 1)]
        elif change == 1:  # a part is lost
            text = text[:at] + text[at + width :]
        elif change == 2:  # a part comes twice
            text = text[: at + width] + text[at:]
        else:
            text = text[:at] + piece + text[at + (width % 2) :]
    try:
        codec = parse_codec(text, f"x.{kind}")
    except InputError as error:
        return "refused" if str(error).isprintable() else "garbled"
    return "repaired" if codec.left_out or codec.notes else "read"


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(st.integers(0, 1 << 32), st.sampled_from(["dbc", "kcd", "sym", "arxml"]))
def test_a_changed_database_is_read_or_refused_and_nothing_else(seed: int, kind: str) -> None:
    assert outcome(np.random.default_rng(seed), kind) in ("read", "repaired", "refused")


@pytest.mark.long
@pytest.mark.parametrize("kind", TEXTS)
def test_thousands_of_changed_databases_hold_up_nobody(kind: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(1250):
        began_s = process_time()
        assert outcome(rng, kind) != "garbled"
        assert process_time() - began_s < 30.0
