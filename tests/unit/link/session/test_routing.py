"""The address of each system id: one vehicle that moves or has two links, and two vehicles with one id."""

from gcs.link.session.routing import IDENTIFY_S, LinkAddress, RoutingTable
from gcs.link.wire.message import Message

FIRST, SECOND = LinkAddress(0, ("127.0.0.1", 5001)), LinkAddress(0, ("127.0.0.1", 5002))


def version(uid2, sysid=1, uid=0):
    return Message("AUTOPILOT_VERSION", {"uid2": [uid2] + [0] * 17, "uid": uid}, sysid, 1)


def met_twice():
    table = RoutingTable()
    assert table.accept(1, FIRST, 0.0)
    assert not table.accept(1, SECOND, 1.0)
    return table


def test_each_system_is_answered_at_its_own_address():
    table = RoutingTable()
    assert table.accept(1, FIRST, 0.0)
    assert table.accept(2, SECOND, 0.0)
    assert table.address(1) == FIRST
    assert table.address(2) == SECOND
    assert table.address(3) is None
    assert table.addresses() == {FIRST, SECOND}


def test_two_addresses_with_one_id_are_asked_who_they_are():
    table = met_twice()
    assert table.address(1) == FIRST
    assert table.unidentified(1.0) == {1: (FIRST, SECOND)}
    assert not table.conflicts


def test_who_does_not_tell_in_time_is_a_second_vehicle():
    table = met_twice()
    table.identify(version(7), FIRST)
    assert table.unidentified(1.0 + IDENTIFY_S) == {1: (FIRST, SECOND)}
    table.accept(1, FIRST, 3.5)
    table.accept(1, SECOND, 3.5)
    assert table.unidentified(3.5) == {}
    assert "127.0.0.1:5001" in table.conflicts[1].message
    assert "127.0.0.1:5002" in table.conflicts[1].message


def test_one_uid_at_two_addresses_is_one_vehicle_on_two_links():
    table = met_twice()
    table.identify(version(7), FIRST)
    table.identify(version(7), SECOND)
    assert table.unidentified(60.0) == {}
    assert not table.conflicts
    assert not table.accept(1, SECOND, 2.0), "its second copy of everything is not needed"
    assert table.accept(1, SECOND, 9.0), "until the first link is gone"


def test_different_uids_are_two_vehicles_at_once():
    table = met_twice()
    table.identify(version(7), FIRST)
    table.identify(version(8), SECOND)
    assert 1 in table.conflicts


def test_two_vehicles_behind_one_address_give_themselves_away():
    table = RoutingTable()
    table.accept(1, FIRST, 0.0)
    table.identify(version(7), FIRST)
    table.identify(version(7), FIRST)
    assert not table.conflicts
    table.identify(version(8), FIRST)
    assert "both at 127.0.0.1:5001" in table.conflicts[1].message


def test_an_empty_uid2_leaves_it_to_the_uid():
    table = met_twice()
    table.identify(version(0, uid=5), FIRST)
    table.identify(version(0, uid=5), SECOND)
    assert table.unidentified(2.0) == {}
    table.identify(version(0), FIRST)  # says nothing
    assert not table.conflicts
    table.identify(version(0, uid=6), SECOND)
    assert 1 in table.conflicts


def test_a_vehicle_that_fell_silent_may_come_back_from_elsewhere():
    table = RoutingTable()
    assert table.accept(1, FIRST, 0.0)
    assert table.accept(1, SECOND, 4.0)
    assert table.address(1) == SECOND
    assert not table.unidentified(4.0)
    assert not table.conflicts
