"""The contingency policy as one table: incident, state of the vehicle and choice -> new state, order and rule.

`gcs.flight.contingency.decisions` executes `POLICY`; tools/policy_table.py prints it into docs/flying.md. The first row
that applies counts. Named functions compute what depends on several vehicles, as which of two yields.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from gcs.flight.contingency.detection import IncidentKind


class State(StrEnum):
    """The state of one vehicle; `MEANING` says what each one means."""

    FLYING = "flying"
    SILENT = "silent"
    HOLDING = "holding"
    SPREAD = "spread"
    RETURNING = "returning"
    LANDING = "landing"
    LEFT = "left"
    LOST = "lost"


MEANING = {
    State.FLYING: "flies the plan",
    State.SILENT: "is not heard; its setpoint stream continues",
    State.HOLDING: "yielded in a conflict; holds its position",
    State.SPREAD: "yielded in a conflict; holds 2 m higher",
    State.RETURNING: "returns (RTL)",
    State.LANDING: "lands at its position",
    State.LEFT: "is flown by its own autopilot or by a pilot; gets no order",
    State.LOST: "was silent for too long; gets no order",
}


class Action(StrEnum):
    """What a vehicle is ordered to do."""

    HOLD = "hold"
    SPREAD = "climb"
    RETURN = "return"
    LAND = "land"
    LEAVE = "release"
    PROMOTE = "lead"
    REJOIN = "rejoin"


class Trigger(StrEnum):
    """What the policy answers besides incidents: the operator, the passing of time, and the loss of a vehicle."""

    RETURN_ALL = "return requested"
    CLEAR = "conflict over"
    VEHICLE_OUT = "vehicle lost from the formation"
    LEADER_OUT = "leader lost or left, with `--follow`"


class OnLoss(StrEnum):
    """What the other vehicles do when a vehicle is lost."""

    CONTINUE = "continue"
    RETURN = "return"
    LAND = "land"


class OnLeaderLoss(StrEnum):
    """What the followers do when their leader is lost or leaves the formation."""

    PROMOTE = "promote"
    RETURN = "return"


@dataclass(frozen=True)
class Choices:
    """The operator's choices."""

    on_loss: OnLoss = OnLoss.LAND
    on_leader_loss: OnLeaderLoss = OnLeaderLoss.PROMOTE
    follow: bool = False


IN_FORMATION = frozenset({State.FLYING, State.SILENT})
YIELDS = frozenset({State.FLYING, State.HOLDING, State.SPREAD, State.RETURNING})
AIRBORNE = YIELDS | {State.SILENT}  # can still get an order
YIELDED = frozenset({State.HOLDING, State.SPREAD})
ALL = frozenset(State)
USABLE_M = 1.5  # heard again further off, a vehicle would have to catch up, with others on its track
BRAKE_S = 1.5  # a conflict nearer than this leaves no time to brake
CLEAR_S = 5.0
AGAIN_S = 2.0  # an order gets this long to act before the next, stronger one
SPREAD_M = 2.0  # upwards: what is below is not known
SPREAD_AGAIN_S = 4.0  # that climb takes more than three seconds


@dataclass(frozen=True)
class Situation:
    """What the choice of a row may depend on."""

    states: Mapping[int, State]  # by system id, in the plan's order
    choices: Choices
    leader: int
    sysid: int = 0  # of the incident
    other: int = 0  # of a conflict: its second vehicle
    in_s: float = 0.0  # time to a conflict
    usable: bool = True  # of a link that is back: position and mode are as ordered
    first_is_upper: bool = True  # of a conflict: its first vehicle is not below the other one
    acting: frozenset[int] = frozenset()  # vehicles whose last order may still take effect
    clear: tuple[int, ...] = ()  # vehicles without a conflict for `CLEAR_S`


def reporting_vehicle(now: Situation) -> tuple[int, ...]:
    """The vehicle of the incident."""
    return (now.sysid,)


def every_vehicle(now: Situation) -> tuple[int, ...]:
    """All vehicles; the row's states select among them."""
    return tuple(now.states)


