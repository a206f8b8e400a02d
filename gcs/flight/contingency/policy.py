"""What is done when things go wrong in flight: a state machine from incidents to orders.

Knows: who is where in its flight, the choices of whoever flies. Does not know: messages, clocks, courses, how orders
are carried out (`crisis`). `docs/flying.md` has the same as a table; its tests are the rows.

    state      meaning                                 leaves by
    FLYING     on the plan                             any order, silence
    SILENT     not heard, its stream goes on           link back -> FLYING or RETURNING; lost -> LOST
    HOLDING    gave way, stands                        clear for a while -> RETURNING; conflict -> SPREAD
    SPREAD     gave way in height                      clear for a while -> RETURNING; conflict -> LANDING
    RETURNING  on its own way home                     landed; battery critical, conflict -> LANDING
    LANDING    coming down where it is
    LEFT       its own autopilot or a pilot flies it
    LOST       silent for too long                     link back -> RETURNING
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

from gcs.flight.contingency.detection import Incident, IncidentKind


class State(StrEnum):
    """See the table above."""

    FLYING = "flying"
    SILENT = "silent"
    HOLDING = "holding"
    SPREAD = "spread"
    RETURNING = "returning"
    LANDING = "landing"
    LEFT = "left"
    LOST = "lost"


class Action(StrEnum):
    """What a vehicle is told to do."""

    HOLD = "hold"
    SPREAD = "spread vertically"
    RETURN = "return"
    LAND = "land"
    LEAVE = "leave alone"
    PROMOTE = "lead"
    REJOIN = "go on from where it is"


class OnLoss(StrEnum):
    """What the others do when a vehicle is lost."""

    CONTINUE = "continue"
    RETURN = "return"
    LAND = "land"


class OnLeaderLoss(StrEnum):
    """What followers do when their leader is."""

    PROMOTE = "promote"
    RETURN = "return"


@dataclass(frozen=True)
class Choices:
    """Left to whoever flies."""

    on_loss: OnLoss = OnLoss.LAND
    on_leader_loss: OnLeaderLoss = OnLeaderLoss.PROMOTE
    follow: bool = False


@dataclass(frozen=True)
class Order:
    """One vehicle, one action, the rule that says so."""

    sysid: int
    action: Action
    rule: str


IN_FORMATION = frozenset({State.FLYING, State.SILENT})
_GIVES_WAY = frozenset({State.FLYING, State.HOLDING, State.SPREAD, State.RETURNING})
BRAKE_S = 1.5  # less time than this is not enough to stop in
CLEAR_S = 5.0
AGAIN_S = 2.0  # an order gets so long to work before the next, harder one
SPREAD_M = 2.0  # up: what is below is not known
SPREAD_AGAIN_S = 4.0  # that climb takes more than three seconds


@dataclass
class ContingencyPolicy:
    """Decides. `states` by system id; `leader` is whom the others follow, if they do."""

    sysids: tuple[int, ...]
    leader: int
    choices: Choices = Choices()
    states: dict[int, State] = field(default_factory=dict)
    troubles: list[Incident] = field(default_factory=list)  # those that took somebody out of the formation
    _ordered_s: dict[int, float] = field(default_factory=dict)
    _conflict_s: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.states = dict.fromkeys(self.sysids, State.FLYING)

    @property
    def in_formation(self) -> tuple[int, ...]:
        """Those who fly the plan, heard or not."""
        return tuple(i for i, state in self.states.items() if state in IN_FORMATION)

    def take(self, incident: Incident, *, higher: bool = True) -> list[Order]:
        """Orders for an incident. `higher`: of a conflict, whether its first vehicle is not below the other."""
        state = self.states[incident.sysid]
        match incident.kind:
            case IncidentKind.LINK_LOST:
                if state is State.FLYING:
                    self.states[incident.sysid] = State.SILENT
                return []
            case IncidentKind.LINK_BACK:
                return self._back(incident, state)
            case IncidentKind.CONFLICT:
                return self._conflict(incident, higher)
            case IncidentKind.GNSS_LOST | IncidentKind.GNSS_BACK:
                return []
            case IncidentKind.VEHICLE_LOST:
                return self._lost(incident, state)
            case IncidentKind.MODE_LEFT:
                if state in (State.LANDING, State.LEFT, State.LOST):
                    return []
                return self._out(incident, State.LEFT, Action.LEAVE, "a mode that nobody here asked for is obeyed")
            case IncidentKind.BATTERY_LOW:
                if state not in IN_FORMATION:
                    return []
                return self._out(incident, State.RETURNING, Action.RETURN, "a low battery goes home")
            case IncidentKind.FENCE:
                if state not in IN_FORMATION:
                    return []
                return self._out(incident, State.RETURNING, Action.RETURN, "who leaves the fence goes home")
            case IncidentKind.BATTERY_CRITICAL | IncidentKind.GNSS_GONE:
                if state in (State.LANDING, State.LEFT, State.LOST):
                    return []
                what = (
                    "a critical battery"
                    if incident.kind is IncidentKind.BATTERY_CRITICAL
                    else "who does not know its place"
                )
                return self._out(incident, State.LANDING, Action.LAND, f"{what} lands where it is")

    def call_home(self, unix_s: float) -> list[Order]:
        """Whoever flies calls everybody home."""
        rule = "all were called home"
        return [self._order(i, State.RETURNING, Action.RETURN, rule, unix_s) for i in self.in_formation]

    def clear(self, unix_s: float) -> list[Order]:
        """Who gave way and has been out of conflict for a while goes home."""
        orders = []
        for sysid, state in self.states.items():
            waits = state in (State.HOLDING, State.SPREAD)
            if waits and unix_s - max(self._conflict_s[sysid], self._ordered_s[sysid]) > CLEAR_S:
                orders.append(self._order(sysid, State.RETURNING, Action.RETURN, "who gave way goes home", unix_s))
        return orders

    def _back(self, incident: Incident, state: State) -> list[Order]:
        if state is State.SILENT and incident.usable:
            self.states[incident.sysid] = State.FLYING
            return [Order(incident.sysid, Action.REJOIN, "who is heard again, near its place, flies on")]
        if state in (State.SILENT, State.LOST):
            rule = "who was away for too long, or is no more where it should be, goes home"
            return self._out(incident, State.RETURNING, Action.RETURN, rule)
        return []

    def _lost(self, incident: Incident, state: State) -> list[Order]:
        self.states[incident.sysid] = State.LOST
        self.troubles.append(incident)
        if state not in IN_FORMATION:
            return []
        if self._leads(incident.sysid):
            return self._leaderless(incident)
        return self._others(incident, self.choices.on_loss, "a vehicle was lost")

    def _out(self, incident: Incident, state: State, action: Action, rule: str) -> list[Order]:
        """One leaves the formation; if it led, so that somebody else must."""
        before = self.states[incident.sysid]
        if before in IN_FORMATION:
            self.troubles.append(incident)
        orders = [self._order(incident.sysid, state, action, rule, incident.unix_s)]
        if before in IN_FORMATION and self._leads(incident.sysid):
            orders += self._leaderless(incident)
        return orders

    def _leads(self, sysid: int) -> bool:
        return self.choices.follow and sysid == self.leader

    def _leaderless(self, incident: Incident) -> list[Order]:
        heard = [i for i in self.sysids if self.states[i] is State.FLYING]
        if self.choices.on_leader_loss is OnLeaderLoss.PROMOTE and heard:
            self.leader = heard[0]
            return [Order(heard[0], Action.PROMOTE, "the leader is out: the next in the plan's order leads")]
        return self._others(incident, OnLoss.RETURN, "the leader is out")

    def _others(self, incident: Incident, choice: OnLoss, why: str) -> list[Order]:
        if choice is OnLoss.CONTINUE:
            return []
        landing = choice is OnLoss.LAND
        state, action = (State.LANDING, Action.LAND) if landing else (State.RETURNING, Action.RETURN)
        rule = f"{why}: all {'land' if landing else 'go home'}"
        return [self._order(i, state, action, rule, incident.unix_s) for i in self.in_formation]

    def _conflict(self, incident: Incident, higher: bool) -> list[Order]:
        assert incident.other is not None
        pair = (incident.sysid, incident.other)
        self._conflict_s.update(dict.fromkeys(pair, incident.unix_s))
        # The leader and whoever flies the plan go on; of two alike, the first one named is further off.
        order = sorted(pair, key=lambda i: (self.states[i] in IN_FORMATION, i == self.leader, i != incident.sysid))
        yielding = next((i for i in order if self.states[i] in _GIVES_WAY), None)
        upper = incident.sysid if higher else incident.other
        if yielding is None or any(self._has_time(i, incident.unix_s) for i in pair):
            return []
        named = f"vehicles {pair[0]} and {pair[1]} will be {incident.detail} apart in {incident.in_s:.1f} s"
        if self.states[yielding] is State.FLYING and incident.in_s >= BRAKE_S:
            return self._out(_of(incident, yielding, named), State.HOLDING, Action.HOLD, f"{named}: one holds")
        if self.states[upper] in (State.FLYING, State.HOLDING):
            rule = f"{named}: the upper one makes room in height"
            return self._out(_of(incident, upper, named), State.SPREAD, Action.SPREAD, rule)
        rule = f"{named}: room in height did not help, one lands"
        return self._out(_of(incident, yielding, named), State.LANDING, Action.LAND, rule)

    def _has_time(self, sysid: int, unix_s: float) -> bool:
        """Whether what it was told last may still work."""
        again_s = SPREAD_AGAIN_S if self.states[sysid] is State.SPREAD else AGAIN_S
        return unix_s - self._ordered_s.get(sysid, -math.inf) < again_s

    def _order(self, sysid: int, state: State, action: Action, rule: str, unix_s: float) -> Order:
        self.states[sysid] = state
        self._ordered_s[sysid] = unix_s
        self._conflict_s.setdefault(sysid, unix_s)
        return Order(sysid, action, rule)


def _of(conflict: Incident, sysid: int, named: str) -> Incident:
    """The conflict as the trouble of the one who gives way."""
    return replace(conflict, sysid=sysid, detail=named)
