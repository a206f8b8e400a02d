"""The address of each system id: one vehicle that moves or has two links, and two vehicles with one id."""

from gcs.link.session.routing_table import IDENTIFY_S, MOST_CANDIDATES, PROVE_S, LinkAddress, RoutingTable
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


def known_then_frozen(uid2=7):
    table = RoutingTable()
    table.accept(1, FIRST, 0.0)
    if uid2:
        table.identify(version(uid2), FIRST)
    table.freeze()
    return table


def spoof(table, address, from_s, to_s, *, uid2=None):
    accepted = []
    for tick in range(round(from_s * 100), round(to_s * 100)):
        accepted.append(table.accept(1, address, tick / 100))
        if uid2 is not None:
            table.identify(version(uid2), address)
    return any(accepted)


def test_in_a_flight_an_address_changes_only_with_the_same_id():
    for uid2 in (None, 0, 8):
        table = known_then_frozen()
        assert not spoof(table, SECOND, 1.0, 30.0, uid2=uid2)
        assert table.address(1) == FIRST
        assert not table.conflicts, "nobody has time for a conflict now"
        assert table.claims(30.0) == {1: SECOND}
        assert table.unidentified(30.0) == {1: (FIRST, SECOND)}, "it is asked for as long as the first one is silent"
    table = known_then_frozen()
    assert not spoof(table, SECOND, 1.0, 3.0, uid2=7), "not while the first one may still be heard"
    assert spoof(table, SECOND, 3.0, 4.0, uid2=7)
    (move,) = table.moves
    assert (move.sysid, move.before, move.now) == (1, FIRST, SECOND)
    assert "same id" in move.proof
    assert table.claims(30.0) == {}
    assert table.knows(SECOND)
    assert not table.knows(FIRST)


def test_in_a_flight_a_vehicle_that_reports_no_id_never_moves():
    table = known_then_frozen(uid2=0)
    assert not table.is_identified(1)
    assert not spoof(table, SECOND, 1.0, 60.0, uid2=9)
    assert table.address(1) == FIRST


def test_a_signature_is_a_proof_once_the_first_address_is_silent():
    table = known_then_frozen(uid2=0)
    assert not table.accept(1, SECOND, 1.0, signed=True)
    assert table.accept(1, SECOND, 4.0, signed=True)
    assert "signed" in table.moves[0].proof


def test_before_a_flight_a_known_vehicle_needs_proof_too():
    table = RoutingTable()
    table.accept(1, FIRST, 0.0)
    table.identify(version(7), FIRST)
    assert not spoof(table, SECOND, 4.0, 6.0)
    assert not table.conflicts
    assert table.unidentified(7.0) == {1: (FIRST, SECOND)}, "a restarted vehicle answers late"
    table.identify(version(7), SECOND)
    assert table.accept(1, SECOND, 7.0)
    table = RoutingTable()
    table.accept(1, FIRST, 0.0)
    table.identify(version(7), FIRST)
    assert not spoof(table, SECOND, 4.0, 4.0 + PROVE_S + 0.1)
    assert table.unidentified(4.1 + PROVE_S) == {}
    assert 1 in table.conflicts


def test_what_a_crowd_of_addresses_may_fill_is_bounded_and_the_vehicle_finds_room():
    table = known_then_frozen()
    for n in range(2_000):
        table.accept(1, LinkAddress(0, ("10.0.0.9", n)), 1.0 + n / 1e3)
    assert len(table._routes[1].candidates) == MOST_CANDIDATES
    assert len(table._users) == 1
    for tick in range(400, 1_000):
        table.accept(1, LinkAddress(0, ("10.0.0.9", tick)), tick / 100)
        table.accept(1, SECOND, tick / 100)
        table.identify(version(7), SECOND)
    assert table.address(1) == SECOND


def test_a_single_frame_with_another_system_id_is_no_second_vehicle():
    """A damaged frame may have a right checksum by chance: it is asked for its id, and forgotten."""
    table = met_twice()
    table.identify(version(7), FIRST)
    for tenths in range(11, 60):
        now_s = tenths / 10
        table.accept(1, FIRST, now_s)
        table.unidentified(now_s)
    assert table.conflicts == {}
    assert table.unidentified(6.0) == {}