def clear_vehicles(now: Situation) -> tuple[int, ...]:
    """The vehicles without a conflict for `CLEAR_S`."""
    return now.clear


def next_leader(now: Situation) -> tuple[int, ...]:
    """The first vehicle in the plan's order that flies the plan and is heard."""
    return tuple(i for i, state in now.states.items() if state is State.FLYING)[:1]


def yielding_vehicle(now: Situation) -> tuple[int, ...]:
    """The vehicle of a conflict that yields; none while an earlier order to either may still take effect.

    A vehicle out of the formation yields to one in it, a follower to the leader. Of two alike the conflict's first
    vehicle yields: it is further off its planned position.
    """

    def rank(sysid: int) -> tuple[bool, bool, bool]:
        return now.states[sysid] in IN_FORMATION, sysid == now.leader, sysid != now.sysid

    able = [i for i in sorted((now.sysid, now.other), key=rank) if now.states[i] in YIELDS]
    return () if _order_acts(now) else tuple(able[:1])


def upper_vehicle(now: Situation) -> tuple[int, ...]:
    """The higher vehicle of a conflict; none while an earlier order to either may still take effect."""
    upper = now.sysid if now.first_is_upper else now.other
    return () if _order_acts(now) else (upper,)


def _order_acts(now: Situation) -> bool:
    return not now.acting.isdisjoint((now.sysid, now.other))


@dataclass(frozen=True)
class Condition:
    """A condition in words, for the document, and as a function."""

    words: str
    true: Callable[[Situation], bool]


ALWAYS = Condition("", lambda now: True)
IN_PLACE = Condition(f"{USABLE_M:g} m or less off, in the ordered mode", lambda now: now.usable)
TIME_TO_BRAKE = Condition(f"{BRAKE_S:g} s ahead or more", lambda now: now.in_s >= BRAKE_S)
LAND_ON_LOSS = Condition("`--on-loss land`", lambda now: now.choices.on_loss is OnLoss.LAND)
RETURN_ON_LOSS = Condition("`--on-loss return`", lambda now: now.choices.on_loss is OnLoss.RETURN)
CONTINUE_ON_LOSS = Condition("`--on-loss continue`", lambda now: now.choices.on_loss is OnLoss.CONTINUE)
PROMOTE = Condition("`--on-leader-loss promote`", lambda now: now.choices.on_leader_loss is OnLeaderLoss.PROMOTE)


@dataclass(frozen=True)
class Row:
    """One transition. It orders those `vehicles` that are in one of `states`; without one it does not apply."""

    trigger: IncidentKind | Trigger
    states: frozenset[State]
    when: Condition
    to: State | None  # None: the state stays
    action: Action | None  # None: no order
    rule: str
    vehicles: Callable[[Situation], tuple[int, ...]] = reporting_vehicle


