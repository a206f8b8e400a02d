"""The table of docs/flying.md, row by row: what happened, and what everybody is told."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.flight.contingency.detection import Incident, IncidentKind
from gcs.flight.contingency.policy import (
    AGAIN_S,
    CLEAR_S,
    Action,
    Choices,
    ContingencyPolicy,
    OnLeaderLoss,
    OnLoss,
    Order,
    State,
)

FOUR = (1, 2, 3, 4)


def director(**choices: object) -> ContingencyPolicy:
    return ContingencyPolicy(FOUR, 1, Choices(**choices))  # type: ignore[arg-type]


def told(orders: list[Order]) -> dict[int, Action]:
    return {order.sysid: order.action for order in orders}


def test_a_lost_link_changes_nothing_yet() -> None:
    ours = director()
    assert ours.take(Incident(IncidentKind.LINK_LOST, 2, 10.0)) == []
    assert ours.states[2] is State.SILENT
    assert ours.in_formation == FOUR


def test_who_is_heard_again_in_its_place_flies_on() -> None:
    ours = director()
    ours.take(Incident(IncidentKind.LINK_LOST, 2, 10.0))
    assert told(ours.take(Incident(IncidentKind.LINK_BACK, 2, 12.0))) == {2: Action.REJOIN}
    assert ours.states[2] is State.FLYING
    assert ours.troubles == []


def test_who_is_heard_again_elsewhere_goes_home() -> None:
    ours = director()
    ours.take(Incident(IncidentKind.LINK_LOST, 2, 10.0))
    assert told(ours.take(Incident(IncidentKind.LINK_BACK, 2, 12.0, usable=False))) == {2: Action.RETURN}
    assert ours.in_formation == (1, 3, 4)


@pytest.mark.parametrize(
    ("choice", "action"), [(OnLoss.LAND, Action.LAND), (OnLoss.RETURN, Action.RETURN), (OnLoss.CONTINUE, None)]
)
def test_a_lost_vehicle(choice: OnLoss, action: Action | None) -> None:
    ours = director(on_loss=choice)
    ours.take(Incident(IncidentKind.LINK_LOST, 2, 10.0))
    orders = ours.take(Incident(IncidentKind.VEHICLE_LOST, 2, 17.0))
    assert told(orders) == ({} if action is None else dict.fromkeys((1, 3, 4), action))
    assert ours.states[2] is State.LOST
    assert [t.sysid for t in ours.troubles] == [2]
    assert told(ours.take(Incident(IncidentKind.LINK_BACK, 2, 40.0))) == {2: Action.RETURN}


def test_a_lost_leader_is_replaced_by_the_next() -> None:
    ours = director(follow=True)
    ours.take(Incident(IncidentKind.LINK_LOST, 2, 9.0))
    assert told(ours.take(Incident(IncidentKind.VEHICLE_LOST, 1, 17.0))) == {3: Action.PROMOTE}  # 2 is not heard
    assert ours.leader == 3
    assert ours.in_formation == (2, 3, 4)


def test_without_a_leader_all_may_go_home() -> None:
    ours = director(follow=True, on_leader_loss=OnLeaderLoss.RETURN)
    assert told(ours.take(Incident(IncidentKind.VEHICLE_LOST, 1, 17.0))) == dict.fromkeys((2, 3, 4), Action.RETURN)


def test_nobody_leads_where_nobody_follows() -> None:
    ours = director(on_loss=OnLoss.CONTINUE)
    assert ours.take(Incident(IncidentKind.VEHICLE_LOST, 1, 17.0)) == []


def test_a_leader_with_a_low_battery_goes_home_and_another_leads() -> None:
    ours = director(follow=True)
    orders = ours.take(Incident(IncidentKind.BATTERY_LOW, 1, 5.0))
    assert [(o.sysid, o.action) for o in orders] == [(1, Action.RETURN), (2, Action.PROMOTE)]


@pytest.mark.parametrize(
    ("kind", "action"),
    [
        (IncidentKind.BATTERY_LOW, Action.RETURN),
        (IncidentKind.FENCE, Action.RETURN),
        (IncidentKind.BATTERY_CRITICAL, Action.LAND),
        (IncidentKind.GNSS_GONE, Action.LAND),
        (IncidentKind.MODE_LEFT, Action.LEAVE),
    ],
)
def test_one_leaves_the_others_fly_on(kind: IncidentKind, action: Action) -> None:
    ours = director()
    (order,) = ours.take(Incident(kind, 3, 5.0))
    assert (order.sysid, order.action) == (3, action)
    assert ours.in_formation == (1, 2, 4)
    assert [t.kind for t in ours.troubles] == [kind]


def test_a_short_outage_of_gnss_is_flown_through() -> None:
    ours = director()
    assert ours.take(Incident(IncidentKind.GNSS_LOST, 3, 5.0)) == []
    assert ours.take(Incident(IncidentKind.GNSS_BACK, 3, 9.0)) == []
    assert ours.states[3] is State.FLYING


def test_a_critical_battery_ends_a_return() -> None:
    ours = director()
    ours.take(Incident(IncidentKind.BATTERY_LOW, 3, 5.0))
    assert told(ours.take(Incident(IncidentKind.BATTERY_CRITICAL, 3, 50.0))) == {3: Action.LAND}
    assert ours.take(Incident(IncidentKind.MODE_LEFT, 3, 51.0)) == []


def conflict(at_s: float, in_s: float, pair: tuple[int, int] = (3, 2)) -> Incident:
    return Incident(IncidentKind.CONFLICT, pair[0], at_s, "0.2 m", other=pair[1], in_s=in_s)


def test_conflicts_escalate_hold_spread_land() -> None:
    ours = director()
    assert told(ours.take(conflict(10.0, 2.5))) == {3: Action.HOLD}
    assert ours.take(conflict(10.0 + AGAIN_S / 2, 2.0)) == []  # it gets time to work
    assert told(ours.take(conflict(12.5, 1.0))) == {3: Action.SPREAD}
    assert ours.take(conflict(15.0, 0.5)) == []  # it is still climbing
    assert told(ours.take(conflict(16.6, 0.5))) == {3: Action.LAND}
    assert ours.in_formation == (1, 2, 4)


def test_with_no_time_to_brake_the_upper_one_climbs() -> None:
    assert told(director().take(conflict(10.0, 0.5), higher=True)) == {3: Action.SPREAD}
    assert told(director().take(conflict(10.0, 0.5), higher=False)) == {2: Action.SPREAD}


def test_who_has_left_gives_way_to_the_formation() -> None:
    ours = director()
    ours.take(Incident(IncidentKind.BATTERY_LOW, 2, 5.0))
    orders = ours.take(conflict(10.0, 2.5), higher=False)
    assert told(orders) == {2: Action.LAND}  # it is on its way home already, below others, and there is no other way


def test_the_leader_gives_way_last() -> None:
    assert told(director().take(conflict(10.0, 2.5, pair=(1, 4)))) == {4: Action.HOLD}


def test_who_gave_way_goes_home_when_it_is_clear() -> None:
    ours = director()
    ours.take(conflict(10.0, 2.5))
    assert ours.clear(10.0 + CLEAR_S - 0.1) == []
    assert told(ours.clear(10.0 + CLEAR_S + 0.1)) == {3: Action.RETURN}
    assert ours.clear(99.0) == []


incidents = st.builds(
    Incident,
    st.sampled_from(list(IncidentKind)),
    st.sampled_from(FOUR),
    st.just(0.0),
    usable=st.booleans(),
    in_s=st.floats(0.0, 3.0),
)


@given(
    st.lists(incidents, max_size=25), st.booleans(), st.sampled_from(list(OnLoss)), st.sampled_from(list(OnLeaderLoss))
)
def test_whatever_happens(story: list[Incident], follow: bool, loss: OnLoss, leader_loss: OnLeaderLoss) -> None:
    """Nobody returns to the formation who was ordered out of it; whoever leads flies; who was lost is not ordered."""
    ours = ContingencyPolicy(FOUR, 1, Choices(loss, leader_loss, follow))
    out: set[int] = set()
    for n, event in enumerate(story):
        other = event.sysid % 4 + 1
        incident = Incident(event.kind, event.sysid, float(n), other=other, in_s=event.in_s, usable=event.usable)
        orders = ours.take(incident) + ours.clear(float(n))
        for order in orders:
            if order.action not in (Action.PROMOTE, Action.REJOIN):
                out.add(order.sysid)
            assert ours.states[order.sysid] is not State.LOST
        assert not out & set(ours.in_formation)
        for order in orders:
            if order.action is Action.PROMOTE:
                assert order.sysid == ours.leader
                assert order.sysid in ours.in_formation
