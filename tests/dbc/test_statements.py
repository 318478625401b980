"""Statements about statements: what two lines say of one signal, long names, rare faults."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dbc import FrameBatch, InputError, parse_codec
from dbc.reader import document
from dbc.reader.document import joined
from dbc.reader.foreign_numbers import check_numbers
from dbc.witness.second_reader import Witness, WitnessReport

HEAD = (
    'VERSION ""\n\nBU_: A B\n\nBO_ 100 M: 8 A\n SG_ top M : 0|8@1+ (1,0) [0|0] "" B\n'
    ' SG_ own m1 : 8|8@1+ (1,0) [0|0] "" B\n SG_ plain : 16|32@1- (1,0) [0|0] "" B\n\n'
)


def left_out(tail: str) -> list[str]:
    try:
        codec = parse_codec(HEAD + tail, "x.dbc")
    except InputError as error:
        return [str(error)]
    return [f"{each.subject}: {each.text}" for each in codec.left_out]


@pytest.mark.parametrize(
    ("tail", "why"),
    [
        ("SG_MUL_VAL_ 100 own top 1-1;\n", ""),
        ("SG_MUL_VAL_ 100 own top 1-1;\nSG_MUL_VAL_ 100 own top 1-1;\n", ""),
        ("SG_MUL_VAL_ 100 own top 1-1;\nSG_MUL_VAL_ 100 own top 1-2;\n", "SG_MUL_VAL_"),
        ("SG_MUL_VAL_ 100 own top 0-2;\n", ""),
        ("SG_MUL_VAL_ 100 own top 2-3;\n", "is marked m1"),
        ("SG_MUL_VAL_ 100 own top 0-0, 2-9;\n", "is marked m1"),
        ("SG_MUL_VAL_ 100 plain top 1-1;\n", "no mark of a multiplexed signal"),
        ("SIG_VALTYPE_ 100 plain : 1;\n", ""),
        ("SIG_VALTYPE_ 100 plain : 1;\nSIG_VALTYPE_ 100 plain : 1;\n", ""),
        ("SIG_VALTYPE_ 100 plain : 1;\nSIG_VALTYPE_ 100 plain : 0;\n", "SIG_VALTYPE_"),
    ],
)
def test_two_lines_of_a_signal_may_not_contradict_each_other_or_its_mark(
    tail: str, why: str
) -> None:
    found = left_out(tail)
    assert bool(found) is bool(why)
    assert why in "".join(found)


@pytest.mark.parametrize(
    ("pairs", "expected"),
    [
        ([], ()),
        ([(3, 2)], ()),
        ([(1, 1)], ((1, 1),)),
        ([(5, 9), (1, 3)], ((1, 3), (5, 9))),
        ([(1, 3), (4, 9)], ((1, 9),)),
        ([(1, 3), (5, 9)], ((1, 3), (5, 9))),
        ([(1, 9), (2, 4)], ((1, 9),)),
        ([(1, 4), (2, 9), (9, 12), (14, 14)], ((1, 12), (14, 14))),
    ],
)
def test_ranges_that_meet_are_one(
    pairs: list[tuple[int, int]], expected: tuple[tuple[int, int], ...]
) -> None:
    assert joined(pairs) == expected


def test_ranges_of_a_selector_are_where_the_signal_is() -> None:
    codec = parse_codec(HEAD + "SG_MUL_VAL_ 100 own top 5-9, 1-3, 4-4;\n", "x.dbc")
    assert codec.message("M").signal("own").selected_by == ((1, 9),)
    assert parse_codec(HEAD, "x.dbc").message("M").signal("own").selected_by == ((1, 1),)


def test_names_that_were_cut_are_whole_again() -> None:
    long = (
        'BA_ "SystemNodeLongSymbol" BU_ A "A_node_of_a_name_that_is_too_long_for_a_dbc";\n'
        'BA_ "SystemMessageLongSymbol" BO_ 100 "A_message_of_such_a_name";\n'
        'BA_ "SystemSignalLongSymbol" SG_ 100 plain "A_signal_of_such_a_name";\n'
        'BA_ "Other" 5;\n'
    )
    (message,) = parse_codec(HEAD + long, "x.dbc").messages
    assert message.senders == ("A_node_of_a_name_that_is_too_long_for_a_dbc",)
    assert message.name == "A_message_of_such_a_name"
    assert [s.name for s in message.signals] == ["top", "own", "A_signal_of_such_a_name"]


def test_a_text_has_so_many_messages_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(document, "MAX_MESSAGES", 3)
    more = "".join(
        f'BO_ {200 + n} N{n}: 8 A\n SG_ s : 0|8@1+ (1,0) [0|0] "" B\n\n' for n in range(3)
    )
    assert len(parse_codec(HEAD + more[: more.index("BO_ 202")], "x.dbc").messages) == 3
    with pytest.raises(InputError, match=r"x\.dbc:16: more than 3 messages"):
        parse_codec(HEAD + more, "x.dbc")


def columns(**changed: Any) -> FrameBatch:
    given: dict[str, Any] = {
        "t_ns": np.zeros(2, np.int64),
        "can_id": np.zeros(2, np.uint32),
        "flags": np.zeros(2, np.uint16),
        "bus": np.zeros(2, np.uint8),
        "length": np.zeros(2, np.uint8),
        "data": np.zeros((2, 8), np.uint8),
        **changed,
    }
    return FrameBatch(**given)


@pytest.mark.parametrize("name", ["can_id", "flags", "bus", "length"])
@pytest.mark.parametrize("shape", [(1,), (3,), (2, 1), ()])
def test_a_column_of_a_block_has_one_number_a_frame(name: str, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=name):
        columns(**{name: np.zeros(shape, np.uint8)})


@pytest.mark.parametrize("shape", [(2,), (1, 8), (3, 8), (2, 7), (2, 9), (2, 63), (2, 8, 1)])
def test_a_payload_has_eight_or_sixty_four_bytes(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="data"):
        columns(data=np.zeros(shape, np.uint8))
    assert columns(data=np.zeros((2, 64), np.uint8)).data.shape == (2, 64)


def test_the_columns_of_a_block_have_their_types_and_cannot_be_written() -> None:
    batch = columns(can_id=np.array([1, 2], np.int64), bus=np.array([3, 4], np.int64))
    assert batch.can_id.dtype == np.dtype(np.uint32)
    assert batch.bus.dtype == np.dtype(np.uint8)
    for name in ("t_ns", "can_id", "flags", "bus", "length", "data"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(batch, name)[0] = 1


SYM = 'FormatVersion=6.0 // x\nTitle="t"\n\n{{SENDRECEIVE}}\n\n[M]\nID={}\nLen=8\n'


@pytest.mark.parametrize(
    ("identifiers", "line"),
    [
        ("000h-7D0h", 0),
        ("000h-7D1h", 7),
        ("7D1h-000h", 0),
        ("xyzh-100h", 0),  # the reader refuses it
        ("xyzh-100h\nID=000h-7D1h", 8),
        ("000h-3E8h\nID=000h-3E8h", 0),
        ("000h-3E8h\nID=000h-3E9h", 8),
    ],
)
def test_the_ranges_of_a_sym_have_2000_identifiers_together(identifiers: str, line: int) -> None:
    text = SYM.format(identifiers)
    if line:
        with pytest.raises(InputError, match=rf"x\.sym:{line}: more than 2000 identifiers"):
            check_numbers(text, "x.sym", "sym")
    else:
        check_numbers(text, "x.sym", "sym")


class Child:
    """A process that ends as the test says."""

    returncode = 0
    late = False

    def communicate(self, timeout: float | None = None) -> tuple[str, None]:
        if self.late and timeout is not None:
            raise subprocess.TimeoutExpired("x", timeout)
        return "", None

    def kill(self) -> None:
        """Do nothing."""


@pytest.mark.parametrize(
    ("code", "late", "why"),
    [(0, True, "no answer for 60 s"), (-9, False, "it takes more than 20 s"),
     (1, False, "it stops with an error")],
)  # fmt: skip
def test_why_cantools_says_nothing(
    monkeypatch: pytest.MonkeyPatch, code: int, late: bool, why: str
) -> None:
    child = Child()
    child.returncode, child.late = code, late
    monkeypatch.setattr("dbc.witness.second_reader.subprocess.Popen", lambda *_, **__: child)
    with Witness(HEAD, "x.dbc", parse_codec(HEAD, "x.dbc"), ["M"]) as witness:
        assert witness.report() == WitnessReport((), why)


def test_a_machine_that_starts_no_process_has_no_second_reader(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    with Witness(HEAD, "x.dbc", parse_codec(HEAD, "x.dbc"), ["M"]) as witness:
        report = witness.report()
    assert report == replace(WitnessReport((), ""), refusal=report.refusal)
    assert report.refusal.startswith("no process for it (No such file")
