"""One bad message costs that message and no other, and no other is read wrongly."""

from __future__ import annotations

from pathlib import Path

import pytest

from dbc import Codec, InputError, load_codec, parse_codec

from .frames import block

HEAD = 'VERSION ""\n\nNS_ :\n\tCM_\n\tVAL_\n\nBS_:\n\nBU_: A B\n\n'
M = 'BO_ 256 M: 8 A\n SG_ s : 0|16@1- (0.5,0) [0|0] "g" B\n SG_ t : 16|8@1+ (1,0) [0|0] "" A,B\n\n'
N = 'BO_ 257 N: 8 A\n SG_ s : 0|8@1+ (1,0) [0|0] "" B\n\n'
BAD_LINES = {
    "syntax": ' SG_ s : 0|16@1- (0.5;0) [0|0] "g" B\n',
    "factor 0": ' SG_ s : 0|16@1- (0,0) [0|0] "g" B\n',
    "too long": ' SG_ s : 0|1000000@1- (1,0) [0|0] "g" B\n',
    "outside": ' SG_ s : 60|16@1- (1,0) [0|0] "g" B\n',
    "twice": ' SG_ s : 0|8@1- (1,0) [0|0] "g" B\n' * 2,
    "no selector": ' SG_ s m1 : 0|8@1- (1,0) [0|0] "g" B\n',
    "mark without a value": ' SG_ s m : 0|8@1- (1,0) [0|0] "g" B\n',
    "garbage": " !! \n",
}


def left_out(codec: Codec) -> list[tuple[str, str]]:
    """Return where and what was left out."""
    return [(remark.where, remark.subject) for remark in codec.left_out]


@pytest.mark.parametrize("case", BAD_LINES)
def test_a_bad_message_is_left_out_with_its_line_and_the_rest_is_loaded(case: str) -> None:
    text = HEAD + M + "BO_ 300 Bad: 8 A\n" + BAD_LINES[case] + "\n" + N
    codec = parse_codec(text, "x.dbc")
    assert [message.name for message in codec.messages] == ["M", "N"]
    ((where, name),) = left_out(codec)
    line = text.split("\n")[int(where.removeprefix("x.dbc:")) - 1]
    assert line.strip() in BAD_LINES[case]
    assert "Bad" in name
    assert str(codec.left_out[0]).isprintable()


@pytest.mark.parametrize(
    "tail",
    [
        "SIG_VALTYPE_ 256 s ; 1;\n",
        "SIG_VALTYPE_ 256 q : 1;\n",
        "SIG_VLTYPE_ 256 s : 1;\n",
        "SG_MUL_VAL_ 256 s u 1-1;\n",
        "SG_MUL_VAL_ 256 s u 1;\n",
        'VAL_ 256 s 1.5 "error" ;\n',
        'VAL_ 256 s 1 "a "quoted" word";\n',
        "SIG_VALTYPE_ 256 t : 1;\nSIG_VALTYPE_ 256 t : 0;\n",
    ],
)
def test_what_is_not_understood_outside_a_message_takes_it_with_it(tail: str) -> None:
    codec = parse_codec(HEAD + M + N + tail, "x.dbc")
    assert [message.name for message in codec.messages] == ["N"]
    assert "M" in codec.left_out[0].subject
    line = int(codec.left_out[0].where.removeprefix("x.dbc:"))
    assert line in (12, 18, 19)  # the line at fault, or that of the signal that it contradicts


def test_a_mangled_head_does_not_give_its_signals_to_the_message_before() -> None:
    for head in ("BO 257 N: 8 A\n", "BO_ 257 N 8 A\n", "BO_ x N: 8 A\n", "XO_ 257 N: 8 A\n"):
        codec = parse_codec(HEAD + N.replace("257 N", "9 K") + "\n" + M.replace(M[:15], head), "x")
        for message in codec.messages:
            assert message.name == "K"
            assert [signal.name for signal in message.signals] == ["s"]


def test_a_stray_word_within_a_message_does_not_take_its_signals_unsaid() -> None:
    codec = parse_codec(HEAD + N + M.replace(' "g" B', ' "g"\n\nB'), "x.dbc")
    assert [message.name for message in codec.messages] == ["N"]


