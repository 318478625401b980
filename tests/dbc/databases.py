"""Random DBC texts and frames, with an oracle: cantools, asked for one signal at a time.

cantools packs all signals of a message into one format, and loses its place where signals overlap;
a message of one signal has nothing to overlap with.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cantools.database import Database, load_string
from hypothesis import strategies as st

FACTORS = ("1", "2", "-3", "0.001", "-0.5", "2.0", "0.1", "1e-7", "9.80665e3")
OFFSETS = ("0", "0", "-40", "0.5", "-163.84", "1e3")
LENGTHS = (1, 2, 5, 7, 8, 8, 8, 12, 24, 64)


@dataclass(frozen=True)
class Field:
    """One signal as DBC text would have it."""

    name: str
    start: int
    length: int
    motorola: bool
    sign: str
    float_type: int
    factor: str
    offset: str
    selector: str = ""
    chosen: tuple[tuple[int, int], ...] = ()
    is_selector: bool = False

    def line(self, multiplexing: str = "") -> str:
        order = 0 if self.motorola else 1
        return (
            f" SG_ {self.name} {multiplexing}: {self.start}|{self.length}@{order}{self.sign}"
            f' ({self.factor},{self.offset}) [0|0] "" B'
        )

    @property
    def marker(self) -> str:
        chosen = f"m{self.chosen[0][0]}" if self.selector else ""
        return chosen + ("M " if self.is_selector else " " if chosen else "")

    @property
    def bits(self) -> list[int]:
        """Numbers of the bits, 8 * byte + bit, walked one by one from the start bit."""
        walked = [self.start]
        while len(walked) < self.length:
            bit = walked[-1]
            step = (15 if bit % 8 == 0 else -1) if self.motorola else 1
            walked.append(bit + step)
        return walked


@dataclass(frozen=True)
class Message:
    """One message as DBC text would have it."""

    name: str
    can_id: int
    extended: bool
    length: int
    fields: tuple[Field, ...]

    @property
    def number(self) -> int:
        return self.can_id | (self.extended << 31)

    def text(self, only: Field | None = None) -> str:
        """Return the definition, an empty line, and what belongs at the end of the DBC."""
        fields = self.fields if only is None else (only,)
        lines = [f"BO_ {self.number} {self.name}: {self.length} A"]
        lines += [f.line("" if only else f.marker) for f in fields]
        lines.append("")
        for f in fields:
            if f.float_type:
                lines.append(f"SIG_VALTYPE_ {self.number} {f.name} : {f.float_type};")
            if f.selector and not only:
                ranges = ", ".join(f"{low}-{high}" for low, high in f.chosen)
                lines.append(f"SG_MUL_VAL_ {self.number} {f.name} {f.selector} {ranges};")
        return "\n".join(lines)


def parse_one(message: Message, only: Field | None = None) -> Any:
    """Return the cantools message of a text."""
    loaded = load_string(database([message], only), "dbc", strict=False)
    assert isinstance(loaded, Database)  # load_string may also return a diagnostics database
    return loaded.messages[0]


def database(messages: list[Message], only: Field | None = None) -> str:
    """Return the DBC text of several messages, or of one of their signals alone."""
    body = [message.text(only).split("\n\n") for message in messages]
    heads = "\n\n".join(part[0] for part in body)
    tails = "\n".join(part[1] for part in body if len(part) > 1)
    return f'VERSION ""\n\nBU_: A B\n\n{heads}\n\n{tails}\n'


@st.composite
def fields(draw: st.DrawFn, name: str, payload: int) -> Field:
    """Return any signal that fits in `payload` bytes."""
    floats = [bits for bits in (16, 32, 64) if bits <= 8 * payload]
    is_float = bool(floats) and draw(st.integers(0, 4)) == 0
    length = draw(st.sampled_from(floats) if is_float else st.integers(1, min(64, 8 * payload)))
    aligned = draw(st.booleans())
    first = draw(st.integers(0, 8 * payload - length))
    if aligned:
        first -= first % 8
    motorola = draw(st.booleans())
    return Field(
        name=name,
        start=8 * (first // 8) + 7 - first % 8 if motorola else first,
        length=length,
        motorola=motorola,
        sign=draw(st.sampled_from("+-")),
        float_type=(2 if length == 64 else 1) if is_float else 0,
        factor=draw(st.sampled_from(FACTORS)),
        offset=draw(st.sampled_from(OFFSETS)),
    )


@st.composite
def messages(draw: st.DrawFn, name: str, can_id: int, extended: bool) -> Message:
    """Return a message of overlapping signals of every kind."""
    length = draw(st.sampled_from(LENGTHS))
    count = draw(st.integers(1, 4))
    signals = tuple(draw(fields(f"s{i}", length)) for i in range(count))
    return Message(name, can_id, extended, length, signals)


@st.composite
def payloads(draw: st.DrawFn, length: int) -> bytes:
    """Return `length` bytes: any, or those at the ends of ranges and at special floats."""
    pattern = draw(st.sampled_from((b"", b"\xff", b"\x80\x00", b"\x7f\xf0\x00\x00", b"\x7f\xff")))
    if not pattern:
        return draw(st.binary(min_size=length, max_size=length))
    return (pattern * length)[:length]


@st.composite
def multiplexed(draw: st.DrawFn) -> Message:
    """Return a message with one or two nested selectors, and without overlaps.

    Each byte belongs to one signal, so that cantools reads the whole message rightly.
    """
    motorola = draw(st.booleans())
    ids = st.integers(0, 7)

    def field(name: str, byte: int, bits: int, **more: Any) -> Field:
        start = 8 * byte + (7 if motorola else 0)
        sign = "+" if more.get("is_selector") else draw(st.sampled_from("+-"))
        return Field(name, start, bits, motorola, sign, 0, "1", "0", **more)

    def chosen() -> tuple[tuple[int, int], ...]:
        low, high = sorted((draw(ids), draw(ids)))
        return ((low, high), (20, 21)) if draw(st.booleans()) else ((low, high),)

    nested = draw(st.booleans())
    signals = [
        field("top", 0, 3, is_selector=True),
        field("always", 1, 8),
        field("a", 2, 16, selector="top", chosen=chosen()),
        field("b", 2, 12, selector="top", chosen=chosen()),
    ]
    if nested:
        signals += [
            field("inner", 4, 3, selector="top", chosen=chosen(), is_selector=True),
            field("deep", 5, 8, selector="inner", chosen=chosen()),
        ]
    kept = [s for s in signals if s.name != "b" or not _meet(s, signals[2])]
    return Message("Mux", 0x321, draw(st.booleans()), 8, tuple(kept))


def _meet(one: Field, other: Field) -> bool:
    """Return True if two signals can be in the same frame."""
    return any(
        low <= end and start <= high for low, high in one.chosen for start, end in other.chosen
    )
