"""One delivery to one emulated store of missions over a bad link, on a fake clock: nothing sleeps, everything counts.

Knows: messages that are lost, doubled, overtaken and late, from one seed; the habits of either autopilot. Does not
know: sockets, frames (messages travel as they are).
"""

from __future__ import annotations

import heapq
import itertools
import random
from collections.abc import Sequence
from dataclasses import dataclass

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError
from gcs.frames import Origin
from gcs.link.protocols.exchange import Exchange, RttEstimator
from gcs.link.protocols.machine import Machine
from gcs.link.protocols.mission.file_upload import FileUpload
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.strategy import Preferred, Transfer, planned
from gcs.link.protocols.mission.verified_upload import VerifiedUpload
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionType
from gcs.mission.model import MissionItem
from sim_bridge.missions.ftp_files import MissionFiles
from sim_bridge.missions.store import MissionStore
from sim_bridge.personality.ardupilot_missions import MISSIONS as ARDUPILOT
from sim_bridge.personality.px4_missions import MISSIONS as PX4
from sim_bridge.protocol.ftp_server import FileServer

VEHICLE = Station(3, 1)
OVERTAKEN_S = 0.1
TICK_S = 0.01  # of the vehicle's main loop, which looks at its timers
_LIMIT_S = 3600.0
_HABITS = {Autopilot.ARDUPILOT: ARDUPILOT, Autopilot.PX4: PX4}


@dataclass(frozen=True)
class Weather:
    """A link: chances in either direction, and the round trip."""

    round_trip_s: float = 0.0
    loss: float = 0.0
    duplicate: float = 0.02
    reorder: float = 0.02


@dataclass(frozen=True)
class Arrived:
    """How a delivery ended. `held` is whether the vehicle truly holds the mission, whatever is believed."""

    error: GcsError | None
    held: bool
    sent_s: float  # until the last upload was over
    total_s: float  # until it was read back equal, or given up
    messages_up: int
    messages_down: int
    tries: int
    as_file: bool  # and not item by item, whether from the beginning or in the end


class Air:
    """A vehicle that holds an older mission, and the weather on the way to it."""

    def __init__(self, autopilot: Autopilot, weather: Weather, seed: int) -> None:
        self.autopilot = autopilot
        self.shelf = MissionStore(
            VEHICLE, _HABITS[autopilot], Origin(47.0, 8.0, 400.0), lambda *_: None, lambda *_: None
        )
        self.shelf._items[MissionType.MISSION] = mission_of(12, seed=-1)
        self.files = FileServer(MissionFiles(self.shelf)) if autopilot is Autopilot.ARDUPILOT else None
        self.weather = weather
        self.now_s = 0.0
        self.sent = {GROUND: 0, VEHICLE: 0}
        self._tick_s = 0.0
        self._random = random.Random(seed)
        self._under_way: list[tuple[float, int, Message]] = []
        self._order = itertools.count()

    def deliver(
        self,
        items: Sequence[MissionItem],
        round_trip: RttEstimator | None = None,
        transfer: Transfer = Transfer.ITEMS,
    ) -> Arrived:
        """Until the machine has ended. A vehicle that takes files is known to."""
        exchange = Exchange(VEHICLE, self.autopilot, round_trip=round_trip)
        by_items, as_file = VerifiedUpload(items, exchange), FileUpload(items, exchange)
        machine: Machine = by_items
        if planned(transfer, self.autopilot, MissionType.MISSION, len(items)).transfer is Transfer.FILE:
            machine = as_file if transfer is Transfer.FILE else Preferred(as_file, by_items)
        began_s = self.now_s
        self.run(machine)
        last = as_file if machine is not by_items and by_items.sent == 0 else by_items
        sent_s = self.now_s if last.sending_ended_s is None else last.sending_ended_s
        first = int(self.autopilot is Autopilot.ARDUPILOT)
        there = self.shelf.items()[first:]
        held = compare_missions(items[first:], there, autopilot=self.autopilot) == []
        ended_s = self.now_s
        return Arrived(
            machine.error,
            held,
            sent_s - began_s,
            ended_s - began_s,
            self.sent[GROUND],
            self.sent[VEHICLE],
            by_items.sent,
            last is as_file,
        )

    def run(self, machine: Machine) -> None:
        """Until this machine has ended."""
        began_s = self.now_s
        self._send(machine.start(self.now_s), GROUND)
        while not machine.done:
            self._step(machine)
            if self.now_s - began_s > _LIMIT_S:
                raise RuntimeError("the delivery does not end")

    def _step(self, machine: Machine) -> None:
        tick_s = self._tick_s if self.shelf.waits else float("inf")
        arrival_s = self._under_way[0][0] if self._under_way else float("inf")
        deadline_s = machine.deadline_s
        self.now_s = max(self.now_s, min(tick_s, arrival_s, float("inf") if deadline_s is None else deadline_s))
        while self._under_way and self._under_way[0][0] <= self.now_s:
            message = heapq.heappop(self._under_way)[2]
            if message.source == GROUND:
                answers = self.shelf.receive(message, self.now_s)
                answers += self.files.receive(message, self.now_s) if self.files is not None else []
                self._send(answers, VEHICLE)
            else:
                self._send(machine.receive(message, self.now_s), GROUND)
        if self.now_s >= tick_s:
            self._send(self.shelf.tick(self.now_s), VEHICLE)
            self._tick_s = self.now_s + TICK_S
        self._send(machine.tick(self.now_s), GROUND)

    def _send(self, messages: Sequence[Message], source: Station) -> None:
        weather, chance = self.weather, self._random.random
        for message in messages:
            self.sent[source] += 1
            if chance() < weather.loss:
                continue
            for _ in range(1 + (chance() < weather.duplicate)):
                late_s = weather.round_trip_s / 2 + (OVERTAKEN_S if chance() < weather.reorder else 0.0)
                copy = Message(message.name, dict(message.fields), *source)
                heapq.heappush(self._under_way, (self.now_s + late_s, next(self._order), copy))


def mission_of(count: int, seed: int) -> tuple[MissionItem, ...]:
    """So many items, home first; different for every seed."""
    random_ = random.Random(seed)

    def item(seq: int) -> MissionItem:
        if seq % 3 == 2:
            return MissionItem(178, 2, (1.0, round(random_.uniform(1, 9), 2), -1.0, 0.0), 0, 0, 0.0)
        place = random_.randrange(470_000_000, 470_100_000), random_.randrange(80_000_000, 80_100_000)
        return MissionItem(
            16, 3, (float(random_.randrange(9)), 0.0, 0.0, 0.0), *place, random_.randrange(500, 9000) / 100
        )

    return tuple(item(seq) for seq in range(count))