def test_a_comment_that_is_not_closed_costs_itself_only() -> None:
    text = HEAD + M + N + 'CM_ BO_ 256 "no end;\nVAL_ 257 s 255 "invalid";\nCM_ "fine";\n'
    codec = parse_codec(text, "x.dbc")
    assert codec.message("N").signal("s").sentinels == (255,)
    assert any(remark.where == "x.dbc:18" for remark in codec.notes)


def test_a_text_that_is_cut_off_is_refused_as_a_whole() -> None:
    text = HEAD + M + N + "SIG_VALTYPE_ 256 s : 1;\n"
    for stop in (-4, -9, -15, -20):
        with pytest.raises(InputError, match="ends within a definition"):
            parse_codec(text[:stop], "x.dbc")


def test_messages_of_one_identifier_are_both_left_out() -> None:
    twin = parse_codec(HEAD + M + N + M.replace(" M:", " M2:"), "x.dbc")
    assert [message.name for message in twin.messages] == ["N"]
    assert sorted(name for _, name in left_out(twin)) == ["message M", "message M2"]


def test_messages_of_one_name_are_kept_under_names_that_tell_them_apart() -> None:
    far = M.replace("256", str((1 << 31) + 0x1FFFF))
    codec = parse_codec(HEAD + M + N + M.replace("256", "258") + far, "x.dbc")
    names = [message.name for message in codec.messages]
    assert names == ["M_0x100", "N", "M_0x102", "M_0x1FFFF"]
    assert not codec.left_out
    assert str(codec.notes[0]) == (
        "x.dbc:11: message M has the name of another message: it is M_0x100 here"
    )
    decoded = codec.decode(block([b"\2\0\7\0\0\0\0\0", b"\4\0\7\0\0\0\0\0"], [256, 258]))
    assert decoded["M_0x100.s"].value.tolist() == [1.0]
    assert decoded["M_0x102.s"].value.tolist() == [2.0]
    twice = M.replace("256", str((1 << 31) + 256))  # the same number with 29 bits
    both = parse_codec(HEAD + M + twice, "x.dbc")
    assert [message.name for message in both.messages] == ["M_0x100", "M_0x100x"]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (' SG_ s : 0|16@1- (0.5,0) [0|0] "g" B\n', None),
        (' SG_ s : 0|65@1- (0.5,0) [0|0] "g" B\n', "M.s has 65 bits, not 1 to 64"),
        (' SG_ s : 0|64@1- (0.5,0) [0|0] "g" B\n', None),
        (' SG_ s : 56|9@1- (0.5,0) [0|0] "g" B\n', "M.s ends in byte 9 of a message of 8"),
        (' SG_ s : 56|8@1- (0.5,0) [0|0] "g" B\n', None),
        (' SG_ s : 0|16@1- (0,0) [0|0] "g" B\n', "M.s has the factor 0"),
    ],
)
def test_a_signal_that_cannot_be_decoded_costs_itself_and_not_its_message(
    line: str, reason: str | None
) -> None:
    text = HEAD + M.replace(' SG_ s : 0|16@1- (0.5,0) [0|0] "g" B\n', line)
    codec = parse_codec(text, "x.dbc")
    (message,) = codec.messages
    assert {s.name for s in message.signals} == ({"t"} if reason else {"s", "t"})
    assert [remark.subject for remark in codec.left_out] == (["M.s"] if reason else [])
    if reason:
        assert reason in codec.left_out[0].text
        assert codec.left_out[0].where == "x.dbc:12"
    decoded = codec.decode(block([b"\2\0\7\0\0\0\0\0"], 256))
    assert decoded["M.t"].value.tolist() == [7.0]


def test_what_a_lost_selector_selects_is_left_out_with_it() -> None:
    bad = ' SG_ sel M : 56|16@1+ (1,0) [0|0] "" B\n SG_ a m1 : 0|8@1+ (1,0) [0|0] "" B\n'
    codec = parse_codec(HEAD + M.rstrip("\n") + "\n" + bad, "x.dbc")
    assert [s.name for s in codec.message("M").signals] == ["s", "t"]
    assert [r.text for r in codec.left_out] == [
        "M.sel ends in byte 9 of a message of 8",
        "M.a has the selector sel, which is left out",
    ]


