"""XML of others is read within bounds, without entities."""

from __future__ import annotations

import pytest

from gcs.util import bounded_xml
from gcs.util.bounded_xml import read_xml, text_of


def test_elements_have_names_without_prefixes_text_and_order() -> None:
    root = read_xml(b'<?xml version="1.0"?><k:a x:id="7"> one <gx:b>two</gx:b><c><b>three</b></c> </k:a>')
    assert (root.tag, root.get("id"), text_of(root)) == ("a", "7", "one")
    assert [one.text for one in root.iter("b")] == ["two", "three"]
    assert [one.text for one in root.findall("b")] == ["two"]
    assert text_of(root, "c/b") == "three"
    assert root.find("b/c") is None
    assert text_of(root, "d") == ""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1"])
def test_encodings_that_a_file_declares_are_read(encoding: str) -> None:
    text = f'<?xml version="1.0" encoding="{encoding}"?><a>Höhe</a>'
    assert read_xml(text.encode(encoding)).text == "Höhe"


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "line 1: not XML: no element found"),
        (b"<a>\n<b></a>", "line 2: not XML: mismatched tag"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "document type or entities"),
        (b'<!DOCTYPE a SYSTEM "other.dtd"><a/>', "document type or entities"),
        (b"<a>&b;</a>", "not XML: undefined entity"),
        (b"<a>" * 65, "nested too deeply"),
        (b'<?xml version="1.0" encoding="no-such"?><a/>', "not XML"),
    ],
)
def test_what_is_no_plain_xml_is_refused(data: bytes, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        read_xml(data)


def test_the_number_of_elements_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_xml, "XML_ELEMENTS_MAX", 10)
    assert len(read_xml(b"<a>" + b"<b/>" * 9 + b"</a>")) == 9
    with pytest.raises(ValueError, match="more than 10 elements"):
        read_xml(b"<a>" + b"<b/>" * 10 + b"</a>")
