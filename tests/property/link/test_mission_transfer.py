"""Two machines joined by a bad link on a fake clock: the same mission, or a typed error on each side."""

import heapq
import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.protocol_timers import STANDARD, MissionTimers, ProtocolTimers
from gcs.errors import PeerError
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mission.model import MissionItem

VEHICLE = Station(1, 1)
LIMIT_S = 1e4


class Link:
    """Delivers after a random delay, so reorders; loses; repeats. All from one seed."""

    def __init__(self, seed, loss, repeat, delay_s):
        self.rng = random.Random(seed)
        self.loss, self.repeat, self.delay_s = loss, repeat, delay_s
        self.queue, self.order = [], itertools.count()

    def send(self, messages, source, target, now_s):
        for message in messages:
            copies = 1 + (self.rng.random() < self.repeat)
            for _ in range(copies):
                if self.rng.random() >= self.loss:
                    at_s = now_s + self.rng.uniform(0.0, self.delay_s)
                    arriving = Message(message.name, message.fields, source.sysid, source.compid)
                    heapq.heappush(self.queue, (at_s, next(self.order), target, arriving))


def run(machines, link, opening):
    """`machines`: station -> machine. Runs until both are done and the link is empty."""
    peers = {GROUND: VEHICLE, VEHICLE: GROUND}
    now_s = 0.0
    link.send(machines[opening].start(now_s), opening, peers[opening], now_s)
    while True:
        deadlines = [m.deadline_s for m in machines.values() if m is not None and m.deadline_s is not None]
        arrival_s = link.queue[0][0] if link.queue else float("inf")
        next_s = min([arrival_s, *deadlines])
        if next_s == float("inf"):
            return
        now_s = max(now_s, next_s)
        assert now_s < LIMIT_S, "the transfer does not end"
        if arrival_s <= now_s:
            _, _, target, message = heapq.heappop(link.queue)
            if target == VEHICLE and machines[VEHICLE] is None:
                machines[VEHICLE] = vehicle_machine(message, machines)
                if machines[VEHICLE] is None:
                    continue
                if message.name == "MISSION_REQUEST_LIST":
                    link.send(machines[VEHICLE].start(now_s), target, peers[target], now_s)
                    continue
            link.send(machines[target].receive(message, now_s), target, peers[target], now_s)
        for station, machine in machines.items():
            if machine is not None:
                link.send(machine.tick(now_s), station, peers[station], now_s)


def vehicle_side(timers):
    return Exchange(GROUND, me=VEHICLE, timers=ProtocolTimers(mission=timers), estimates=False)


def vehicle_machine(message, machines):
    if message.name == "MISSION_COUNT":
        return MissionReceiver(vehicle_side(machines["timers"]))
    if message.name == "MISSION_REQUEST_LIST":
        return MissionSender(machines["items"], vehicle_side(machines["timers"]))
    return None


class Machines(dict):
    """The two stations' machines, beside what the vehicle needs to make its own."""

    def __init__(self, ground, timers, items):
        super().__init__({GROUND: ground, VEHICLE: None})
        self.extra = {"timers": timers, "items": items}

    def __missing__(self, key):
        return self.extra[key]


MISSIONS = st.lists(
    st.builds(
        MissionItem,
        command=st.sampled_from([16, 21, 22, 178]),
        frame=st.sampled_from([0, 2, 3, 10]),
        params=st.tuples(*[st.floats(-100, 100, width=32)] * 4),
        lat_degE7=st.integers(-900000000, 900000000),
        lon_degE7=st.integers(-1800000000, 1800000000),
        alt_m=st.floats(-100, 1000, width=32),
    ),
    max_size=8,
).map(tuple)
LINKS = st.builds(
    Link,
    st.integers(0, 2**32),
    loss=st.sampled_from([0.0, 0.0, 0.1, 0.3, 0.6, 1.0]),
    repeat=st.sampled_from([0.0, 0.2, 0.9]),
    delay_s=st.sampled_from([0.001, 0.1, 0.4, 2.0]),
)
TIMERS = st.sampled_from([STANDARD.mission, MissionTimers(reply_s=1.0, item_s=1.0, retries=8, give_up_s=8.0)])


def judge(sender, receiver, items):
    for machine in (sender, receiver):
        if machine is not None:
            assert machine.done
            assert machine.error is None or isinstance(machine.error, PeerError)
    if receiver is not None and receiver.error is None:
        assert receiver.items == items
    if sender is not None and sender.error is None:
        assert receiver is not None
        assert receiver.error is None


def upload(items, link, timers):
    machines = Machines(MissionSender(items, Exchange(VEHICLE, estimates=False)), timers, items)
    run(machines, link, GROUND)
    judge(machines[GROUND], machines[VEHICLE], items)


def download(items, link, timers):
    machines = Machines(MissionReceiver(Exchange(VEHICLE, estimates=False)), timers, items)
    run(machines, link, GROUND)
    judge(machines[VEHICLE], machines[GROUND], items)


@pytest.mark.parametrize("examples", [50, pytest.param(300, marks=pytest.mark.slow)])
@pytest.mark.parametrize("transfer", [upload, download])
def test_on_a_bad_link_the_same_mission_arrives_or_both_sides_know(transfer, examples):
    settings(max_examples=examples, deadline=None)(given(MISSIONS, LINKS, TIMERS)(transfer))()


@pytest.mark.parametrize("count", [0, 1, 200])
@pytest.mark.parametrize("delay_s", [0.001, 0.1])
def test_a_clean_link_always_succeeds(count, delay_s):
    items = tuple(MissionItem(16, 3, (0.0,) * 4, n, n, 1.0) for n in range(count))
    for make in (
        MissionSender(items, Exchange(VEHICLE, estimates=False)),
        MissionReceiver(Exchange(VEHICLE, estimates=False)),
    ):
        machines = Machines(make, STANDARD.mission, items)
        run(machines, Link(1, 0.0, 0.0, delay_s), GROUND)
        assert machines[GROUND].error is None
        assert machines[VEHICLE].error is None


def test_a_fifth_lost_is_survived_nearly_always():
    items = tuple(MissionItem(16, 3, (0.0,) * 4, n, n, 1.0) for n in range(10))
    good = 0
    for seed in range(100):
        machines = Machines(MissionSender(items, Exchange(VEHICLE, estimates=False)), STANDARD.mission, items)
        run(machines, Link(seed, 0.2, 0.1, 0.05), GROUND)
        good += machines[GROUND].error is None
    assert good >= 90