def test_a_message_whose_counter_cannot_be_read_is_left_out_whole() -> None:
    counted = (
        M.replace("16|8@1+", "60|8@1+")
        + 'BA_DEF_ SG_ "SignalRole" STRING ;\nBA_DEF_DEF_ "SignalRole" "value";\n'
        + 'BA_ "SignalRole" SG_ 256 t "counter";\n'
    )
    codec = parse_codec(HEAD + N + counted, "x.dbc")
    assert [message.name for message in codec.messages] == ["N"]
    assert [remark.subject for remark in codec.left_out] == ["M.t"]


def test_overlapping_signals_load_and_are_noted() -> None:
    text = (
        HEAD
        + N
        + (
            'BO_ 5 O: 8 A\n SG_ all : 0|64@1+ (1,0) [0|0] "" B\n'
            ' SG_ low : 0|8@1+ (1,0) [0|0] "" B\n'
            'BO_ 6 P: 8 A\n SG_ top M : 0|8@1+ (1,0) [0|0] "" B\n'
            ' SG_ a m0 : 15|8@0+ (1,0) [0|0] "" B\n SG_ b m1 : 8|8@1+ (1,0) [0|0] "" B\n'
        )
    )
    codec = parse_codec(text, "x.dbc")
    assert [str(note) for note in codec.notes] == ["x.dbc:16: O.low overlaps all"]
    decoded = codec.decode(block([b"\x01\x02\0\0\0\0\0\0"], 5))
    assert decoded["O.all"].value.tolist() == [513]
    assert decoded["O.low"].value.tolist() == [1]


def test_quirks_of_public_files_that_say_what_they_mean_are_read() -> None:
    text = (
        'VERSION "a \\"b\\""\nBS_: 500 : 1,2\nBU_:\n'
        'BO_ 100 2017_5: 3 Vector__XXX // a comment with " in it\n'
        ' SG_ 64_BIT m0 : 0|8@1+(.25,-1)[0|0]"x//y" Vector__XXX\n'
        ' SG_ sel M:8|8@1+ (1E0,+0) [0|0] ""  A,\n  B\n'
        ' SG_ bare : 23|8@0- (-1,0) [0|0] ""\n'
        'CM_ "no semicolon"\nCM_ SG_ 100 "no name";\nVAL_ 100 bare 1 "one"\n'
        'VAL_ 7 absent 1 "no such message" ;\nEV_ e: 0 [0|1] "" 0 1 DUMMY_NODE_VECTOR0 A;\n'
        'SIG_GROUP_ 100 g 1 : sel bare;\nBA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;\n'
        'BA_DEF_DEF_ "GenMsgCycleTime" 20;\nBA_REL_ "r" BU_SG_REL_ A SG_ 100 sel 1;\n'
        'BA_ "SystemSignalLongSymbol" SG_ 100 sel "selector";\nVAL_ 100 sel 1 "no end of line"\n'
    )
    codec = parse_codec(text, "x.dbc")
    assert (codec.left_out, codec.notes) == ((), ())
    message = codec.message("2017_5")
    assert message.cycle_s == 0.02
    multiplexed = message.signal("64_BIT")
    assert (multiplexed.selector, multiplexed.unit, multiplexed.factor) == (
        "selector",
        "x//y",
        0.25,
    )
    bare = message.signal("bare")
    assert (bare.start, bare.length, bare.is_signed, bare.is_big_endian) == (23, 8, True, True)


KCD = (
    '<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0"><Document/><Bus name="b">'
    '<Message id="0x10" name="K" length="2"><Signal name="s" offset="4" length="12" '
    'endianess="little"><Value slope="0.5" intercept="-1" unit="g"/></Signal></Message></Bus>'
    "</NetworkDefinition>"
)
SYM = (
    'FormatVersion=6.0 // Do not edit this line!\nTitle="t"\n\n{ENUMS}\n'
    'Enum=State(0="fine", 4095="invalid")\n\n{SEND}\n\n[K]\nID=010h\nLen=2\n'
    "Var=s unsigned 4,12 /u:g /f:0.5 /o:-1 /e:State\n"
)


