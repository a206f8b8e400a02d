"""The vocabulary of the contingency policy: states, orders, triggers, conditions, and the form of a row.

`gcs.flight.contingency.policy_rows` holds the rows. Named functions compute what depends on several vehicles, as which
of two yields.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from gcs.flight.contingency.choices import Choices, OnLeaderLoss, OnLoss
from gcs.flight.contingency.detection import IncidentKind
from gcs.flight.contingency.energy_choice import Outcome
from gcs.flight.monitoring.progress import Action, AskedOrder


class State(StrEnum):
    """The state of one vehicle; `MEANING` says what each one means."""

    STARTING = "starting"
    FLYING = "flying"
    SILENT = "silent"
    HOLDING = "holding"
    SPREAD = "spread"
    RETURNING = "returning"
    LANDING = "landing"
    LEFT = "left"
    LOST = "lost"
    WAITING = "waiting"


MEANING = {
    State.STARTING: "takes off, or hovers over its pad until T0",
    State.FLYING: "flies the plan",
    State.SILENT: "is not heard; its setpoint stream continues",
    State.HOLDING: "yielded in a conflict, or a vehicle was off its track; holds its position",
    State.SPREAD: "yielded in a conflict; holds 2 m higher",
    State.RETURNING: "returns (RTL), or flies to the nearest safe landing point",
    State.LANDING: "lands at its position",
    State.LEFT: "is flown by a pilot; gets no order; the flight watches it until it has landed",
    State.LOST: "was silent for too long; gets no order",
    State.WAITING: "holds as the operator ordered, until it is ordered to continue, to return or to land",
}


_AFTER: dict[Action | None, State] = {
    Action.HOLD: State.HOLDING,
    Action.SPREAD: State.SPREAD,
    Action.RETURN: State.RETURNING,
    Action.DIVERT: State.RETURNING,
    Action.LAND: State.LANDING,
    Action.LEAVE: State.LEFT,
}


class Trigger(StrEnum):
    """What the policy answers besides incidents: the operator, the passing of time, and the loss of a vehicle."""

    HOLD_ASKED = "the operator orders to hold"
    LAND_ASKED = "the operator orders to land"
    RETURN_ASKED = "the operator orders to return"
    CONTINUE_ASKED = "the operator orders to continue"
    CLEAR = "conflict over"
    VEHICLE_OUT = "vehicle lost from the formation"
    RANKS_OPEN = "no plan without the lost vehicle was verified in time"
    LEADER_OUT = "leader lost or left, with `--follow`"
    NOT_OBEYED = "order refused or not answered three times"
    START_ABORTED = "trouble before T0"


ASKED = {
    AskedOrder.HOLD: Trigger.HOLD_ASKED,
    AskedOrder.LAND: Trigger.LAND_ASKED,
    AskedOrder.RETURN: Trigger.RETURN_ASKED,
    AskedOrder.CONTINUE: Trigger.CONTINUE_ASKED,
}
IN_FORMATION = frozenset({State.FLYING, State.SILENT})
YIELDS = frozenset({State.FLYING, State.HOLDING, State.SPREAD, State.RETURNING, State.WAITING})
AIRBORNE = YIELDS | {State.SILENT}  # can still get an order
OURS = AIRBORNE | {State.STARTING, State.LANDING}  # every vehicle in the air that is not lost and has no pilot
NOT_OBEYED_AFTER = 3  # attempts
TAKE_OVERS_MAX = 2  # of one vehicle from its failsafe: after that it lands
YIELDED = frozenset({State.HOLDING, State.SPREAD})
HOLDS = YIELDED | {State.WAITING}
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
    usable: bool = True  # of a link that is back: position and mode are as ordered; or a way back to the plan is safe
    first_is_upper: bool = True  # of a conflict: its first vehicle is not below the other one
    acting: frozenset[int] = frozenset()  # vehicles whose last order may still take effect
    asked: tuple[int, ...] = ()  # vehicles that the operator named
    clear: tuple[int, ...] = ()  # vehicles without a conflict for `CLEAR_S`
    outcome: Outcome | None = None  # of a low battery: what the energy allows
    takeable: bool = True  # of a failsafe: the vehicle can follow setpoints, and was not taken over too often
    ours: bool = False  # of a failsafe: it came while this program stood still


def reporting_vehicle(now: Situation) -> tuple[int, ...]:
    """The vehicle of the incident."""
    return (now.sysid,)


def every_vehicle(now: Situation) -> tuple[int, ...]:
    """All vehicles; the row's states select among them."""
    return tuple(now.states)


