"""AUTOSAR system descriptions of one frame, with as much in them as names signals and where their bits are."""

from __future__ import annotations

from dataclasses import dataclass

ORDERS = {False: "MOST-SIGNIFICANT-BYTE-LAST", True: "MOST-SIGNIFICANT-BYTE-FIRST"}
ENCODINGS = {"unsigned": "NONE", "signed": "2C", "float": "IEEE754"}


@dataclass(frozen=True, slots=True)
class Signal:
    """`start` as AUTOSAR counts it: Intel's least significant bit, Motorola's most significant one, in cantools' numbering."""

    name: str
    start: int
    length: int
    motorola: bool = False
    kind: str = "unsigned"
    scale: int = 1
    offset: int = 0


def text(identifier: int, extended: bool, size: int, signals: list[Signal]) -> str:
    """The file."""
    parts = "".join(_signal(signal) for signal in signals)
    places = "".join(
        f'<I-SIGNAL-TO-I-PDU-MAPPING><SHORT-NAME>m{s.name}</SHORT-NAME><I-SIGNAL-REF DEST="I-SIGNAL">/p/{s.name}</I-SIGNAL-REF>'
        f"<PACKING-BYTE-ORDER>{ORDERS[s.motorola]}</PACKING-BYTE-ORDER><START-POSITION>{s.start}</START-POSITION></I-SIGNAL-TO-I-PDU-MAPPING>"
        for s in signals
    )
    mode = "EXTENDED" if extended else "STANDARD"
    return (
        '<?xml version="1.0" encoding="UTF-8"?><AUTOSAR xmlns="http://autosar.org/schema/r4.0"><AR-PACKAGES><AR-PACKAGE>'
        "<SHORT-NAME>p</SHORT-NAME><ELEMENTS><CAN-CLUSTER><SHORT-NAME>bus</SHORT-NAME><CAN-CLUSTER-VARIANTS><CAN-CLUSTER-CONDITIONAL>"
        "<PHYSICAL-CHANNELS><CAN-PHYSICAL-CHANNEL><SHORT-NAME>c</SHORT-NAME><FRAME-TRIGGERINGS><CAN-FRAME-TRIGGERING>"
        '<SHORT-NAME>t</SHORT-NAME><FRAME-REF DEST="CAN-FRAME">/p/Frame</FRAME-REF>'
        f"<CAN-ADDRESSING-MODE>{mode}</CAN-ADDRESSING-MODE><IDENTIFIER>{identifier}</IDENTIFIER></CAN-FRAME-TRIGGERING></FRAME-TRIGGERINGS>"
        "</CAN-PHYSICAL-CHANNEL></PHYSICAL-CHANNELS></CAN-CLUSTER-CONDITIONAL></CAN-CLUSTER-VARIANTS></CAN-CLUSTER>"
        f"<CAN-FRAME><SHORT-NAME>Frame</SHORT-NAME><FRAME-LENGTH>{size}</FRAME-LENGTH><PDU-TO-FRAME-MAPPINGS><PDU-TO-FRAME-MAPPING>"
        '<SHORT-NAME>f</SHORT-NAME><PDU-REF DEST="I-SIGNAL-I-PDU">/p/Pdu</PDU-REF></PDU-TO-FRAME-MAPPING>'
        "</PDU-TO-FRAME-MAPPINGS></CAN-FRAME>"
        f"<I-SIGNAL-I-PDU><SHORT-NAME>Pdu</SHORT-NAME><LENGTH>{size}</LENGTH>"
        f"<I-SIGNAL-TO-PDU-MAPPINGS>{places}</I-SIGNAL-TO-PDU-MAPPINGS></I-SIGNAL-I-PDU>{parts}</ELEMENTS></AR-PACKAGE></AR-PACKAGES></AUTOSAR>"
    )


def _signal(s: Signal) -> str:
    return (
        f"<I-SIGNAL><SHORT-NAME>{s.name}</SHORT-NAME><LENGTH>{s.length}</LENGTH><NETWORK-REPRESENTATION-PROPS><SW-DATA-DEF-PROPS-VARIANTS>"
        f'<SW-DATA-DEF-PROPS-CONDITIONAL><BASE-TYPE-REF DEST="SW-BASE-TYPE">/p/b{s.name}</BASE-TYPE-REF></SW-DATA-DEF-PROPS-CONDITIONAL>'
        "</SW-DATA-DEF-PROPS-VARIANTS></NETWORK-REPRESENTATION-PROPS>"
        f'<SYSTEM-SIGNAL-REF DEST="SYSTEM-SIGNAL">/p/s{s.name}</SYSTEM-SIGNAL-REF></I-SIGNAL>'
        f"<SW-BASE-TYPE><SHORT-NAME>b{s.name}</SHORT-NAME><BASE-TYPE-SIZE>{s.length}</BASE-TYPE-SIZE>"
        f"<BASE-TYPE-ENCODING>{ENCODINGS[s.kind]}</BASE-TYPE-ENCODING></SW-BASE-TYPE>"
        f"<SYSTEM-SIGNAL><SHORT-NAME>s{s.name}</SHORT-NAME><PHYSICAL-PROPS><SW-DATA-DEF-PROPS-VARIANTS><SW-DATA-DEF-PROPS-CONDITIONAL>"
        f'<COMPU-METHOD-REF DEST="COMPU-METHOD">/p/c{s.name}</COMPU-METHOD-REF></SW-DATA-DEF-PROPS-CONDITIONAL>'
        "</SW-DATA-DEF-PROPS-VARIANTS></PHYSICAL-PROPS></SYSTEM-SIGNAL>"
        f"<COMPU-METHOD><SHORT-NAME>c{s.name}</SHORT-NAME><CATEGORY>LINEAR</CATEGORY><COMPU-INTERNAL-TO-PHYS><COMPU-SCALES><COMPU-SCALE>"
        f"<COMPU-RATIONAL-COEFFS><COMPU-NUMERATOR><V>{s.offset}</V><V>{s.scale}</V></COMPU-NUMERATOR>"
        "<COMPU-DENOMINATOR><V>1</V></COMPU-DENOMINATOR></COMPU-RATIONAL-COEFFS></COMPU-SCALE></COMPU-SCALES></COMPU-INTERNAL-TO-PHYS>"
        "</COMPU-METHOD>"
    )