@pytest.mark.parametrize(("suffix", "text"), [("kcd", KCD), ("sym", SYM), ("SYM", SYM)])
def test_kcd_and_sym_are_known_by_their_suffix(tmp_path: Path, suffix: str, text: str) -> None:
    path = tmp_path / f"x.{suffix}"
    path.write_text(text)
    decoded = load_codec(path).decode(block([b"\x50\x01", b"\xff\xff"], 0x10))
    assert decoded["K.s"].value[0] == 0x15 * 0.5 - 1
    assert decoded["K.s"].quality.tolist() == ([0, 0] if suffix == "kcd" else [0, 4])


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("x.kcd", KCD.replace('"12"', '"1000000"'), "x.kcd:1: the number 1000000 lies outside"),
        ("x.kcd", '<!DOCTYPE x [<!ENTITY a "b">]>' + KCD, "XML entities"),
        ("x.kcd", KCD[:-30], "x.kcd:1: not a valid KCD"),
        ("x.kcd", KCD.replace('"12"', '"13"'), "K.s ends in byte 3 of a message of 2"),
        ("x.sym", SYM.replace("4,12", "4,1000000"), "x.sym:12: the number 1000000 lies outside"),
        ("x.sym", SYM.replace("010h", "00000000h-1FFFFFFFh"), "x.sym:10: more than 2000 ident"),
        ("x.sym", SYM.replace("6.0", "5.0"), "not a valid SYM"),
        ("x.sym", SYM + " " * 1_000_000, "larger than 1 MB"),
    ],
)
def test_kcd_and_sym_that_cannot_be_used_are_refused(name: str, text: str, reason: str) -> None:
    with pytest.raises(InputError) as refusal:
        parse_codec(text, name)
    assert reason in str(refusal.value)


TWINS = """VERSION ""
BU_: A
BO_ 100 M: 8 A
 SG_ top M : 0|8@1+ (1,0) [0|0] "" A
 SG_ lock : 8|2@1+ (1,0) [0|0] "" A
 SG_ lock : 10|2@1+ (10,0) [0|0] "" A
 SG_ limit m3 : 16|8@1+ (1,0) [0|0] "" A
 SG_ limit m4 : 16|8@1+ (2,0) [0|0] "" A
"""


def test_signals_of_one_name_are_kept_under_names_of_their_own() -> None:
    codec = parse_codec(TWINS, "a.dbc")
    assert not codec.left_out
    sent = block([bytes([3, 0b1110, 5, *[0] * 5]), bytes([4, 0b0001, 5, *[0] * 5])], 100)
    found = {name: s.value.tolist() for name, s in codec.decode(sent).samples.items()}
    assert found == {
        "M.top": [3, 4],
        "M.lock_b8": [2, 1],
        "M.lock_b10": [30, 0],
        "M.limit_m3": [5],
        "M.limit_m4": [10],
    }


@pytest.mark.parametrize(
    "statement",
    [
        "SIG_VALTYPE_ 100 lock : 0;\n",  # of which one?
        'BA_DEF_ SG_ "SignalRole" STRING;\nBA_ "SignalRole" SG_ 100 lock "counter";\n',
    ],
)
def test_a_type_or_role_of_one_of_two_signals_of_a_name_is_of_neither(statement: str) -> None:
    with pytest.raises(InputError, match=r"M\.lock .*defined twice"):
        parse_codec(TWINS + statement, "a.dbc")


@pytest.mark.parametrize(
    ("stated", "can_id", "extended"),
    [(2047, 2047, False), (2048, 2048, True), ((1 << 29) - 1, (1 << 29) - 1, True)],
)
def test_an_identifier_of_more_than_11_bits_is_one_of_29(
    stated: int, can_id: int, extended: bool
) -> None:
    codec = parse_codec(TWINS.replace("BO_ 100", f"BO_ {stated}"), "a.dbc")
    (message,) = codec.messages
    assert (message.can_id, message.is_extended) == (can_id, extended)
    assert ["longer: it is read as a 29-bit message" in note.text for note in codec.notes] == [
        True
    ] * extended
