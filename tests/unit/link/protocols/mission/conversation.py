"""A machine of the mission protocol on a fake clock: what it says, and until when it waits, line by line."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from gcs.autopilots.protocol_timers import STANDARD, MissionTimers, ProtocolTimers
from gcs.link.protocols.exchange import Exchange, RttEstimator
from gcs.link.protocols.machine import Machine
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mission.model import MissionItem

VEHICLE = Station(4, 1)
Heard = tuple[float, str, dict[str, Any]]


class SteadyTrip(RttEstimator):
    """A wait of 0.5 s, 0.25 s more for each repetition; `samples_s` are the round trips that were learned."""

    def __init__(self) -> None:
        super().__init__()
        self.samples_s: list[float] = []

    def learn(self, sample_s: float) -> None:
        self.samples_s.append(round(sample_s, 6))

    def wait_s(self, repeats: int = 0) -> float:
        return 0.5 + 0.25 * repeats


def talking(
    autopilot: int = 0, *, timers: MissionTimers = STANDARD.mission, round_trip: RttEstimator | None = None
) -> Exchange:
    """With `VEHICLE`; without a `round_trip` it is not estimated."""
    own = ProtocolTimers(mission=timers)
    return Exchange(VEHICLE, autopilot, timers=own, round_trip=round_trip, estimates=round_trip is not None)


def missions(count: int) -> tuple[MissionItem, ...]:
    return tuple(MissionItem(16, 3, (0.0, 0.0, 0.0, 0.0), 100 * n, -100 * n, 10.0 + n) for n in range(count))


def said(name: str, *, source: Station = VEHICLE, target: Station = GROUND, kind: int = 0, **fields: Any) -> Message:
    return Message(name, {**target.target, "mission_type": kind, **fields}, *source)


def line(messages: Iterable[Message]) -> str:
    """Messages in short: "ITEM_INT 3, ACK 0"."""
    words = []
    for message in messages:
        fields = message.fields
        numbers = [str(fields[key]) for key in ("count", "seq", "start_index", "type") if key in fields]
        words.append(" ".join([message.name.removeprefix("MISSION_"), *numbers]))
    return ", ".join(words)


def until(machine: Machine) -> float | None:
    return None if machine.deadline_s is None else round(machine.deadline_s, 6)


def told(machine: Machine, name: str, now_s: float, **fields: Any) -> tuple[str, float | None]:
    """What the machine answers to a message of the vehicle, and its next deadline."""
    return line(machine.receive(said(name, **fields), now_s)), until(machine)


def ticks(machine: Machine, limit: int = 100) -> list[tuple[float, str]]:
    """What it says at its deadlines, with nobody answering, until it ends. A moment before them it says nothing."""
    found = []
    while (now_s := machine.deadline_s) is not None:
        limit -= 1
        assert limit, found
        assert machine.tick(now_s - 1e-3) == []
        found.append((round(now_s, 6), line(machine.tick(now_s))))
    return found
