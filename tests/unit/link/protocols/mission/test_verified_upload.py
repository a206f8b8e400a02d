"""Deliveries to both autopilots' stores: equal, verified, or a typed error, whatever the link and the vehicle do."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.protocol_timers import STANDARD, RoundTripTimers
from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange, RttEstimator
from gcs.link.protocols.machine import MachineState
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.rules import MissionRefused
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.protocols.mission.verified_upload import VerifiedUpload
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import FenceCommand, MissionResult, MissionType
from gcs.mission.model import MissionItem
from tests.air import VEHICLE, Air, Weather, mission_of

BOTH = pytest.mark.parametrize("autopilot", [Autopilot.ARDUPILOT, Autopilot.PX4])
CALM = Weather(0.05, 0.0, 0.0, 0.0)
ITEMS = mission_of(20, seed=1)
OTHER = Station(250, 190)


def corners(count, told):
    params = (float(told), 0.0, 0.0, 0.0)
    return [MissionItem(FenceCommand.POLYGON_INCLUSION, 0, params, 10 * n, 7 * n * n, 0.0) for n in range(count)]


def addressed(name, source, **fields):
    target = {"target_system": VEHICLE.sysid, "target_component": VEHICLE.compid, "mission_type": 0}
    return Message(name, {**target, **fields}, *source)


@BOTH
@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32),
    st.sampled_from([0.0, 0.05, 0.2, 0.4, 0.8, 1.0]),
    st.sampled_from([0.0, 0.05, 0.4]),
    st.sampled_from([0.0, 0.02, 0.3]),
)
def test_what_is_believed_is_held(autopilot, seed, loss, round_trip_s, mischief):
    air = Air(autopilot, Weather(round_trip_s, loss, mischief, mischief), seed)
    arrived = air.deliver(mission_of(12, seed))
    assert arrived.error is None or isinstance(arrived.error, PeerError)
    assert arrived.held or arrived.error is not None
    assert arrived.error is None or loss > 0.2 or mischief > 0.1
    assert arrived.error is not None or loss < 1.0


@BOTH
def test_a_calm_link_costs_one_round_trip_per_item(autopilot):
    arrived = Air(autopilot, CALM, 0).deliver(mission_of(100, 0))
    assert arrived.error is None
    assert arrived.tries == 1
    assert arrived.sent_s <= 1.05 * 101 * CALM.round_trip_s
    assert arrived.messages_up == 1 + 100 + 1 + 100 + 1  # count, items, list, requests, acknowledgement


def test_ardupilot_is_read_several_items_at_a_time():
    arrived = Air(Autopilot.ARDUPILOT, CALM, 0).deliver(mission_of(100, 0))
    assert arrived.total_s - arrived.sent_s < 20 * CALM.round_trip_s


@BOTH
@pytest.mark.parametrize("loss", [0.05, 0.2, 0.4])
def test_losses_cost_less_than_waiting_for_the_vehicle_to_ask_again(autopilot, loss):
    arrived = Air(autopilot, Weather(0.05, loss), 3).deliver(mission_of(100, 0))
    assert arrived.error is None
    lost = 100 * (1 / (1 - loss) ** 2 - 1)  # round trips in vain
    assert arrived.sent_s < 101 * 0.05 + lost * 0.35


@BOTH
def test_an_empty_delivery_clears(autopilot):
    air = Air(autopilot, CALM, 0)
    assert air.shelf.items()
    arrived = air.deliver(())
    assert arrived.error is None
    assert air.shelf.items()[1:] == ()


@BOTH
def test_another_station_in_the_way_is_waited_for_and_named_if_it_stays(autopilot):
    air = Air(autopilot, CALM, 0)
    air.shelf.receive(addressed("MISSION_COUNT", OTHER, count=3), 0.0)
    arrived = air.deliver(ITEMS)  # the other one says no more: the vehicle forgets it after 5 or 8 s
    assert arrived.error is None
    assert arrived.total_s > STANDARD.mission.busy_s / 2
    air = Air(autopilot, CALM, 0)
    machine = VerifiedUpload(ITEMS, Exchange(VEHICLE, autopilot))
    machine.start(0.0)
    refusals, now_s = 0, 0.0
    while not machine.done:
        now_s = machine.deadline_s
        if [m.name for m in machine.tick(now_s)] == ["MISSION_COUNT"]:
            result = MissionResult.DENIED if autopilot is Autopilot.ARDUPILOT else MissionResult.ERROR
            ack = {"target_system": 255, "target_component": 190, "type": int(result), "mission_type": 0}
            machine.receive(Message("MISSION_ACK", ack, *VEHICLE), now_s)
            refusals += 1
    assert isinstance(machine.error, MissionRefused)
    assert refusals > 3


def begun(air, items, taken):
    """An upload of ours that broke off after so many items."""
    sender = MissionSender(items, Exchange(VEHICLE, estimates=False))
    (count,) = sender.start(0.0)
    (request,) = air.shelf.receive(said_by(count, GROUND), 0.0)
    for _ in range(taken):
        (item,) = sender.receive(said_by(request, VEHICLE), 0.0)
        (request,) = air.shelf.receive(said_by(item, GROUND), 0.0)


def said_by(message, station):
    return replace(message, sysid=station.sysid, compid=station.compid)


def test_a_mixed_mission_after_a_stall_is_found_and_mended():
    """ArduPilot keeps what came of a transfer that broke off, and the tail of the old mission behind it."""
    air = Air(Autopilot.ARDUPILOT, CALM, 0)
    old = air.shelf.items()
    new = mission_of(len(old), seed=5)
    begun(air, new, 4)
    air.now_s = 20.0
    air.shelf.tick(20.0)
    assert air.shelf.items()[3] == new[3]
    assert air.shelf.items()[4:] == old[4:]
    assert air.deliver(new).error is None
    assert compare_missions(new[1:], air.shelf.items()[1:], autopilot=Autopilot.ARDUPILOT) == []


@BOTH
def test_our_own_broken_upload_is_taken_up_again(autopilot):
    """PX4 calls a second MISSION_COUNT busy and goes on asking for the old items; ArduPilot begins anew."""
    air = Air(autopilot, CALM, 0)
    begun(air, ITEMS, 3)
    arrived = air.deliver(ITEMS)
    assert arrived.error is None
    assert arrived.held


@BOTH
@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (replace(ITEMS[1], command=9999), "UNSUPPORTED"),
        (replace(ITEMS[1], frame=99), "UNSUPPORTED_FRAME"),
    ],
)
def test_what_the_autopilot_does_not_take_is_refused_at_once_with_item_and_reason(autopilot, bad, reason):
    arrived = Air(autopilot, CALM, 0).deliver((*ITEMS[:7], bad, *ITEMS[8:]))
    assert isinstance(arrived.error, MissionRefused)
    assert arrived.error.seq == 7
    assert f"MAV_MISSION_{reason}" in arrived.error.message
    assert arrived.tries == 1


def test_what_px4_takes_and_cannot_mean_is_no_difference_and_what_it_changes_is():
    """PX4 accepts NaN altitudes: read back they are what was sent. That they cannot be flown, `gcs check` says."""
    nan = replace(ITEMS[1], alt_m=float("nan"))
    assert Air(Autopilot.PX4, CALM, 0).deliver((nan,)).error is None
    air = Air(Autopilot.PX4, CALM, 0)
    hold = air.shelf._hold
    air.shelf._hold = lambda kind, items: hold(kind, (*items[:2], items[3], *items[3:]) if items else items)
    arrived = air.deliver(ITEMS)
    assert "the mission read back from vehicle 3 differs from what was sent: item 2: " in str(arrived.error)
    assert arrived.tries > 1


@BOTH
def test_fences_and_rally_points_are_delivered_the_same_way(autopilot):
    air = Air(autopilot, Weather(0.02, 0.2), 1)
    polygon = [
        MissionItem(FenceCommand.POLYGON_INCLUSION, 0, (4.0, 0.0, 0.0, 0.0), 10 * n, 7 * n * n, 0.0) for n in range(4)
    ]
    rally = [MissionItem(FenceCommand.RALLY_POINT, 3, (0.0,) * 4, 10, 10, 20.0)]
    for kind, items in ((MissionType.FENCE, polygon), (MissionType.RALLY, rally)):
        machine = run(air, VerifiedUpload(items, Exchange(VEHICLE, autopilot), mission_type=kind))
        assert machine.error is None
        assert [(i.lat_degE7, i.params[0]) for i in air.shelf.items(kind)] == [
            (i.lat_degE7, i.params[0]) for i in items
        ]


def test_a_fence_of_a_wrong_shape_is_not_believed_on_either():
    """ArduPilot refuses it; PX4 accepts it, stores it, and says later that it is invalid: nothing of that is hidden."""
    polygon = [
        MissionItem(FenceCommand.POLYGON_INCLUSION, 0, (5.0, 0.0, 0.0, 0.0), 10 * n, 7 * n * n, 0.0) for n in range(4)
    ]
    air = Air(Autopilot.ARDUPILOT, CALM, 1)
    machine = run(air, VerifiedUpload(polygon, Exchange(VEHICLE, Autopilot.ARDUPILOT), mission_type=MissionType.FENCE))
    assert isinstance(machine.error, MissionRefused)
    assert machine.error.result == MissionResult.ERROR


def run(air, machine):
    air._send(machine.start(air.now_s), GROUND)
    while not machine.done:
        air._step(machine)
    return machine


@BOTH
def test_nobody_there_ends_in_one_patience(autopilot):
    arrived = Air(autopilot, Weather(0.0, 1.0), 0).deliver(ITEMS)
    assert isinstance(arrived.error, PeerTimeout)
    assert arrived.tries == 1
    assert arrived.total_s < 10.0
    assert "first mission item" in arrived.error.message


def test_cancelling_tells_the_vehicle_and_claims_nothing():
    machine = VerifiedUpload(ITEMS, Exchange(VEHICLE, Autopilot.PX4))
    machine.start(0.0)
    (told,) = machine.cancel()
    assert told.fields["type"] == MissionResult.OPERATION_CANCELLED
    assert machine.state is MachineState.FAILED
    assert machine.cancel() == []
    assert machine.tick(1.0) == machine.receive(told, 1.0) == []
    with pytest.raises(ProtocolMisuse):
        machine.start(2.0)


def test_a_copy_of_the_count_does_not_begin_a_download_anew():
    receiver = MissionReceiver(Exchange(VEHICLE))
    receiver.start(0.0)
    count = Message(
        "MISSION_COUNT", {"target_system": 255, "target_component": 190, "count": 2, "mission_type": 0}, *VEHICLE
    )
    assert len(receiver.receive(count, 0.1)) == 1
    assert receiver.receive(count, 0.2) == []


def test_round_trips_are_learned_and_bound():
    trip = RttEstimator(RoundTripTimers(least_s=0.03, most_s=1.5, first_s=0.5))
    assert trip.mean_s is None
    assert trip.wait_s() == 0.5
    for _ in range(100):
        trip.learn(0.2)
    assert trip.mean_s == pytest.approx(0.2)
    assert trip.wait_s() == pytest.approx(0.23, abs=0.005)
    assert trip.wait_s(1) > trip.wait_s()
    assert trip.wait_s(50) <= 1.3 * trip.wait_s() + 1e-9
    for _ in range(100):
        trip.learn(5.0)
    assert trip.wait_s(9) == 1.5
    for _ in range(100):
        trip.learn(0.0)
    assert trip.wait_s() >= 0.03
