"""Random DBC texts and frames, with an oracle: cantools, asked for one signal at a time.

cantools packs all signals of a message into one format, and loses its place where signals overlap;
a message of one signal has nothing to overlap with.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Any

import numpy as np
from cantools.database import Database, load_string

from dbc import FrameBatch, FrameFlag

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

    def line(self, multiplexing: str) -> str:
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

    def text(self) -> str:
        """Return the definition, an empty line, and what belongs at the end of the DBC."""
        lines = [f"BO_ {self.number} {self.name}: {self.length} A"]
        lines += [f.line(f.marker) for f in self.fields]
        lines.append("")
        for f in self.fields:
            if f.float_type:
                lines.append(f"SIG_VALTYPE_ {self.number} {f.name} : {f.float_type};")
            if f.selector:
                ranges = ", ".join(f"{low}-{high}" for low, high in f.chosen)
                lines.append(f"SG_MUL_VAL_ {self.number} {f.name} {f.selector} {ranges};")
        return "\n".join(lines)


def oracle(messages: Iterable[Message], *, whole: bool = False) -> dict[tuple[str, str], Any]:
    """Return cantools' messages by message and signal, each with that signal alone.

    `whole`: True for one message of each, by its name and "".
    """
    if whole:
        loaded = load_string(database(list(messages)), "dbc", strict=False)
        assert isinstance(loaded, Database)  # load_string may also return a diagnostics database
        return {(message.name, ""): message for message in loaded.messages}
    pairs = [(message, field) for message in messages for field in message.fields]
    alone = [
        Message(f"O{i}", i, True, m.length, (replace(f, selector="", is_selector=False),))
        for i, (m, f) in enumerate(pairs)
    ]
    found = oracle(alone, whole=True)
    return {(m.name, f.name): found[f"O{i}", ""] for i, (m, f) in enumerate(pairs)}


def database(messages: list[Message]) -> str:
    """Return the DBC text of several messages."""
    parts = [message.text().split("\n\n") for message in messages]
    heads = "\n\n".join(part[0] for part in parts)
    tails = "\n".join(part[1] for part in parts if len(part) > 1)
    return f'VERSION ""\n\nBU_: A B\n\n{heads}\n\n{tails}\n'


def random_field(draw: Random, name: str, payload: int) -> Field:
    """Return any signal that fits in `payload` bytes."""
    floats = [bits for bits in (16, 32, 64) if bits <= 8 * payload]
    is_float = bool(floats) and draw.random() < 0.2
    length = draw.choice(floats) if is_float else draw.randint(1, min(64, 8 * payload))
    first = draw.randint(0, 8 * payload - length)
    first -= first % 8 * draw.randint(0, 1)
    motorola = draw.random() < 0.5
    return Field(
        name=name,
        start=8 * (first // 8) + 7 - first % 8 if motorola else first,
        length=length,
        motorola=motorola,
        sign=draw.choice("+-"),
        float_type=(2 if length == 64 else 1) if is_float else 0,
        factor=draw.choice(FACTORS),
        offset=draw.choice(OFFSETS),
    )


def random_message(draw: Random, name: str, can_id: int, extended: bool) -> Message:
    """Return a message of one to four overlapping signals of every kind."""
    length = draw.choice(LENGTHS)
    signals = tuple(random_field(draw, f"s{i}", length) for i in range(draw.randint(1, 4)))
    return Message(name, can_id, extended, length, signals)


def random_payload(draw: Random, length: int) -> bytes:
    """Return `length` bytes: any, or those at the ends of ranges and at special floats."""
    pattern = draw.choice((b"", b"\xff", b"\x80\x00", b"\x7f\xf0\x00\x00", b"\x7f\xff"))
    return (pattern * length)[:length] if pattern else draw.randbytes(length)


def random_multiplexed(draw: Random, name: str, can_id: int) -> Message:
    """Return a message with one or two nested selectors, and without overlaps.

    Each byte belongs to one signal, so that cantools reads the whole message rightly.
    """
    motorola = draw.random() < 0.5

    def field(name: str, byte: int, bits: int, **more: Any) -> Field:
        start = 8 * byte + (7 if motorola else 0)
        sign = "+" if more.get("is_selector") else draw.choice("+-")
        return Field(name, start, bits, motorola, sign, 0, "1", "0", **more)

    def chosen() -> tuple[tuple[int, int], ...]:
        low, high = sorted((draw.randint(0, 7), draw.randint(0, 7)))
        return ((low, high), (20, 21)) if draw.random() < 0.5 else ((low, high),)

    signals = [
        field("top", 0, 3, is_selector=True),
        field("always", 1, 8),
        field("a", 2, 16, selector="top", chosen=chosen()),
        field("b", 2, 12, selector="top", chosen=chosen()),
    ]
    if draw.random() < 0.5:
        signals += [
            field("inner", 4, 3, selector="top", chosen=chosen(), is_selector=True),
            field("deep", 5, 8, selector="inner", chosen=chosen()),
        ]
    if any(
        low <= end and start <= high
        for low, high in signals[2].chosen
        for start, end in signals[3].chosen
    ):
        del signals[3]
    return Message(name, can_id, draw.random() < 0.5, 8, tuple(signals))


# Blocks of frames from lists of payloads --------------------------------------------------------


def block(
    payloads: Sequence[bytes],
    can_id: int | Sequence[int],
    extended: bool | Sequence[bool] = False,
    flags: int | Sequence[int] = 0,
    width: int = 8,
) -> FrameBatch:
    """Return a block of these payloads, one a microsecond."""
    n = len(payloads)
    width = 64 if any(len(payload) > 8 for payload in payloads) else width
    data = np.zeros((n, width), np.uint8)
    for row, payload in zip(data, payloads, strict=True):
        row[: len(payload)] = list(payload)
    bits = np.broadcast_to(flags, n) | np.broadcast_to(extended, n) * int(FrameFlag.EXTENDED)
    return FrameBatch(
        np.arange(n) * 1000,
        np.broadcast_to(can_id, n),
        bits,
        np.zeros(n, np.uint8),
        np.array([len(payload) for payload in payloads], np.uint8),
        data,
    )


# CRC-8 SAE J1850 by long division of polynomials, as the standard defines it --------------------


DIVISOR = 0x11D


def crc8_by_division(payload: bytes) -> int:
    """Return the remainder of the inverted first byte and the rest, inverted."""
    if not payload:
        return 0
    dividend = int.from_bytes(bytes([payload[0] ^ 0xFF]) + payload[1:] + b"\0", "big")
    for bit in reversed(range(8, 8 * len(payload) + 8)):
        if dividend >> bit & 1:
            dividend ^= DIVISOR << bit - 8
    return dividend ^ 0xFF


# Databases of other kinds than DBC: KCD, SYM and ARXML ------------------------------------------


FRAME = 0x123


def arxml(length: int = 12) -> str:
    """Return a system description: one frame with one signal of 12 bits, 0.5 m/s2 a bit, -10."""

    def package(name: str, elements: str) -> str:
        inner = f"<SHORT-NAME>{name}</SHORT-NAME><ELEMENTS>{elements}</ELEMENTS>"
        return f"<AR-PACKAGE>{inner}</AR-PACKAGE>"

    cluster = (
        "<CAN-CLUSTER><SHORT-NAME>Bus</SHORT-NAME><CAN-CLUSTER-VARIANTS><CAN-CLUSTER-CONDITIONAL>"
        "<BAUDRATE>500000</BAUDRATE><PHYSICAL-CHANNELS><CAN-PHYSICAL-CHANNEL>"
        "<SHORT-NAME>Channel</SHORT-NAME><FRAME-TRIGGERINGS><CAN-FRAME-TRIGGERING>"
        "<SHORT-NAME>Trigger</SHORT-NAME><FRAME-REF DEST='CAN-FRAME'>/F/Hub</FRAME-REF>"
        "<CAN-ADDRESSING-MODE>STANDARD</CAN-ADDRESSING-MODE>"
        f"<IDENTIFIER>{FRAME}</IDENTIFIER></CAN-FRAME-TRIGGERING></FRAME-TRIGGERINGS>"
        "</CAN-PHYSICAL-CHANNEL></PHYSICAL-CHANNELS></CAN-CLUSTER-CONDITIONAL>"
        "</CAN-CLUSTER-VARIANTS></CAN-CLUSTER>"
    )
    frame = (
        "<CAN-FRAME><SHORT-NAME>Hub</SHORT-NAME><FRAME-LENGTH>8</FRAME-LENGTH>"
        "<PDU-TO-FRAME-MAPPINGS><PDU-TO-FRAME-MAPPING><SHORT-NAME>M</SHORT-NAME>"
        "<PACKING-BYTE-ORDER>MOST-SIGNIFICANT-BYTE-LAST</PACKING-BYTE-ORDER>"
        "<PDU-REF DEST='I-SIGNAL-I-PDU'>/P/Pdu</PDU-REF><START-POSITION>0</START-POSITION>"
        "</PDU-TO-FRAME-MAPPING></PDU-TO-FRAME-MAPPINGS></CAN-FRAME>"
    )
    pdu = (
        "<I-SIGNAL-I-PDU><SHORT-NAME>Pdu</SHORT-NAME><LENGTH>8</LENGTH><I-SIGNAL-TO-PDU-MAPPINGS>"
        "<I-SIGNAL-TO-I-PDU-MAPPING><SHORT-NAME>S</SHORT-NAME>"
        "<I-SIGNAL-REF DEST='I-SIGNAL'>/S/az</I-SIGNAL-REF>"
        "<PACKING-BYTE-ORDER>MOST-SIGNIFICANT-BYTE-LAST</PACKING-BYTE-ORDER>"
        "<START-POSITION>4</START-POSITION></I-SIGNAL-TO-I-PDU-MAPPING>"
        "</I-SIGNAL-TO-PDU-MAPPINGS></I-SIGNAL-I-PDU>"
    )
    signal = (
        f"<I-SIGNAL><SHORT-NAME>az</SHORT-NAME><LENGTH>{length}</LENGTH>"
        "<NETWORK-REPRESENTATION-PROPS><SW-DATA-DEF-PROPS-VARIANTS>"
        "<SW-DATA-DEF-PROPS-CONDITIONAL>"
        "<BASE-TYPE-REF DEST='SW-BASE-TYPE'>/T/uint</BASE-TYPE-REF>"
        "</SW-DATA-DEF-PROPS-CONDITIONAL></SW-DATA-DEF-PROPS-VARIANTS>"
        "</NETWORK-REPRESENTATION-PROPS>"
        "<SYSTEM-SIGNAL-REF DEST='SYSTEM-SIGNAL'>/Y/az</SYSTEM-SIGNAL-REF></I-SIGNAL>"
    )
    base = (
        "<SW-BASE-TYPE><SHORT-NAME>uint</SHORT-NAME><BASE-TYPE-ENCODING>NONE</BASE-TYPE-ENCODING>"
        "</SW-BASE-TYPE>"
    )
    method = (
        "<COMPU-METHOD><SHORT-NAME>half</SHORT-NAME><CATEGORY>LINEAR</CATEGORY>"
        "<UNIT-REF DEST='UNIT'>/U/acc</UNIT-REF><COMPU-INTERNAL-TO-PHYS><COMPU-SCALES><COMPU-SCALE>"
        "<COMPU-RATIONAL-COEFFS><COMPU-NUMERATOR><V>-10</V><V>0.5</V></COMPU-NUMERATOR>"
        "<COMPU-DENOMINATOR><V>1</V></COMPU-DENOMINATOR></COMPU-RATIONAL-COEFFS></COMPU-SCALE>"
        "</COMPU-SCALES></COMPU-INTERNAL-TO-PHYS></COMPU-METHOD>"
    )
    unit = "<UNIT><SHORT-NAME>acc</SHORT-NAME><DISPLAY-NAME>m/s2</DISPLAY-NAME></UNIT>"
    system = (
        "<SYSTEM-SIGNAL><SHORT-NAME>az</SHORT-NAME><PHYSICAL-PROPS><SW-DATA-DEF-PROPS-VARIANTS>"
        "<SW-DATA-DEF-PROPS-CONDITIONAL>"
        "<COMPU-METHOD-REF DEST='COMPU-METHOD'>/C/half</COMPU-METHOD-REF>"
        "</SW-DATA-DEF-PROPS-CONDITIONAL></SW-DATA-DEF-PROPS-VARIANTS></PHYSICAL-PROPS>"
        "</SYSTEM-SIGNAL>"
    )
    names = {"N": cluster, "F": frame, "P": pdu, "S": signal, "T": base, "C": method}
    names |= {"U": unit, "Y": system}
    return (
        "<?xml version='1.0' encoding='UTF-8'?>\n<AUTOSAR xmlns='http://autosar.org/schema/r4.0' "
        "xmlns:xsi='http://www.w3.org/2001/XMLSchema-instance' "
        "xsi:schemaLocation='http://autosar.org/schema/r4.0 AUTOSAR_4-2-2.xsd'>\n<AR-PACKAGES>"
        + "\n".join(package(name, elements) for name, elements in names.items())
        + "</AR-PACKAGES></AUTOSAR>\n"
    )


def kcd_message(name: str, slope: float, can_id: int = FRAME, producer: str = "1") -> str:
    return (
        f'<Message id="{can_id:#x}" name="{name}" length="8">'
        f'<Producer><NodeRef id="{producer}"/></Producer>'
        f'<Signal name="az" offset="0" length="16"><Value slope="{slope}"/></Signal></Message>'
    )


def kcd(*buses: str) -> str:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0"><Document name="x"/>'
        '<Node id="1" name="A"/><Node id="2" name="B"/>' + "".join(buses) + "</NetworkDefinition>"
    )


FRONT = f'<Bus name="Front &amp; é">{kcd_message("Hub", 0.5)}{kcd_message("Own", 2.0, 0x200)}</Bus>'
REAR = f'<Bus name="Rear">{kcd_message("Hub", 0.25)}</Bus>'
TWO_BUSES = kcd('<Bus name="Empty"/>', FRONT, REAR)
SYM_TEXT = """FormatVersion=6.0 // Do not edit this line!
Title="Bench"

{ENUMS}
Enum=State(0="off",
  1="on", 255="not available")

{SIGNALS}
Sig=Travel unsigned 12 /u:mm /f:0.05 /o:-100 /max:104.75
Sig=Force float /u:N /min:-5000 /max:5000
Sig=Mode unsigned 8 /e:State
Sig=Rate signed 11 -m /f:0.1 /d:1

{SENDRECEIVE}

[Pots]
ID=181h // the front
Len=8
CycleTime=10
Sig=Travel 0
Sig=Force 32

[Two]
ID=00000022h-00000023h
Type=Extended
Len=8
Sig=Rate 2

[Which_A]
ID=200h
Len=8
Mux=A 0,8 1
Sig=Mode 8
[Which_B]
Len=8
Mux=B 0,8 2 -m
Sig=Travel 20
"""
