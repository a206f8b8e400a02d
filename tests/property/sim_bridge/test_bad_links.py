"""Our ground station's transfers with both emulated autopilots over a bad link: what it believes is true."""

from __future__ import annotations

import heapq
import itertools
import random

from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError
from gcs.frames import Origin
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionType
from gcs.mission.model import MissionItem
from sim_bridge.missions.store import MissionStore
from sim_bridge.personality.ardupilot_missions import MISSIONS as ARDUPILOT
from sim_bridge.personality.px4_missions import MISSIONS as PX4

VEHICLE = Station(3, 1)
STEP_S = 0.02
LIMIT_S = 300.0
OLD = tuple(MissionItem(16, 3, (0.0,) * 4, 460000000 + n, 70000000, 7.0) for n in range(4))

HABITS = st.sampled_from([ARDUPILOT, PX4])
SEEDS = st.integers(0, 2**32)
LOSSES = st.sampled_from([0.0, 0.05, 0.2, 0.5, 1.0])
REPEATS = st.sampled_from([0.0, 0.3])
DELAYS_S = st.sampled_from([0.0, 0.05, 0.4])
MISSIONS = st.lists(
    st.builds(
        MissionItem,
        command=st.sampled_from([16, 21, 22]),
        frame=st.sampled_from([0, 3]),
        params=st.tuples(*[st.sampled_from([0.0, 1.0, 2.5])] * 4),
        lat_degE7=st.integers(-900000000, 900000000),
        lon_degE7=st.integers(-1800000000, 1800000000),
        alt_m=st.integers(0, 10000).map(lambda cm: cm / 100.0),
    ),
    min_size=1,
    max_size=6,
).map(tuple)


class World:
    """A shelf and the ground station's machines, with a link that loses, delays and repeats; all from one seed."""

    def __init__(self, habits, seed, loss, repeat, delay_s):
        self.shelf = MissionStore(VEHICLE, habits, Origin(47.0, 8.0, 400.0), lambda *_: None, lambda *_: None)
        self.random = random.Random(seed)
        self.loss, self.repeat, self.delay_s = loss, repeat, delay_s
        self.queue: list = []
        self.order = itertools.count()
        self.now_s = 0.0

    def send(self, messages, source):
        for message in messages:
            for _ in range(1 + (self.random.random() < self.repeat)):
                if self.random.random() >= self.loss:
                    at_s = self.now_s + self.random.uniform(0.0, self.delay_s)
                    copied = Message(message.name, dict(message.fields), *source)
                    heapq.heappush(self.queue, (at_s, next(self.order), copied))

    def run(self, machine):
        """Until the machine has ended."""
        self.send(machine.start(self.now_s), GROUND)
        end_s = self.now_s + LIMIT_S
        while not machine.done:
            assert self.now_s < end_s, "the transfer does not end"
            self.turn(machine)
        return machine

    def turn(self, machine=None):
        while self.queue and self.queue[0][0] <= self.now_s:
            _, _, message = heapq.heappop(self.queue)
            if message.source == GROUND:
                self.send(self.shelf.receive(message, self.now_s), VEHICLE)
            elif machine is not None:
                self.send(machine.receive(message, self.now_s), GROUND)
        self.send(self.shelf.tick(self.now_s), VEHICLE)
        if machine is not None:
            self.send(machine.tick(self.now_s), GROUND)
        self.now_s += STEP_S


@settings(max_examples=150, deadline=None)
@given(HABITS, SEEDS, LOSSES, REPEATS, DELAYS_S, MISSIONS)
def test_an_upload_that_is_believed_is_held_and_a_read_back_tells_what_is_held(
    habits, seed, loss, repeat, delay_s, items
):
    world = World(habits, seed, 0.0, 0.0, 0.0)
    world.run(MissionSender(OLD, Exchange(VEHICLE, estimates=False)))
    world.loss, world.repeat, world.delay_s = loss, repeat, delay_s
    first, firmware = (1, Autopilot.ARDUPILOT) if habits.home_is_item_0 else (0, Autopilot.PX4)
    sender = world.run(MissionSender(items, Exchange(VEHICLE, estimates=False)))
    assert sender.error is None or isinstance(sender.error, PeerError)
    if sender.error is None:
        assert compare_missions(items[first:], world.shelf.items()[first:], autopilot=firmware) == []
    else:  # whatever was left of the transfer ends by itself
        for _ in range(round(20.0 / STEP_S)):
            world.turn()
        assert not world.shelf.busy
    held = world.shelf.items()
    receiver = world.run(MissionReceiver(Exchange(VEHICLE, estimates=False)))
    assert receiver.error is None or isinstance(receiver.error, PeerError)
    if receiver.error is None:
        assert compare_missions(held, receiver.items, autopilot=firmware) == []
    assert world.shelf.items() == held


@settings(max_examples=60, deadline=None)
@given(HABITS, SEEDS, st.sampled_from([0.0, 0.05, 0.1]), st.sampled_from([0.0, 0.05]))
def test_a_fair_link_brings_every_type_across(habits, seed, loss, delay_s):
    world = World(habits, seed, loss, 0.0, delay_s)
    fence = tuple(MissionItem(5001, 0, (3.0, 0.0, 0.0, 0.0), 470000000 + n, 80000000, 0.0) for n in range(3))
    rally = (MissionItem(5100, 3, (0.0,) * 4, 470000000, 80000000, 10.0),)
    for kind, items in ((MissionType.MISSION, OLD), (MissionType.FENCE, fence), (MissionType.RALLY, rally)):
        for _ in range(5):
            sender = world.run(MissionSender(items, Exchange(VEHICLE, estimates=False), mission_type=kind))
            if len(world.shelf.items(kind)) == len(items) and not world.shelf.busy:
                break
            for _ in range(round(10.0 / STEP_S)):
                world.turn()
        assert len(world.shelf.items(kind)) == len(items), sender.error