KEEPS = "The vehicle keeps its order"
_K, _S, _A, _T = IncidentKind, State, Action, Trigger
POLICY = (
    Row(_K.LINK_LOST, frozenset({_S.FLYING}), ALWAYS, _S.SILENT, None, "The setpoint stream continues"),
    Row(_K.LINK_LOST, ALL - {_S.FLYING}, ALWAYS, None, None, KEEPS),
    Row(
        _K.LINK_BACK,
        frozenset({_S.SILENT}),
        IN_PLACE,
        _S.FLYING,
        _A.REJOIN,
        "A vehicle heard again in its place rejoins; its deviation fades in 8 s",
    ),
    Row(
        _K.LINK_BACK,
        frozenset({_S.SILENT, _S.LOST}),
        ALWAYS,
        _S.RETURNING,
        _A.RETURN,
        "A vehicle heard again too late, off its place or in another mode returns",
    ),
    Row(_K.LINK_BACK, ALL - {_S.SILENT, _S.LOST}, ALWAYS, None, None, KEEPS),
    Row(_K.VEHICLE_LOST, ALL, ALWAYS, _S.LOST, None, "A lost vehicle gets no order until it is heard again"),
    Row(_K.GNSS_LOST, ALL, ALWAYS, None, None, "The vehicle flies on by its own estimate"),
    Row(_K.GNSS_BACK, ALL, ALWAYS, None, None, "The vehicle flies on"),
    Row(_K.GNSS_GONE, AIRBORNE, ALWAYS, _S.LANDING, _A.LAND, "A vehicle without a position lands at once"),
    Row(_K.GNSS_GONE, ALL - AIRBORNE, ALWAYS, None, None, KEEPS),
    Row(_K.BATTERY_LOW, IN_FORMATION, ALWAYS, _S.RETURNING, _A.RETURN, "A vehicle with a low battery returns"),
    Row(_K.BATTERY_LOW, ALL - IN_FORMATION, ALWAYS, None, None, KEEPS),
    Row(
        _K.BATTERY_CRITICAL,
        AIRBORNE,
        ALWAYS,
        _S.LANDING,
        _A.LAND,
        "A vehicle with a critical battery lands at once",
    ),
    Row(_K.BATTERY_CRITICAL, ALL - AIRBORNE, ALWAYS, None, None, KEEPS),
    Row(_K.FENCE, IN_FORMATION, ALWAYS, _S.RETURNING, _A.RETURN, "A vehicle outside the fence returns"),
    Row(_K.FENCE, ALL - IN_FORMATION, ALWAYS, None, None, KEEPS),
    Row(
        _K.MODE_LEFT,
        AIRBORNE,
        ALWAYS,
        _S.LEFT,
        _A.LEAVE,
        "A vehicle in a mode that was not ordered is left to its autopilot or pilot",
    ),
    Row(_K.MODE_LEFT, ALL - AIRBORNE, ALWAYS, None, None, KEEPS),
    Row(
        _K.CONFLICT,
        frozenset({_S.FLYING}),
        TIME_TO_BRAKE,
        _S.HOLDING,
        _A.HOLD,
        "The yielding vehicle brakes and holds",
        yielding_vehicle,
    ),
    Row(
        _K.CONFLICT,
        frozenset({_S.FLYING, _S.HOLDING}),
        ALWAYS,
        _S.SPREAD,
        _A.SPREAD,
        f"The upper vehicle climbs by {SPREAD_M:g} m",
        upper_vehicle,
    ),
    Row(
        _K.CONFLICT,
        YIELDS,
        ALWAYS,
        _S.LANDING,
        _A.LAND,
        "The yielding vehicle lands",
        yielding_vehicle,
    ),
    Row(_K.CONFLICT, ALL, ALWAYS, None, None, "An earlier order gets time to act, or no vehicle can yield"),
    Row(
        _T.CLEAR,
        YIELDED,
        ALWAYS,
        _S.RETURNING,
        _A.RETURN,
        f"A vehicle that yielded returns after {CLEAR_S:g} s without a conflict",
        clear_vehicles,
    ),
    Row(
        _T.VEHICLE_OUT,
        IN_FORMATION,
        LAND_ON_LOSS,
        _S.LANDING,
        _A.LAND,
        "A vehicle was lost: all others land",
        every_vehicle,
    ),
    Row(
        _T.VEHICLE_OUT,
        IN_FORMATION,
        RETURN_ON_LOSS,
        _S.RETURNING,
        _A.RETURN,
        "A vehicle was lost: all others return",
        every_vehicle,
    ),
    Row(_T.VEHICLE_OUT, IN_FORMATION, CONTINUE_ON_LOSS, None, None, "All others continue", every_vehicle),
    Row(_T.LEADER_OUT, frozenset({_S.FLYING}), PROMOTE, None, _A.PROMOTE, "The next vehicle leads", next_leader),
    Row(
        _T.LEADER_OUT,
        IN_FORMATION,
        ALWAYS,
        _S.RETURNING,
        _A.RETURN,
        "The formation has no leader: all vehicles return",
        every_vehicle,
    ),
    Row(
        _T.RETURN_ALL,
        IN_FORMATION,
        ALWAYS,
        _S.RETURNING,
        _A.RETURN,
        "The operator ordered all vehicles to return",
        every_vehicle,
    ),
)


@dataclass(frozen=True)
class Order:
    """One vehicle, one action, and the rule it follows from."""

    sysid: int
    action: Action
    rule: str
