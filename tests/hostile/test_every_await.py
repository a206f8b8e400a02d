"""An exception is raised wherever a flight waits: afterwards every vehicle that it armed is down, or handed over."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution import streamer
from gcs.flight.execution.fleet_landing import HANDED_OVER
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.monitoring.progress import Event, FlightHooks, Step
from gcs.flight.setup.build_loads import PreparedFlight, missions_only
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.sources.load import load_scenario
from gcs.util.aio import Stoppable, Stopped
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import WorldOptions
from tests.bridge.flying import LEAD_S, step_aside
from tests.fleets import TURN_S, emulated, free_port
from tests.hostile.conftest import all_down
from tests.hostile.raising import Place, Raising
from tests.virtual_clock import VirtualClock, VirtualLoop

FAILURES: dict[str, Callable[[], BaseException]] = {
    "RuntimeError": lambda: RuntimeError("raised by a test"),
    "MemoryError": MemoryError,
    "OSError": lambda: OSError(28, "No space left on device"),
    "CancelledError": asyncio.CancelledError,
    "KeyboardInterrupt": KeyboardInterrupt,
}

CONTINGENCY, LANDING = "flight/execution/executor.py", "flight/execution/fleet_landing.py"
EXPECTED = {
    "RuntimeError": RuntimeError,
    "MemoryError": MemoryError,
    "OSError": OSError,
    "CancelledError": (GcsError, asyncio.CancelledError),
    "KeyboardInterrupt": KeyboardInterrupt,
}


@dataclass
class Flight:
    """What became of a flight, and how the place counted where it was to fail."""

    raising: Raising
    error: BaseException | None = None
    events: list[Event] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    armed: bool = False  # a vehicle was armed at any time


@pytest.fixture(scope="module")
def aside(repo_root: Path) -> Plan:
    return make_plan(step_aside(load_scenario(repo_root / "missions" / "field")))


def fly(plan: Plan, raising: Raising, *, hooks: FlightHooks | None = None) -> Flight:
    """Fly emulated vehicles until the flight has ended, by itself or by what was raised, and wait until they are down.

    Fails if one that was armed is neither down nor handed over.
    """
    found = Flight(raising)
    port, clock = free_port(), VirtualClock()
    with (
        patch.object(streamer, "_EMULATED_WAIT_S", CONTROL_PERIOD_S),  # nothing becomes due between two steps
        patch("gcs.util.aio.SteadyLoop", lambda: VirtualLoop(TURN_S, clock)),
        emulated(plan.scenario, WorldOptions(links=(call(port),)), clock) as world,
    ):

        async def run() -> None:
            asyncio.get_running_loop().set_task_factory(raising)
            await asyncio.ensure_future(_fly(plan, port, found, hooks))

        try:
            Stoppable().run(run())
        except BaseException as error:
            found.error = error
        left = {event.sysid for event in found.events if event.what == HANDED_OVER}
        if not left:
            down = world.airframes.landed.all() and not any(v.autopilot.armed for v in world.vehicles)
            assert down, f"armed vehicles were left alone: {found}"
        clock.wait_until(lambda: all_down(world) or bool(left))
    return found


async def _fly(plan: Plan, port: int, found: Flight, hooks: FlightHooks | None) -> None:
    async with LinkedFleet(f"udpin:127.0.0.1:{port}").open() as fleet:
        sessions = await fleet.vehicles(plan.sysids, 20.0)
        for session in sessions.values():
            session.subscribe(lambda _: setattr(found, "armed", found.armed or any(s.armed for s in sessions.values())))
        flight = FlightSequence(
            plan,
            sessions,
            FlightOptions(lead_s=LEAD_S),
            PreparedFlight(
                missions_only(build_missions(plan)),
                build_stream(plan, plan.scenario.mission.setpoint_rate_hz),
                plan_returns(plan, (Autopilot.ARDUPILOT,) * len(plan.sysids)),
            ),
            hooks or FlightHooks(found.events.append, lambda step, _: found.steps.append(step)),
        )
        await flight.run()


@pytest.fixture(scope="module")
def undisturbed(aside: Plan) -> Flight:
    flown = fly(aside, Raising())
    assert flown.error is None
    assert flown.steps[-1] is Step.DONE
    return flown


def points(flown: Flight) -> list[tuple[Place, int]]:
    """Return where to raise: every place, when it is resumed first and when half of its resumptions are over."""
    return [(place, nth) for place, n in sorted(flown.raising.places.items()) for nth in sorted({1, n // 2 + 1})]


def survives(plan: Plan, place: Place, nth: int, kind: str) -> None:
    """One flight with one failure."""
    flown = fly(plan, Raising(place, nth, FAILURES[kind]()))
    where = f"{kind} at {place[0]}:{place[1]}, time {nth}: {flown.error!r} after {flown.steps}"
    print(where, *map(str, flown.events), sep="\n  ")
    if flown.error is None:  # the flight could do without what failed
        assert flown.steps[-1] is Step.DONE, where
    elif Step.TAKEOFF not in flown.steps:
        assert not flown.armed, where
    else:
        assert isinstance(flown.error, EXPECTED[kind]), where


@pytest.mark.parametrize(("seed", "count"), [pytest.param(17, 12, marks=pytest.mark.slow)])
def test_whatever_fails_while_vehicles_fly_they_land(aside: Plan, undisturbed: Flight, seed: int, count: int) -> None:
    """A choice of places and failures; the long form has all of them."""
    chance = random.Random(seed)
    some = chance.sample(points(undisturbed), count)
    for number, (place, nth) in enumerate(some):
        survives(aside, place, nth, list(FAILURES)[number % len(FAILURES)])


@pytest.mark.long
@pytest.mark.parametrize("kind", FAILURES)
def test_whatever_fails_anywhere_all_vehicles_land(aside: Plan, undisturbed: Flight, kind: str) -> None:
    for place, nth in points(undisturbed):
        survives(aside, place, nth, kind)


@pytest.mark.parametrize("kind", [pytest.param("RuntimeError", marks=pytest.mark.slow), "KeyboardInterrupt"])
def test_a_landing_that_fails_itself_is_begun_again(aside: Plan, kind: str) -> None:
    """The contingency policy fails in flight, and so does the landing that follows, while it waits for the ground."""
    raising = Raising(CONTINGENCY, 60, RuntimeError("raised by a test"))
    raising.more[LANDING] = FAILURES[kind]()
    flown = fly(aside, raising)
    assert isinstance(flown.error, RuntimeError | Stopped)
    assert not raising.more
    assert "landing interrupted" in [event.what for event in flown.events]


@pytest.mark.long
def test_reports_that_fail_do_not_reach_the_flight(aside: Plan, caplog: pytest.LogCaptureFixture) -> None:
    """Neither the events nor the steps of this flight can be written anywhere."""

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    flown = fly(aside, Raising(), hooks=FlightHooks(full, full))
    assert flown.error is None
    assert [record.message.count("No space left on device") for record in caplog.records] == [1]
