"""The contingency policy: every row of its table, every pair of state and incident, and what follows from them."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.flight.contingency.choices import Choices, OnLeaderLoss, OnLoss
from gcs.flight.contingency.decisions import ContingencyPolicy, applying_row
from gcs.flight.contingency.detection import DETECTED, Incident, IncidentKind
from gcs.flight.contingency.energy_choice import Outcome
from gcs.flight.contingency.policy import (
    AGAIN_S,
    CLEAR_S,
    IN_FORMATION,
    MEANING,
    Action,
    Order,
    Row,
    Situation,
    State,
    Trigger,
)
from gcs.flight.contingency.policy_rows import POLICY
from gcs.flight.monitoring.progress import AskedOrder

FOUR = (1, 2, 3, 4)
FINAL = frozenset({State.LANDING, State.LEFT, State.LOST})
OUTCOMES = (None, *Outcome)


def fleet(**choices: object) -> ContingencyPolicy:
    return ContingencyPolicy(FOUR, 1, Choices(**choices))  # type: ignore[arg-type]


def ordered(orders: list[Order]) -> dict[int, Action]:
    return {order.sysid: order.action for order in orders}


def situations() -> list[Situation]:
    """A vehicle and another one in every state, with every choice and every value that a condition looks at."""
    choices = [Choices(a, b, follow=True) for a, b in product(OnLoss, OnLeaderLoss)] + [Choices(own_missions=True)]
    return [
        Situation(
            {2: mine, 3: other},
            choice,
            2,
            2,
            3,
            in_s,
            usable,
            acting=frozenset({3} if acting else ()),
            clear=(2, 3),
            asked=(2,),
        )
        for mine, other in product(State, State)
        for choice, in_s, usable, acting in product(choices, (0.5, 2.5), (False, True), (False, True))
    ] + [
        Situation({2: mine, 3: State.FLYING}, Choices(), 3, 2, 3, outcome=outcome, takeable=takeable, ours=ours)
        for mine, outcome, takeable, ours in product(State, OUTCOMES, (False, True), (False, True))
    ]


SITUATIONS = situations()


@pytest.mark.parametrize("row", POLICY, ids=lambda row: f"{row.trigger}: {row.rule}")
def test_every_row_is_reached_and_done(row: Row) -> None:
    found = [(now, applying_row(row.trigger, now)) for now in SITUATIONS]
    reached = [(now, vehicles) for now, (first, vehicles) in found if first is row]
    assert reached, "an earlier row always applies"
    for now, vehicles in reached:
        assert row.when.true(now)
        assert {now.states[i] for i in vehicles} <= row.states
    if isinstance(row.trigger, IncidentKind):
        now, vehicles = reached[0]
        ours = ContingencyPolicy((2, 3), 2, replace(now.choices, on_loss=OnLoss.CONTINUE, follow=False))
        ours.states.update(now.states)
        ours._ordered_s.update({2: 0.0, 3: 0.0} | dict.fromkeys(now.acting, 100.0))
        ours._conflict_s.update({2: 0.0, 3: 0.0})
        incident = Incident(
            *(row.trigger, 2, 100.0, "1 m", 3, now.in_s, now.usable),
            outcome=now.outcome,
            takeable=now.takeable,
            ours=now.ours,
            higher=now.first_is_upper,
        )
        orders = ours.take(incident)
        assert all(ours.states[i] == (row.after or now.states[i]) for i in vehicles)
        others = {i for i in (2, 3) if now.states[i] is State.STARTING} if State.STARTING in row.states else set()
        own = [order for order in orders if order.sysid not in others - set(vehicles)]
        assert ordered(own) == ({} if row.action is None else dict.fromkeys(vehicles, row.action))
        assert all(order.rule.startswith(row.rule) for order in own)


@pytest.mark.parametrize(("kind", "state"), list(product(IncidentKind, State)))
def test_every_incident_in_every_state_has_an_outcome(kind: IncidentKind, state: State) -> None:
    for now in SITUATIONS:
        if now.states[2] is state:
            row, _ = applying_row(kind, now)
            assert row is not None


# What is right for one vehicle in each state, by hand, in the order of `State`: starting, flying, silent, holding,
# spread, returning, landing, left, lost, waiting. A letter is an order with the state that follows from it.
LETTERS = {
    ".": (None, None),
    "s": (None, State.SILENT),
    "x": (None, State.LOST),
    "H": (Action.HOLD, State.HOLDING),
    "W": (Action.HOLD, State.WAITING),
    "C": (Action.SPREAD, State.SPREAD),
    "R": (Action.RETURN, State.RETURNING),
    "D": (Action.DIVERT, State.RETURNING),
    "L": (Action.LAND, State.LANDING),
    "P": (Action.LEAVE, State.LEFT),
    "J": (Action.REJOIN, State.FLYING),
    "O": (Action.OBEY, None),
}
_K, _O = IncidentKind, Outcome
ANSWERS: list[tuple[IncidentKind, dict[str, object], str]] = [
    (_K.LINK_LOST, {}, ".s........"),
    (_K.LINK_BACK, {}, "..J.....R."),
    (_K.LINK_BACK, {"usable": False}, "..R.....R."),
    (_K.VEHICLE_LOST, {}, "xxxxxxxxxx"),
    (_K.GNSS_LOST, {}, ".........."),
    (_K.GNSS_BACK, {}, ".........."),
    (_K.GNSS_GONE, {}, "LLLLLL...L"),
    (_K.BATTERY_LOW, {"outcome": _O.FINISH}, "L........L"),
    (_K.BATTERY_LOW, {"outcome": _O.NEAREST}, "LDD......D"),
    (_K.BATTERY_LOW, {"outcome": _O.RETURN}, "LRR......R"),
    (_K.BATTERY_LOW, {"outcome": _O.LAND}, "LLL......L"),
    (_K.BATTERY_LOW, {}, "LLL......L"),
    (_K.BATTERY_CRITICAL, {"outcome": _O.FINISH}, "L..LL....L"),  # who yielded has left the plan that it could finish
    (_K.BATTERY_CRITICAL, {"outcome": _O.NEAREST}, "LDDDDD...D"),
    (_K.BATTERY_CRITICAL, {"outcome": _O.RETURN}, "LRRRRR...R"),
    (_K.BATTERY_CRITICAL, {"outcome": _O.LAND}, "LLLLLL...L"),
    (_K.BATTERY_CRITICAL, {}, "LLLLLL...L"),
    (_K.FENCE, {}, "LRR......R"),
    (_K.FAILSAFE, {}, "LRRRRRL..R"),
    (_K.FAILSAFE, {"outcome": _O.FINISH}, "LRRRRRL..R"),
    (_K.FAILSAFE, {"outcome": _O.NEAREST}, "LDDDDDL..D"),
    (_K.FAILSAFE, {"outcome": _O.LAND}, "LLLLLLL..L"),
    (_K.FAILSAFE, {"takeable": False}, "LLLLLLL..L"),
    (_K.FAILSAFE, {"takeable": False, "outcome": _O.NEAREST}, "LLLLLLL..L"),
    (_K.FAILSAFE, {"ours": True}, "OORRRRL..R"),
    (_K.FAILSAFE, {"ours": True, "takeable": False}, "LLLLLLL..L"),
    (_K.MODE_LEFT, {}, "PPPPPPP..P"),
    (_K.STRANDED, {}, ".JR......."),
    (_K.STRANDED, {"usable": False}, ".RR......."),
    (_K.CONFLICT, {"in_s": 2.5}, "LH.CLL...C"),  # the other one lands already
    (_K.CONFLICT, {"in_s": 0.5}, "LC.CLL...C"),
]
TRIGGERED: list[tuple[str, Choices, str]] = [
    ("not obeyed", Choices(), "...LLL...L"),
    ("hold", Choices(), ".WWWWW...."),
    ("land", Choices(), ".LLLLL...L"),
    ("return", Choices(), ".RRRR....R"),
    ("continue", Choices(), ".........J"),
    ("other lost", Choices(OnLoss.LAND), ".LL......."),
    ("other lost", Choices(OnLoss.RETURN), ".RR......."),
    ("other lost", Choices(OnLoss.CONTINUE), ".........."),
    ("leader lost", Choices(follow=True, on_leader_loss=OnLeaderLoss.RETURN), ".RR......."),
    ("other in trouble before T0", Choices(), "L........."),
    ("clear", Choices(), "...RR....."),
]


def assert_answer(ours: ContingencyPolicy, state: State, orders: list[Order], letter: str) -> None:
    action, to = LETTERS[letter]
    assert ordered(orders).get(3) is action
    assert ours.states[3] is (to or state)


@pytest.mark.parametrize(("kind", "values", "letters"), ANSWERS)
def test_each_state_has_the_answer_worked_by_hand(kind: IncidentKind, values: dict[str, object], letters: str) -> None:
    for state, letter in zip(State, letters, strict=True):
        ours = fleet(on_loss=OnLoss.CONTINUE)
        ours.states[3] = state
        ours._ordered_s[3] = ours._conflict_s[3] = 0.0
        if kind is IncidentKind.CONFLICT:
            ours.states[2] = State.LANDING
        orders = ours.take(Incident(kind, 3, 100.0, other=2, **values))  # type: ignore[arg-type]
        assert_answer(ours, state, orders, letter)
        assert set(ordered(orders)) <= {3}


@pytest.mark.parametrize(("trigger", "choices", "letters"), TRIGGERED)
def test_each_state_has_the_answer_to_what_befalls_others(trigger: str, choices: Choices, letters: str) -> None:
    for state, letter in zip(State, letters, strict=True):
        ours = ContingencyPolicy(FOUR, 1, choices)
        ours.states[3] = state
        ours._ordered_s[3] = ours._conflict_s[3] = 0.0
        if trigger == "not obeyed":
            orders = ours.not_obeyed(3, 100.0)
        elif trigger in list(AskedOrder):
            ours.states.update({1: State.LANDING, 2: State.LEFT, 4: State.LOST} if trigger == "continue" else {})
            could = ours.asked(AskedOrder(trigger), (3,))
            orders = ours.ask(AskedOrder(trigger), (3,), 100.0)
            assert could == tuple(ordered(orders))
        elif trigger == "clear":
            orders = ours.clear(100.0)
        elif trigger == "other in trouble before T0":
            ours.states[2] = State.STARTING
            orders = ours.take(Incident(IncidentKind.GNSS_GONE, 2, 100.0))
        else:
            orders = ours.take(Incident(IncidentKind.VEHICLE_LOST, 1 if trigger == "leader lost" else 2, 100.0))
        assert_answer(ours, state, orders, letter)


def test_every_state_and_incident_is_explained() -> None:
    assert list(MEANING) == list(State)
    assert list(DETECTED) == list(IncidentKind)
    assert {row.trigger for row in POLICY} == {*IncidentKind, *Trigger}


def test_a_vehicle_that_left_or_is_lost_gets_one_order_alone() -> None:
    (row,) = (row for row in POLICY if row.action is not None and row.states & {State.LEFT, State.LOST})
    assert row.trigger is IncidentKind.LINK_BACK
    assert row.states & FINAL == {State.LOST}
    assert row.action is Action.RETURN


def test_a_landing_is_never_left_for_anything_but_a_pilot() -> None:
    for row in POLICY:
        if State.LANDING in row.states and row.action is not None:
            assert row.action in (Action.LAND, Action.LEAVE)
            assert row.after in (State.LANDING, State.LEFT)


def test_a_vehicle_is_left_for_a_pilot_alone() -> None:
    assert {row.trigger for row in POLICY if row.after is State.LEFT} == {IncidentKind.MODE_LEFT}


def test_a_lost_link_changes_nothing_yet() -> None:
    ours = fleet()
    assert ours.take(Incident(IncidentKind.LINK_LOST, 2, 10.0)) == []
    assert ours.states[2] is State.SILENT
    assert ours.in_formation == FOUR


def test_a_vehicle_heard_again_in_its_place_rejoins() -> None:
    ours = fleet()
    ours.take(Incident(IncidentKind.LINK_LOST, 2, 10.0))
    assert ordered(ours.take(Incident(IncidentKind.LINK_BACK, 2, 12.0))) == {2: Action.REJOIN}
    assert ours.states[2] is State.FLYING
    assert ours.troubles == []


def test_a_vehicle_heard_again_elsewhere_returns() -> None:
    ours = fleet()
    ours.take(Incident(IncidentKind.LINK_LOST, 2, 10.0))
    assert ordered(ours.take(Incident(IncidentKind.LINK_BACK, 2, 12.0, usable=False))) == {2: Action.RETURN}
    assert ours.in_formation == (1, 3, 4)


@pytest.mark.parametrize(
    ("choice", "action"),
    [(OnLoss.LAND, Action.LAND), (OnLoss.RETURN, Action.RETURN), (OnLoss.CONTINUE, None), (OnLoss.CLOSE, None)],
)
def test_a_lost_vehicle(choice: OnLoss, action: Action | None) -> None:
    ours = fleet(on_loss=choice)
    ours.take(Incident(IncidentKind.LINK_LOST, 2, 10.0))
    orders = ours.take(Incident(IncidentKind.VEHICLE_LOST, 2, 17.0))
    assert ordered(orders) == ({} if action is None else dict.fromkeys((1, 3, 4), action))
    assert ours.states[2] is State.LOST
    assert [t.sysid for t in ours.troubles] == [2]
    assert ordered(ours.take(Incident(IncidentKind.LINK_BACK, 2, 40.0))) == {2: Action.RETURN}


def test_the_others_land_if_no_plan_without_the_lost_one_was_found() -> None:
    ours = fleet(on_loss=OnLoss.CLOSE)
    ours.take(Incident(IncidentKind.VEHICLE_LOST, 2, 17.0))
    assert ordered(ours.ranks_stay_open(18.0)) == dict.fromkeys((1, 3, 4), Action.LAND)


def test_a_lost_leader_is_replaced_by_the_next() -> None:
    ours = fleet(follow=True)
    ours.take(Incident(IncidentKind.LINK_LOST, 2, 9.0))
    assert ordered(ours.take(Incident(IncidentKind.VEHICLE_LOST, 1, 17.0))) == {3: Action.PROMOTE}  # 2 is not heard
    assert ours.leader == 3
    assert ours.in_formation == (2, 3, 4)


def test_without_a_leader_all_may_return() -> None:
    ours = fleet(follow=True, on_leader_loss=OnLeaderLoss.RETURN)
    assert ordered(ours.take(Incident(IncidentKind.VEHICLE_LOST, 1, 17.0))) == dict.fromkeys((2, 3, 4), Action.RETURN)


def test_no_vehicle_leads_without_followers() -> None:
    ours = fleet(on_loss=OnLoss.CONTINUE)
    assert ours.take(Incident(IncidentKind.VEHICLE_LOST, 1, 17.0)) == []


def test_a_leader_with_a_low_battery_returns_and_another_leads() -> None:
    ours = fleet(follow=True)
    orders = ours.take(Incident(IncidentKind.BATTERY_LOW, 1, 5.0, outcome=Outcome.RETURN))
    assert [(o.sysid, o.action) for o in orders] == [(1, Action.RETURN), (2, Action.PROMOTE)]


@pytest.mark.parametrize(
    ("kind", "outcome", "action"),
    [
        (IncidentKind.BATTERY_LOW, Outcome.RETURN, Action.RETURN),
        (IncidentKind.BATTERY_LOW, Outcome.NEAREST, Action.DIVERT),
        (IncidentKind.BATTERY_LOW, Outcome.LAND, Action.LAND),
        (IncidentKind.FENCE, None, Action.RETURN),
        (IncidentKind.BATTERY_CRITICAL, Outcome.LAND, Action.LAND),
        (IncidentKind.BATTERY_CRITICAL, Outcome.NEAREST, Action.DIVERT),
        (IncidentKind.GNSS_GONE, None, Action.LAND),
        (IncidentKind.FAILSAFE, None, Action.RETURN),
        (IncidentKind.MODE_LEFT, None, Action.LEAVE),
    ],
)
def test_one_leaves_the_others_fly_on(kind: IncidentKind, outcome: Outcome | None, action: Action) -> None:
    ours = fleet()
    (order,) = ours.take(Incident(kind, 3, 5.0, outcome=outcome))
    assert (order.sysid, order.action) == (3, action)
    assert ours.in_formation == (1, 2, 4)
    assert [t.kind for t in ours.troubles] == [kind]


def test_a_short_outage_of_gnss_is_flown_through() -> None:
    ours = fleet()
    assert ours.take(Incident(IncidentKind.GNSS_LOST, 3, 5.0)) == []
    assert ours.take(Incident(IncidentKind.GNSS_BACK, 3, 9.0)) == []
    assert ours.states[3] is State.FLYING


@pytest.mark.parametrize("kind", [IncidentKind.BATTERY_LOW, IncidentKind.BATTERY_CRITICAL])
def test_a_low_battery_that_lasts_for_the_rest_of_the_plan_changes_nothing(kind: IncidentKind) -> None:
    ours = fleet()
    assert ours.take(Incident(kind, 3, 5.0, outcome=Outcome.FINISH)) == []
    assert ours.in_formation == FOUR
    assert ours.troubles == []


def test_a_critical_battery_ends_a_return_that_it_does_not_last_for() -> None:
    ours = fleet()
    ours.take(Incident(IncidentKind.BATTERY_LOW, 3, 5.0, outcome=Outcome.RETURN))
    assert ours.take(Incident(IncidentKind.BATTERY_CRITICAL, 3, 50.0, outcome=Outcome.FINISH)) == []
    orders = ours.take(Incident(IncidentKind.BATTERY_CRITICAL, 3, 52.0, outcome=Outcome.LAND))
    assert ordered(orders) == {3: Action.LAND}
    assert ours.take(Incident(IncidentKind.BATTERY_CRITICAL, 3, 53.0, outcome=Outcome.RETURN)) == []


def test_a_vehicle_is_taken_over_from_its_failsafe_twice_and_then_lands() -> None:
    ours = fleet()
    given = [ours.take(Incident(IncidentKind.FAILSAFE, 3, 10.0 * n)) for n in range(4)]
    assert [order.action for orders in given for order in orders] == [
        *(Action.RETURN, Action.RETURN, Action.LAND, Action.LAND)
    ]
    assert ours.states[3] is State.LANDING


@pytest.mark.parametrize("before_t0", [False, True])
def test_a_failsafe_that_this_program_caused_by_its_standstill_ends_no_flight(before_t0: bool) -> None:
    ours = fleet()
    if before_t0:
        ours.begin(starting=True)
    before = dict(ours.states)
    for n in range(5):  # as often as it happens
        found = ours.take(Incident(IncidentKind.FAILSAFE, 2, 10.0 * n, ours=True))
        assert ordered(found) == {2: Action.OBEY}
    assert ours.states == before
    assert not ours.troubles


def test_stranded_vehicles_are_led_back_or_return() -> None:
    ours = fleet()
    for sysid in FOUR:
        assert ordered(ours.take(Incident(IncidentKind.STRANDED, sysid, 10.0))) == {sysid: Action.REJOIN}
    assert not ours.troubles
    for sysid in FOUR:
        orders = ours.take(Incident(IncidentKind.STRANDED, sysid, 20.0, "too near", usable=False))
        assert ordered(orders) == {sysid: Action.RETURN}
    assert [one.sysid for one in ours.troubles] == list(FOUR)


def test_a_failsafe_without_a_position_lands() -> None:
    assert ordered(fleet().take(Incident(IncidentKind.FAILSAFE, 3, 5.0, takeable=False))) == {3: Action.LAND}


def test_a_pilot_may_take_over_a_vehicle_that_lands() -> None:
    ours = fleet()
    ours.take(Incident(IncidentKind.GNSS_GONE, 3, 5.0))
    assert ordered(ours.take(Incident(IncidentKind.MODE_LEFT, 3, 8.0))) == {3: Action.LEAVE}
    assert ours.take(Incident(IncidentKind.FAILSAFE, 3, 9.0)) == []
    assert ours.states[3] is State.LEFT


def test_a_return_that_is_not_obeyed_becomes_a_landing() -> None:
    ours = fleet()
    ours.take(Incident(IncidentKind.FENCE, 3, 5.0))
    assert ordered(ours.not_obeyed(3, 9.0)) == {3: Action.LAND}
    assert ours.not_obeyed(3, 19.0) == []


@pytest.mark.parametrize(
    "kind", [IncidentKind.BATTERY_LOW, IncidentKind.FENCE, IncidentKind.FAILSAFE, IncidentKind.GNSS_GONE]
)
def test_trouble_before_t0_lands_all_on_their_pads(kind: IncidentKind) -> None:
    ours = fleet()
    ours.begin(starting=True)
    assert ordered(ours.take(Incident(kind, 3, 5.0))) == dict.fromkeys(FOUR, Action.LAND)
    assert [t.sysid for t in ours.troubles] == [3]


def test_a_conflict_before_t0_lands_all_on_their_pads() -> None:
    ours = fleet()
    ours.begin(starting=True)
    assert ordered(ours.take(conflict(5.0, 2.5))) == dict.fromkeys(FOUR, Action.LAND)
    assert [t.sysid for t in ours.troubles] == [3]
    assert "vehicles 3 and 2 will be 0.2 m apart in 2.5 s" in ours.troubles[0].detail
    assert ours.take(conflict(5.1, 2.4)) == []


def test_a_pilot_who_takes_one_before_t0_keeps_it() -> None:
    ours = fleet()
    ours.begin(starting=True)
    orders = ordered(ours.take(Incident(IncidentKind.MODE_LEFT, 3, 5.0)))
    assert orders == {3: Action.LEAVE, **dict.fromkeys((1, 2, 4), Action.LAND)}


def test_from_t0_on_vehicles_fly_the_plan() -> None:
    ours = fleet()
    ours.begin(starting=True)
    ours.begin(starting=False)
    assert ours.in_formation == FOUR


def conflict(at_s: float, in_s: float, pair: tuple[int, int] = (3, 2), **more: Any) -> Incident:
    return Incident(IncidentKind.CONFLICT, pair[0], at_s, "0.2 m", other=pair[1], in_s=in_s, **more)


def test_conflicts_escalate_hold_spread_land() -> None:
    ours = fleet()
    assert ordered(ours.take(conflict(10.0, 2.5))) == {3: Action.HOLD}
    assert ours.take(conflict(10.0 + AGAIN_S / 2, 2.0)) == []  # the order gets time to act
    assert ordered(ours.take(conflict(12.5, 1.0))) == {3: Action.SPREAD}
    assert ours.take(conflict(15.0, 0.5)) == []  # it is still climbing
    assert ordered(ours.take(conflict(16.6, 0.5))) == {3: Action.LAND}
    assert ours.in_formation == (1, 2, 4)


def test_an_order_says_which_conflict_it_answers() -> None:
    (order,) = fleet().take(conflict(10.0, 2.5))
    assert order.rule == "The yielding vehicle brakes and holds: vehicles 3 and 2 will be 0.2 m apart in 2.5 s"
    (order,) = fleet().take(Incident(IncidentKind.FENCE, 3, 5.0, "2 m outside"))
    assert order.rule == "A vehicle outside the fence returns"
    (order,) = fleet().ask(AskedOrder.RETURN, FOUR, 5.0)[:1]
    assert ":" not in order.rule


def test_with_no_time_to_brake_the_upper_one_climbs() -> None:
    """To brake takes 1.5 s."""
    assert ordered(fleet().take(conflict(10.0, 1.5))) == {3: Action.HOLD}
    assert ordered(fleet().take(conflict(10.0, 1.49))) == {3: Action.SPREAD}
    assert ordered(fleet().take(conflict(10.0, 0.5))) == {3: Action.SPREAD}
    assert ordered(fleet().take(conflict(10.0, 0.5, higher=False))) == {2: Action.SPREAD}


def test_a_vehicle_out_of_the_formation_yields_to_it() -> None:
    ours = fleet()
    ours.take(Incident(IncidentKind.FENCE, 2, 5.0))
    orders = ours.take(conflict(10.0, 2.5, higher=False))
    assert ordered(orders) == {2: Action.LAND}  # it returns already, below others: nothing else is left


def test_the_leader_yields_last() -> None:
    assert ordered(fleet().take(conflict(10.0, 2.5, pair=(1, 4)))) == {4: Action.HOLD}


def test_a_vehicle_that_yielded_returns_when_the_conflict_is_over() -> None:
    ours = fleet()
    ours.take(conflict(10.0, 2.5))
    assert ours.clear(10.0 + CLEAR_S - 0.1) == []
    assert ordered(ours.clear(10.0 + CLEAR_S + 0.1)) == {3: Action.RETURN}
    assert ours.clear(99.0) == []


def test_troubles_name_the_vehicle_that_leaves_and_the_reason() -> None:
    ours = fleet()
    ours.take(conflict(10.0, 0.5, higher=False))  # of 3 and 2, vehicle 2 is above and climbs
    ours.take(Incident(IncidentKind.FENCE, 4, 11.0, "2 m outside"))
    assert [(one.sysid, one.kind, one.detail) for one in ours.troubles] == [
        (2, IncidentKind.CONFLICT, "vehicles 3 and 2 will be 0.2 m apart in 0.5 s"),
        (4, IncidentKind.FENCE, "2 m outside"),
    ]
    starting = fleet()
    starting.begin(starting=True)
    starting.take(Incident(IncidentKind.GNSS_GONE, 4, 5.0, "no fix for 8.1 s"))
    assert [(one.sysid, one.detail) for one in starting.troubles] == [(4, "no fix for 8.1 s")]


def test_the_operator_brings_all_back_but_those_that_land_or_a_pilot_flies() -> None:
    ours = fleet()
    ours.take(Incident(IncidentKind.GNSS_GONE, 3, 5.0))
    ours.take(Incident(IncidentKind.MODE_LEFT, 4, 6.0))
    assert ordered(ours.ask(AskedOrder.RETURN, FOUR, 20.0)) == dict.fromkeys((1, 2), Action.RETURN)
    assert ours.in_formation == ()
    assert ours.take(conflict(20.0 + 0.9 * AGAIN_S, 0.5, pair=(1, 2))) == []  # the order gets time to act
    assert ordered(ours.take(conflict(20.0 + 1.1 * AGAIN_S, 0.5, pair=(1, 2)))) == {2: Action.LAND}


incidents = st.builds(
    Incident,
    st.sampled_from(list(IncidentKind)),
    st.sampled_from(FOUR),
    st.just(0.0),
    usable=st.booleans(),
    in_s=st.floats(0.0, 3.0),
    outcome=st.sampled_from(OUTCOMES),
    takeable=st.booleans(),
    ours=st.booleans(),
)


@given(
    st.lists(incidents, max_size=25), st.booleans(), st.sampled_from(list(OnLoss)), st.sampled_from(list(OnLeaderLoss))
)
def test_whatever_happens(story: list[Incident], follow: bool, loss: OnLoss, leader_loss: OnLeaderLoss) -> None:
    """A vehicle ordered out of the formation stays out; the leader flies; an order is one of a row for that state."""
    ours = ContingencyPolicy(FOUR, 1, Choices(loss, leader_loss, follow))
    out: set[int] = set()
    for n, event in enumerate(story):
        other = event.sysid % 4 + 1
        incident = replace(event, unix_s=float(n), other=other)
        for step in ("take", "clear"):
            before = dict(ours.states)
            orders = ours.take(incident) if step == "take" else ours.clear(float(n))
            for order in orders:
                rows = [row for row in POLICY if row.action is order.action and order.rule.startswith(row.rule)]
                assert any(before[order.sysid] in row.states for row in rows)
                if before[order.sysid] is State.LANDING:
                    assert order.action in (Action.LAND, Action.LEAVE)
                elif before[order.sysid] in FINAL:
                    assert incident.kind is IncidentKind.LINK_BACK
                if order.action not in (Action.PROMOTE, Action.REJOIN, Action.OBEY):
                    out.add(order.sysid)
                assert ours.states[order.sysid] is not State.LOST
                if ours.states[order.sysid] is State.LEFT:
                    assert incident.kind is IncidentKind.MODE_LEFT
            assert not out & set(ours.in_formation)
            for order in orders:
                if order.action is Action.PROMOTE:
                    assert order.sysid == ours.leader
                    assert ours.states[order.sysid] in IN_FORMATION


@pytest.mark.parametrize(
    ("states", "held"),
    [
        ((State.FLYING, State.SILENT, State.FLYING, State.RETURNING), (1, 2, 3)),
        ((State.FLYING, State.LANDING, State.LOST, State.RETURNING), ()),  # nobody else flies the plan
        ((State.RETURNING, State.FLYING, State.FLYING, State.FLYING), ()),  # it does not fly the plan any more
    ],
)
def test_all_who_fly_the_plan_hold_for_one_off_its_track(states: tuple[State, ...], held: tuple[int, ...]) -> None:
    ours = ContingencyPolicy(FOUR, 1, Choices(own_missions=True))
    ours.states.update(zip(FOUR, states, strict=True))
    orders = ours.take(Incident(IncidentKind.OFF_TRACK, 1, 100.0, "2 s late"))
    assert ordered(orders) == dict.fromkeys(held, Action.HOLD)
    assert [trouble.sysid for trouble in ours.troubles] == [1] * bool(held)
    assert ordered(ours.clear(104.9)) == {}
    assert ordered(ours.clear(105.1)) == dict.fromkeys(held, Action.RETURN)