def asked_vehicles(now: Situation) -> tuple[int, ...]:
    """The vehicles that the operator named."""
    return now.asked


def formation_of_vehicle(now: Situation) -> tuple[int, ...]:
    """All vehicles of the formation; none if the vehicle of the incident is not in it."""
    return tuple(now.states) if now.states[now.sysid] in IN_FORMATION else ()


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
SAFE_WAY = Condition("a common way back to the plan was checked and keeps all limits", lambda now: now.usable)
TOGETHER = Condition(
    "no vehicle flies the plan meanwhile, and a common way back to it was checked and keeps all limits",
    lambda now: now.usable and IN_FORMATION.isdisjoint(now.states.values()),
)
OWN_STANDSTILL = Condition("it has a position, and this program stood still", lambda now: now.ours and now.takeable)
STREAMED = Condition("setpoints are streamed to all", lambda now: not now.choices.own_missions)
COMPANY = Condition("others fly the plan too", lambda now: sum(s in IN_FORMATION for s in now.states.values()) > 1)
ON_MISSIONS = Condition(
    f"{BRAKE_S:g} s ahead or more, and both fly missions on board",
    lambda now: (
        now.choices.own_missions
        and now.in_s >= BRAKE_S
        and now.states[now.sysid] in IN_FORMATION
        and now.states[now.other] in IN_FORMATION
    ),
)
TIME_TO_BRAKE = Condition(f"{BRAKE_S:g} s ahead or more", lambda now: now.in_s >= BRAKE_S)
ENOUGH_TO_FINISH = Condition("energy for the rest of its flight", lambda now: now.outcome is Outcome.FINISH)
ENOUGH_TO_DIVERT = Condition("energy for the nearest safe point", lambda now: now.outcome is Outcome.NEAREST)
ENOUGH_TO_RETURN = Condition("energy for the return", lambda now: now.outcome is Outcome.RETURN)
TAKEABLE = Condition(
    f"it has a position, does not land, and was taken over less than {TAKE_OVERS_MAX} times",
    lambda now: now.takeable and now.outcome in (None, Outcome.RETURN, Outcome.FINISH),
)
TAKEABLE_NEAR = Condition(
    "as before, and the battery allows the nearest safe point only",
    lambda now: now.takeable and now.outcome is Outcome.NEAREST,
)
LAND_ON_LOSS = Condition("`--on-loss land`", lambda now: now.choices.on_loss is OnLoss.LAND)
RETURN_ON_LOSS = Condition("`--on-loss return`", lambda now: now.choices.on_loss is OnLoss.RETURN)
CONTINUE_ON_LOSS = Condition("`--on-loss continue`", lambda now: now.choices.on_loss is OnLoss.CONTINUE)
CLOSE_ON_LOSS = Condition("`--on-loss close`", lambda now: now.choices.on_loss is OnLoss.CLOSE)
PROMOTE = Condition("`--on-leader-loss promote`", lambda now: now.choices.on_leader_loss is OnLeaderLoss.PROMOTE)


@dataclass(frozen=True)
class Row:
    """One transition. It orders those `vehicles` that are in one of `states`; without one it does not apply."""

    trigger: IncidentKind | Trigger
    states: frozenset[State]
    rule: str
    action: Action | None = None  # None: no order
    to: State | None = None  # None: that of the action, or else the state stays
    when: Condition = ALWAYS
    vehicles: Callable[[Situation], tuple[int, ...]] = reporting_vehicle

    @property
    def after(self) -> State | None:
        """The state of the ordered vehicles from then on; None: it stays."""
        return self.to or _AFTER.get(self.action)


@dataclass(frozen=True)
class Order:
    """One vehicle, one action, and the rule it follows from."""

    sysid: int
    action: Action
    rule: str
