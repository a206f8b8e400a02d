"""Who lives where: one vehicle that moves or has two links, and two vehicles with one id."""

from gcs.link.session.routing import PROOF_S, LinkAddress, RoutingTable
from gcs.link.wire.message import Message

FIRST, SECOND = LinkAddress(0, ("127.0.0.1", 5001)), LinkAddress(0, ("127.0.0.1", 5002))


def version(uid2, sysid=1, uid=0):
    return Message("AUTOPILOT_VERSION", {"uid2": [uid2] + [0] * 17, "uid": uid}, sysid, 1)


def met_twice():
    book = RoutingTable()
    assert book.claim(1, FIRST, 0.0)
    assert not book.claim(1, SECOND, 1.0)
    return book


def test_each_system_is_answered_at_its_own_address():
    book = RoutingTable()
    assert book.claim(1, FIRST, 0.0)
    assert book.claim(2, SECOND, 0.0)
    assert book.place(1) == FIRST
    assert book.place(2) == SECOND
    assert book.place(3) is None
    assert book.places() == {FIRST, SECOND}


def test_two_addresses_with_one_id_are_asked_who_they_are():
    book = met_twice()
    assert book.place(1) == FIRST
    assert book.unproven(1.0) == {1: (FIRST, SECOND)}
    assert not book.conflicts


def test_who_does_not_tell_in_time_is_a_second_vehicle():
    book = met_twice()
    book.identify(version(7), FIRST)
    assert book.unproven(1.0 + PROOF_S) == {1: (FIRST, SECOND)}
    book.claim(1, FIRST, 3.5)
    book.claim(1, SECOND, 3.5)
    assert book.unproven(3.5) == {}
    assert "127.0.0.1:5001" in book.conflicts[1].message
    assert "127.0.0.1:5002" in book.conflicts[1].message


def test_one_uid_at_two_addresses_is_one_vehicle_on_two_links():
    book = met_twice()
    book.identify(version(7), FIRST)
    book.identify(version(7), SECOND)
    assert book.unproven(60.0) == {}
    assert not book.conflicts
    assert not book.claim(1, SECOND, 2.0), "its second copy of everything is not needed"
    assert book.claim(1, SECOND, 9.0), "until the first link is gone"


def test_different_uids_are_two_vehicles_at_once():
    book = met_twice()
    book.identify(version(7), FIRST)
    book.identify(version(8), SECOND)
    assert 1 in book.conflicts


def test_two_vehicles_behind_one_address_give_themselves_away():
    book = RoutingTable()
    book.claim(1, FIRST, 0.0)
    book.identify(version(7), FIRST)
    book.identify(version(7), FIRST)
    assert not book.conflicts
    book.identify(version(8), FIRST)
    assert "both at 127.0.0.1:5001" in book.conflicts[1].message


def test_an_empty_uid2_leaves_it_to_the_uid():
    book = met_twice()
    book.identify(version(0, uid=5), FIRST)
    book.identify(version(0, uid=5), SECOND)
    assert book.unproven(2.0) == {}
    book.identify(version(0), FIRST)  # says nothing
    assert not book.conflicts
    book.identify(version(0, uid=6), SECOND)
    assert 1 in book.conflicts


def test_a_vehicle_that_fell_silent_may_come_back_from_elsewhere():
    book = RoutingTable()
    assert book.claim(1, FIRST, 0.0)
    assert book.claim(1, SECOND, 4.0)
    assert book.place(1) == SECOND
    assert not book.unproven(4.0)
    assert not book.conflicts
