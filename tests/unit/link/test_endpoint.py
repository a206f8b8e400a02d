import pytest

from gcs.errors import UsageError
from gcs.link.endpoint import AddressBook, LinkMode, LinkSpec, parse_link_spec

FIRST, SECOND = ("127.0.0.1", 5001), ("127.0.0.1", 5002)


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("udpin:0.0.0.0:14550", LinkSpec(LinkMode.LISTEN, "0.0.0.0", 14550)),
        ("udpout:sim.local:14540", LinkSpec(LinkMode.CALL, "sim.local", 14540)),
        ("127.0.0.1:14550", LinkSpec(LinkMode.LISTEN, "127.0.0.1", 14550)),
    ],
)
def test_links_by_name(text, spec):
    assert parse_link_spec(text) == spec


@pytest.mark.parametrize(
    "text", ["", "14550", "udpin:", "udpin:host", "udpout:h:0", "udpin:h:99999", "tcp:h:1:2", "udpin::5", "h:²"]
)
def test_bad_names_are_quoted_with_an_example(text):
    with pytest.raises(UsageError) as caught:
        parse_link_spec(text)
    assert repr(text) in caught.value.message
    assert "udpin:127.0.0.1:14550" in caught.value.hint


def test_each_system_is_answered_at_its_own_address():
    book = AddressBook()
    assert book.claim(1, FIRST, 0.0)
    assert book.claim(2, SECOND, 0.0)
    assert book.address(1) == FIRST
    assert book.address(2) == SECOND
    assert book.address(3) is None
    assert book.addresses() == {FIRST, SECOND}


def test_two_addresses_with_one_id_are_refused_while_both_live():
    book = AddressBook()
    assert book.claim(1, FIRST, 0.0)
    assert not book.claim(1, SECOND, 1.0)
    assert book.address(1) == FIRST
    assert "127.0.0.1:5001" in book.conflicts[1].message
    assert "127.0.0.1:5002" in book.conflicts[1].message


def test_a_vehicle_that_fell_silent_may_come_back_from_elsewhere():
    book = AddressBook()
    assert book.claim(1, FIRST, 0.0)
    assert book.claim(1, SECOND, 4.0)
    assert book.address(1) == SECOND
    assert not book.conflicts
