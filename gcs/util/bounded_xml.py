"""Untrusted XML: no document type, no entities, and bounds on the number of elements and on nesting."""

import contextlib
import re
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from gcs.util.bounded_file import AtLine

_LINE = ""  # the attribute with an element's line: no attribute of a document has an empty name
XML_ELEMENTS_MAX = 500_000  # each takes some hundred bytes of memory
_DEPTH_MAX = 64
_DECLARED = re.compile(rb"""(?:\xef\xbb\xbf)?\s*<\?xml[^>]*?encoding\s*=\s*["']([^"']*)["']""")


def read_xml(data: bytes) -> Element:
    """The root of an XML document; names of elements and attributes have no prefixes. `line_of` knows their lines.

    Raises ValueError, also for entities, many elements and deep nesting.
    """
    parser, tree = _parser(data), TreeBuilder()
    count = depth = 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > XML_ELEMENTS_MAX:
            raise ValueError(f"more than {XML_ELEMENTS_MAX:,} elements")
        if depth > _DEPTH_MAX:
            raise ValueError("elements are nested too deeply")
        plain = {_plain(key): value for key, value in attributes.items()}
        tree.start(_plain(name), plain | {_LINE: str(parser.CurrentLineNumber)})

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
        raise AtLine(f"line {error.lineno}: not XML: {expat.ErrorString(error.code)}") from None
    except LookupError as error:  # an encoding that Python does not know
        raise ValueError(f"not XML: {error}") from None
    return tree.close()


def root_of(data: bytes) -> str:
    """The name of the root element, without its prefix, however broken the rest is; empty where there is none."""
    found: list[str] = []
    parser = _parser(data)

    def begin(name: str, _: dict[str, str]) -> NoReturn:
        found.append(_plain(name))
        raise StopIteration

    def ended(*_: object) -> NoReturn:
        raise StopIteration

    parser.StartElementHandler, parser.StartDoctypeDeclHandler = begin, ended
    with contextlib.suppress(StopIteration, expat.ExpatError, LookupError):
        parser.Parse(data, True)
    return found[0] if found else ""


def line_of(element: Element) -> int:
    """The line on which an element begins."""
    return int(element.get(_LINE, "1"))


def text_of(element: Element, path: str = ".") -> str:
    """The text of the first element at a path, without blanks around it; empty if there is none."""
    found = element.find(path)
    return "" if found is None else (found.text or "").strip()


def _parser(data: bytes) -> expat.XMLParserType:
    """A parser; a text that was UTF-16 and is UTF-8 now still declares what it was."""
    declared = _DECLARED.match(data)
    is_utf8 = declared is not None and declared[1].upper().startswith(b"UTF-16")
    return expat.ParserCreate("utf-8" if is_utf8 else None)


def _plain(name: str) -> str:
    return name.rpartition(":")[2]
