"""Untrusted XML: no document type, no entities, and bounds on the number of elements and on nesting."""

from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

XML_ELEMENTS_MAX = 500_000  # each takes some hundred bytes of memory
_DEPTH_MAX = 64


def read_xml(data: bytes) -> Element:
    """The root of an XML document; names of elements and attributes have no prefixes.

    Raises ValueError, also for entities, many elements and deep nesting.
    """
    parser, tree = expat.ParserCreate(), TreeBuilder()
    count = depth = 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > XML_ELEMENTS_MAX:
            raise ValueError(f"more than {XML_ELEMENTS_MAX:,} elements")
        if depth > _DEPTH_MAX:
            raise ValueError("elements are nested too deeply")
        tree.start(_plain(name), {_plain(key): value for key, value in attributes.items()})

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        tree.end(_plain(name))

    def entities(*_: object) -> NoReturn:
        raise ValueError("it declares a document type or entities")

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = begin, end, tree.data
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = parser.ExternalEntityRefHandler = entities
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ValueError(f"line {error.lineno}: not XML: {expat.ErrorString(error.code)}") from None
    except LookupError as error:  # an encoding that Python does not know
        raise ValueError(f"not XML: {error}") from None
    return tree.close()


def text_of(element: Element, path: str = ".") -> str:
    """The text of the first element at a path, without blanks around it; empty if there is none."""
    found = element.find(path)
    return "" if found is None else (found.text or "").strip()


def _plain(name: str) -> str:
    return name.rpartition(":")[2]
