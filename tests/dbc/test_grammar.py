"""Statements are cut as they are written, on every Python, and lists have an end."""

from __future__ import annotations

import pytest

from dbc import InputError, parse_codec

HEAD = 'VERSION ""\n\nBU_: A B\n\nBO_ 1 M: 8 A\n SG_ s : 0|8@1+ (1,0) [0|0] "" B'
OTHER = '\n\nBO_ 7 N: 8 A\n SG_ t : 0|8@1+ (1,0) [0|0] "" B\n\n'


def names(text: str) -> tuple[list[str], list[str]]:
    """Return the messages that are loaded and those that are left out."""
    codec = parse_codec(text, "x.dbc")
    return [m.name for m in codec.messages], [remark.subject for remark in codec.left_out]


def test_the_first_message_after_a_list_of_nodes_is_there() -> None:
    # Python 3.11.2 gave it up without a word when the list's pattern was possessive.
    assert names(HEAD + OTHER) == (["M", "N"], [])


@pytest.mark.parametrize(
    ("number", "value"),
    [("1", 1.0), ("1.", 1.0), (".5", 0.5), ("-1.25e-1", -0.125), ("+2E2", 200.0), ("00.50", 0.5)],
)
def test_a_number_may_be_written_so(number: str, value: float) -> None:
    (message,) = parse_codec(HEAD.replace("(1,0)", f"({number},0)") + "\n", "x.dbc").messages
    assert message.signals[0].factor == value


@pytest.mark.parametrize("number", ["1.2.3", ".", "1e", "e1", "--1", "1 2", ""])
def test_a_number_may_not_be_written_so(number: str) -> None:
    with pytest.raises(InputError, match=r"x\.dbc:6"):
        parse_codec(HEAD.replace("(1,0)", f"({number},0)") + "\n", "x.dbc")


@pytest.mark.parametrize(
    "tail",
    [
        'BA_ "x" BO_ 12;\n',  # no identifier 1 with the value 2
        'BA_ "x" SG_ 1 s2;\n',
        "SIG_VALTYPE_ 1 s1;\n",
        'VAL_ 1 s1"off";\n',
        'VAL_ 1 2 "off";\n',
    ],
)
def test_a_word_is_not_split_to_make_it_fit(tail: str) -> None:
    (note,) = parse_codec(HEAD + OTHER + tail, "x.dbc").notes
    assert note.text == f"the text not understood: {tail.strip()}"


def test_an_escaped_quote_does_not_end_a_string() -> None:
    text = HEAD.replace('""', '"\\"g\\""').replace('VERSION "\\"g\\""', 'VERSION ""')
    tail = '\n\nCM_ SG_ 1 s "a \\" b; \\\\" c";\nVAL_ 1 s 254 "\\"SNA\\"" 255 "SNA";\n'
    codec = parse_codec(text + tail, "x.dbc")
    assert (codec.left_out, codec.notes) == ((), ())
    assert codec.messages[0].signals[0].unit == '"g"'
    assert codec.messages[0].signals[0].sentinels == (254, 255)


def test_what_is_not_understood_is_cited_as_it_is_written() -> None:
    codec = parse_codec(HEAD + OTHER + 'VAL_ 1 s 1 "a\\"b" x;\n', "x.dbc")
    assert r'VAL_ 1 s 1 "a\"b" x;' in codec.left_out[0].text


@pytest.mark.parametrize(
    ("names_of_values", "receivers", "loaded"),
    [(100_000, 1, ["M", "N"]), (100_001, 1, ["N"]), (1, 99_999, ["M", "N"]), (1, 100_000, ["N"])],
)
def test_a_list_has_at_most_a_hundred_thousand_items(
    names_of_values: int, receivers: int, loaded: list[str]
) -> None:
    text = HEAD + ",A" * receivers + OTHER + "VAL_ 1 s" + ' 1 "a"' * names_of_values + ";\n"
    assert names(text) == (loaded, ["message M"] if loaded == ["N"] else [])
