"""XML of others: no document type and no entities, and bounds on the number of elements and on their nesting."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat

XML_ELEMENTS_MAX = 500_000  # each takes some hundred bytes of memory
_DEPTH_MAX = 64


@dataclass
class XmlElement:
    """An element: its name and attributes without prefixes, its text, and the elements in it, in order."""

    name: str
    attributes: dict[str, str]
    children: list[XmlElement] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """Its own text, without that of the elements in it, and without blanks around it."""
        return "".join(self.pieces).strip()

    def all(self, *names: str) -> Iterator[XmlElement]:
        """The elements directly in it that have one of these names, in order."""
        return (child for child in self.children if child.name in names)

    def first(self, *path: str) -> XmlElement | None:
        """The first element at a path of names below it; None if there is none."""
        found: XmlElement | None = self
        for name in path:
            found = None if found is None else next(found.all(name), None)
        return found

    def said(self, *path: str) -> str:
        """The text of the first element at a path of names; empty if there is none."""
        found = self.first(*path)
        return "" if found is None else found.text

    def below(self, *names: str) -> Iterator[XmlElement]:
        """All elements in it with one of these names, at any depth, in the order of the file."""
        waiting = self.children[::-1]
        while waiting:
            one = waiting.pop()
            if one.name in names:
                yield one
            waiting += one.children[::-1]


def read_xml(data: bytes) -> XmlElement:
    """The root of an XML document. Raises ValueError, also for entities, many elements and deep nesting."""
    parser = expat.ParserCreate()
    top = XmlElement("", {})
    open_elements, count = [top], 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > XML_ELEMENTS_MAX:
            raise ValueError(f"more than {XML_ELEMENTS_MAX:,} elements")
        if len(open_elements) > _DEPTH_MAX:
            raise ValueError("elements are nested too deeply")
        element = XmlElement(_plain(name), {_plain(key): value for key, value in attributes.items()})
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def end(_name: str) -> None:
        open_elements.pop()

    def characters(text: str) -> None:
        open_elements[-1].pieces.append(text)

    def entities(*_: object) -> NoReturn:
        raise ValueError("it declares a document type or entities")

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = begin, end, characters
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = parser.ExternalEntityRefHandler = entities
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ValueError(f"line {error.lineno}: not XML: {expat.ErrorString(error.code)}") from None
    except LookupError as error:  # an encoding that Python does not know
        raise ValueError(f"not XML: {error}") from None
    return top.children[0]


def _plain(name: str) -> str:
    return name.rpartition(":")[2]
