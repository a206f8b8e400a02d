"""Executes the contingency policy: incidents in, orders out, one state per vehicle. Time is an argument."""

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Any

from gcs.flight.contingency.choices import Choices
from gcs.flight.contingency.detection import Incident, IncidentKind
from gcs.flight.contingency.policy import (
    AGAIN_S,
    ASKED,
    CLEAR_S,
    IN_FORMATION,
    SPREAD_AGAIN_S,
    TAKE_OVERS_MAX,
    YIELDED,
    Order,
    Row,
    Situation,
    State,
    Trigger,
)
from gcs.flight.contingency.policy_rows import POLICY
from gcs.flight.monitoring.progress import Action, AskedOrder


def applying_row(trigger: IncidentKind | Trigger, now: Situation) -> tuple[Row | None, tuple[int, ...]]:
    """Return the first row of `POLICY` that applies, and the vehicles that it orders; None and none without one."""
    for row in POLICY:
        if row.trigger is trigger and row.when.true(now):
            ordered = tuple(i for i in row.vehicles(now) if now.states[i] in row.states)
            if ordered:
                return row, ordered
    return None, ()


@dataclass
class ContingencyPolicy:
    """The states of a fleet, by system id. `leader` is the vehicle that the others follow, if they do."""

    sysids: tuple[int, ...]
    leader: int
    choices: Choices = field(default_factory=Choices)
    states: dict[int, State] = field(default_factory=dict)
    troubles: list[Incident] = field(default_factory=list)  # the incidents that took a vehicle out of the formation
    _ordered_s: dict[int, float] = field(default_factory=dict)
    _conflict_s: dict[int, float] = field(default_factory=dict)
    _take_overs: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.states = dict.fromkeys(self.sysids, State.FLYING)

    @property
    def in_formation(self) -> tuple[int, ...]:
        """The vehicles that fly the plan, heard or not."""
        return tuple(i for i, state in self.states.items() if state in IN_FORMATION)

    def take(self, incident: Incident) -> list[Order]:
        """Return the orders for an incident."""
        now = self._now(incident.unix_s, incident)
        because = ""
        if incident.kind is IncidentKind.CONFLICT:
            self._conflict_s.update(dict.fromkeys((now.sysid, now.other), incident.unix_s))
            because = f"vehicles {now.sysid} and {now.other} will be {incident.detail} apart in {incident.in_s:.1f} s"
        row, ordered = applying_row(incident.kind, now)
        if row is None:
            return []
        sysid = incident.sysid if incident.sysid in ordered else ordered[0]
        before = self.states[sysid]
        orders = self._apply(row, ordered, incident.unix_s, because)
        left = before in IN_FORMATION and self.states[sysid] not in IN_FORMATION
        if incident.kind is IncidentKind.FAILSAFE and orders and not incident.ours:
            self._take_overs[sysid] = self._take_overs.get(sysid, 0) + 1
        if before is State.STARTING:
            if self.states[sysid] is not State.STARTING:
                self.troubles.append(replace(incident, sysid=sysid, detail=because or incident.detail))
                orders += self._trigger(Trigger.START_ABORTED, incident.unix_s)
            return orders
        if left or row.after is State.LOST:
            self.troubles.append(replace(incident, sysid=sysid, detail=because or incident.detail))
        if left and self.choices.follow and sysid == self.leader:
            orders += self._trigger(Trigger.LEADER_OUT, incident.unix_s)
        elif left and row.after is State.LOST:
            orders += self._trigger(Trigger.VEHICLE_OUT, incident.unix_s)
        return orders

    def asked(self, order: AskedOrder, sysids: Collection[int], *, usable: bool = True) -> tuple[int, ...]:
        """Return which of these vehicles would obey the operator. `usable`: a way back to the plan is safe."""
        now = Situation(self.states, self.choices, self.leader, usable=usable, asked=tuple(sysids))
        return applying_row(ASKED[order], now)[1]

    def ask(self, order: AskedOrder, sysids: Collection[int], unix_s: float, *, usable: bool = True) -> list[Order]:
        """Return the orders that follow from one of the operator to these vehicles; none where no row applies."""
        leads = self.states[self.leader] in IN_FORMATION
        orders = self._trigger(ASKED[order], unix_s, usable=usable, asked=tuple(sysids))
        if self.choices.follow and leads and self.states[self.leader] not in IN_FORMATION:
            orders += self._trigger(Trigger.LEADER_OUT, unix_s)
        return orders

    def never_heard(self, sysid: int) -> None:
        """A vehicle was lost before this process began: no order for it, and none for the others because of it."""
        self.states[sysid] = State.LOST

    def begin(self, *, starting: bool) -> None:
        """Count the vehicles as starting (before T0), or those that still start as flying the plan (from T0 on)."""
        before, after = (State.FLYING, State.STARTING) if starting else (State.STARTING, State.FLYING)
        self.states.update({i: after for i, state in self.states.items() if state is before})

    def not_obeyed(self, sysid: int, unix_s: float) -> list[Order]:
        """Return the orders to a vehicle that did not carry out its last one."""
        return self._trigger(Trigger.NOT_OBEYED, unix_s, sysid=sysid)

    def ranks_stay_open(self, unix_s: float) -> list[Order]:
        """Return the orders to the others, where no plan without a lost vehicle was found."""
        return self._trigger(Trigger.RANKS_OPEN, unix_s)

    def clear(self, unix_s: float) -> list[Order]:
        """Return the orders to vehicles that yielded and had no conflict for `CLEAR_S` since."""
        return self._trigger(Trigger.CLEAR, unix_s)

    def _now(self, unix_s: float, incident: Incident | None = None) -> Situation:
        waiting = [i for i, state in self.states.items() if state in YIELDED]
        now = Situation(
            self.states,
            self.choices,
            self.leader,
            acting=frozenset(i for i in self.sysids if self._acts(i, unix_s)),
            clear=tuple(i for i in waiting if unix_s - max(self._conflict_s[i], self._ordered_s[i]) > CLEAR_S),
        )
        if incident is None:
            return now
        return replace(
            now,
            sysid=incident.sysid,
            other=incident.other or 0,
            in_s=incident.in_s,
            usable=incident.usable,
            outcome=incident.outcome,
            ours=incident.ours,
            takeable=incident.takeable and self._take_overs.get(incident.sysid, 0) < TAKE_OVERS_MAX,
            first_is_upper=incident.higher,
        )

    def _acts(self, sysid: int, unix_s: float) -> bool:
        again_s = SPREAD_AGAIN_S if self.states[sysid] is State.SPREAD else AGAIN_S
        return unix_s - self._ordered_s.get(sysid, -math.inf) < again_s

    def _trigger(self, trigger: Trigger, unix_s: float, **known: Any) -> list[Order]:
        row, ordered = applying_row(trigger, replace(self._now(unix_s), **known))
        if row is None:
            return []
        if row.action is Action.PROMOTE:
            (self.leader,) = ordered
        return self._apply(row, ordered, unix_s)

    def _apply(self, row: Row, ordered: tuple[int, ...], unix_s: float, because: str = "") -> list[Order]:
        for sysid in ordered:
            self.states[sysid] = row.after or self.states[sysid]
            if row.action is not None and self.states[sysid] not in IN_FORMATION:
                self._ordered_s[sysid] = unix_s
                self._conflict_s.setdefault(sysid, unix_s)
        if row.action is None:
            return []
        return [Order(i, row.action, f"{row.rule}: {because}" if because else row.rule) for i in ordered]
