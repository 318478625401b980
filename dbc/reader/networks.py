"""Divides databases of several buses (KCD, ARXML) by bus.

``car.kcd#Powertrain`` is the bus Powertrain of the file ``car.kcd``: its text without the other
buses.  So every stored text of a database has unique identifiers.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

from ..errors import InputError

MARK = "#"
"""Separator between the name of a file and of a bus in it."""

_ELEMENT = {"kcd": "Bus", "arxml": "CAN-CLUSTER"}
"""Name of the element that holds the messages of one bus, by kind of database."""


def network_names(text: str, kind: str) -> tuple[str, ...]:
    """Return the names of the buses in a KCD or ARXML; none for another kind.

    `kind`: as `foreign.foreign_kind` returns it.
    """
    return tuple(dict.fromkeys(name for name, _, _ in _spans(text.encode(), kind)))


def one_network(text: str, kind: str, file: str, network: str) -> str:
    """Return the text of a database without the buses that are not called `network`.

    `file`: its name, for the error.  Raises InputError if it has no such bus.
    """
    content = text.encode()
    spans = _spans(content, kind)
    if network not in {name for name, _, _ in spans}:
        names = ", ".join(dict.fromkeys(name for name, _, _ in spans))
        advice = f"name one of {names}" if names else f"name the file without {MARK}{network}"
        raise InputError(file, f"has no bus {network}", advice)
    kept, end = b"", 0
    for name, start, stop in spans:
        if name != network:
            kept, end = kept + content[end:start], stop
    return (kept + content[end:]).decode()


def _spans(content: bytes, kind: str) -> list[tuple[str, int, int]]:
    """Return name, start and stop of each bus in a UTF-8 text; none if it is not valid XML."""
    if kind not in _ELEMENT or b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        return []
    parser = expat.ParserCreate("utf-8")
    finder = _Finder(_ELEMENT[kind], content, parser)
    parser.StartElementHandler = finder.open
    parser.EndElementHandler = finder.close
    parser.CharacterDataHandler = finder.read
    try:
        parser.Parse(content, True)
    except expat.ExpatError:  # cantools reports what is wrong
        return []
    return finder.spans


@dataclass(slots=True)
class _Finder:
    """Collects the positions of bus elements from the events of an XML parser."""

    element: str
    content: bytes
    parser: expat.XMLParserType
    spans: list[tuple[str, int, int]] = field(default_factory=list)
    path: list[str] = field(default_factory=list)
    name: str = ""
    start: int = 0

    def open(self, tag: str, attributes: dict[str, str]) -> None:
        plain = tag.rpartition(":")[2]
        if plain == self.element:
            self.name, self.start = attributes.get("name", ""), self.parser.CurrentByteIndex
        self.path.append(plain)

    def read(self, text: str) -> None:
        if self.path[-2:] == ["CAN-CLUSTER", "SHORT-NAME"]:
            self.name += text

    def close(self, tag: str) -> None:
        if self.path.pop() == self.element:
            stop = self.parser.CurrentByteIndex
            if self.content.startswith(f"</{tag}".encode(), stop):  # except for an empty element
                stop = self.content.index(b">", stop) + 1
            self.spans.append((self.name.strip(), self.start, stop))
