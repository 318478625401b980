"""Databases of other kinds than DBC: KCD, SYM and ARXML."""

from __future__ import annotations

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


def kcd_text(second: str) -> str:
    """Return a message whose selector chooses one of two signals, the second one as given."""
    return (
        '<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0"><Document/>'
        '<Bus name="B"><Message id="0x123" name="Limits" length="8">'
        '<Multiplex name="Which" offset="0" length="8">'
        '<MuxGroup count="3"><Signal name="Low" offset="8" length="16"><Value slope="0.1"/>'
        f'</Signal></MuxGroup><MuxGroup count="4"><Signal name="{second}" offset="16" length="16"/>'
        "</MuxGroup></Multiplex></Message></Bus></NetworkDefinition>"
    )


def message(name: str, slope: float, can_id: int = FRAME, producer: str = "1") -> str:
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


FRONT = f'<Bus name="Front &amp; é">{message("Hub", 0.5)}{message("Own", 2.0, 0x200)}</Bus>'
REAR = f'<Bus name="Rear">{message("Hub", 0.25)}</Bus>'
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
