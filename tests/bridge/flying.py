"""Whole flights for tests: three vehicles over level ground for half a minute, emulated in this process."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution import streamer
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.monitoring.progress import Event, FlightHooks, FlightTimes, Step
from gcs.flight.recording.flight_record import FlightRecord
from gcs.flight.setup.build_loads import PreparedFlight, build_loads, missions_only
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.returns.rtl_altitudes import ReturnPlan, plan_returns
from gcs.mission.waypoints.mission_items import build_missions
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import World, WorldOptions
from tests.fleets import EPOCH_UNIX_S, TURN_S, emulated, free_port
from tests.virtual_clock import VirtualClock, VirtualLoop

LEAD_S = 0.2
_RETURNS: dict[tuple[str, tuple[Autopilot, ...]], ReturnPlan] = {}


def hop_scenario(field_scenario: Scenario) -> Scenario:
    """Three of the field's vehicles, 5 m apart, 60 m to the north and 20 m to the east at 8 m, with good receivers."""
    data = field_scenario.model_dump(mode="json")
    data.update(name="hop", title="Hop", no_fly=[])
    data["time"]["flight_s"] = 30.0
    data["terrain"] = {}
    data["sensors"]["grade"] = "rtk"
    data["limits"].update(clearance_min_m=3.0, separation_min_m=3.0)
    data["start"]["position_m"] = [0.0, 0.0, 8.0]
    data["end"]["position_m"] = [60.0, 20.0, 8.0]
    data["objective"]["height_ref_m"] = 8.0
    places = ([0.0, 0.0, 8.0], [-4.33, -2.5, 8.0], [-4.33, 2.5, 8.0])
    data["formation"]["vehicle"] = [{"sysid": n, "position_m": place} for n, place in enumerate(places, start=1)]
    data["ground_phases"].update(takeoff_s=12.0, hover_s=4.0, landing_s=15.0)
    data["mission"].update(setpoint_rate_hz=25.0, tolerance_m=0.2)
    data["judge"] = {
        "separation_min_m": 2.0,
        "arrival_time_s": 1.0,
        "arrival_position_m": 0.5,
        "position_rms_m": 0.3,
    }
    return Scenario.model_validate(data)


def step_aside(field_scenario: Scenario) -> Scenario:
    """Two vehicles, 8 m, twelve seconds."""
    data = hop_scenario(field_scenario).model_dump(mode="json")
    data["formation"]["vehicle"] = data["formation"]["vehicle"][:2]
    data["time"]["flight_s"] = 12.0
    data["end"]["position_m"] = [8.0, 0.0, 8.0]
    data["ground_phases"].update(takeoff_s=10.0, hover_s=1.0, landing_s=12.0)
    return Scenario.model_validate(data)


def mixed_scenario(field_scenario: Scenario) -> Scenario:
    """Four vehicles step aside in the same way; 1 and 3 run ArduCopter, 2 and 4 run PX4."""
    data = step_aside(field_scenario).model_dump(mode="json")
    data.update(name="mixed", title="Mixed")
    vehicles = data["formation"]["vehicle"] = hop_scenario(field_scenario).model_dump(mode="json")["formation"][
        "vehicle"
    ]
    vehicles.append({"sysid": 4, "position_m": [-8.66, 0.0, 8.0]})
    for row in (1, 3):
        vehicles[row]["autopilot"] = "px4"
    return Scenario.model_validate(data)


def returns_of(plan: Plan, autopilots: tuple[Autopilot, ...]) -> ReturnPlan:
    """The returns of a plan, computed once: a flight would start a process for it."""
    key = (plan.hash, autopilots)
    if key not in _RETURNS:
        _RETURNS[key] = plan_returns(plan, autopilots)
    return _RETURNS[key]


def is_order(event: Event) -> bool:
    """Whether an event is an order, not an incident."""
    return event.what == "released" or event.what.startswith("ordered to ")


@dataclass
class Flown:
    """What became of a flight. Positions are true ones."""

    plan: Plan
    flight: FlightSequence
    world: World
    times: FlightTimes | None = None
    error: GcsError | None = None
    stopped: bool = False
    events: list[Event] = field(default_factory=list)

    def orders(self, sysid: int) -> list[str]:
        """The orders to a vehicle, oldest first; "released" where it is left to its own autopilot."""
        return [e.what.removeprefix("ordered to ") for e in self.events if e.sysid == sysid and is_order(e)]

    def happened(self, sysid: int) -> list[str]:
        """The incidents of a vehicle, oldest first, without what it says itself."""
        own = [e.what for e in self.events if e.sysid == sysid and not is_order(e)]
        return [what for what in own if not what.startswith("reports: ")]

    def said(self, sysid: int) -> list[str]:
        """The alarms that a vehicle says in words, oldest first."""
        return [e.what for e in self.events if e.sysid == sysid and e.what.startswith("reports: ")]

    def at_s(self, sysid: int, what: str) -> float:
        """Plan time of an event."""
        return next(e.t_s for e in self.events if e.sysid == sysid and e.what == what)

    @property
    def t_s(self) -> Array:
        """Plan times of the true states (N,)."""
        truth = self.world.truth
        assert truth is not None
        assert self.flight.monitor.t0_unix_s is not None
        return np.asarray(truth.t_s) + EPOCH_UNIX_S - self.flight.monitor.t0_unix_s

    @property
    def places(self) -> Array:
        """True positions (V, N, 3)."""
        truth = self.world.truth
        assert truth is not None
        return np.asarray(truth.state[..., POSITION])

    @property
    def planned(self) -> Array:
        """Where the plan has them at the same instants (V, N, 3)."""
        t_s = np.clip(self.t_s, self.plan.t_start_s, np.nextafter(self.plan.t_end_s, -np.inf))
        return self.plan.states(t_s)[..., POSITION]

    def formation_error_m(self) -> Array:
        """Definition 1 at those instants (N,)."""
        t_s = np.clip(self.t_s, self.plan.t_start_s, np.nextafter(self.plan.t_end_s, -np.inf))
        return self.plan.formation_error_m(t_s, self.places)


def fly(
    plan: Plan,
    *faults: str,
    during: Callable[[World, FlightSequence], Any] | None = None,
    safety: bool = False,
    folder: Path | None = None,
    until: Callable[[World], bool] | None = None,
    stop: tuple[Step, float] | None = None,
    enough: Callable[[FlightSequence], bool] | None = None,
    **options: Any,
) -> Flown:
    """Fly a plan in virtual time with faults of the emulated vehicles; `during` is called after each of their steps.

    With `safety` fences, rally points and parameters are loaded as well; `folder` gets the telemetry; vehicles go on
    until `until` is true. `stop` ends it as Ctrl-C does, so many seconds after the beginning of a step, `enough` as
    soon as it is true.
    """
    port, clock = free_port(), VirtualClock()
    world_options = WorldOptions(links=(call(port),), faults=parse_faults(faults, plan.sysids), record_truth=True)
    with (
        patch.object(streamer, "_EMULATED_WAIT_S", CONTROL_PERIOD_S),  # nothing becomes due between two steps
        emulated(plan.scenario, world_options, clock) as world,
        asyncio.Runner(loop_factory=partial(VirtualLoop, TURN_S, clock)) as runner,
    ):
        mode = options.pop("mode", FlightMode.STREAM)
        settings = FlightOptions(mode=mode, lead_s=LEAD_S, **options)
        flown = runner.run(_fly(plan, world, port, settings, during, safety, folder, stop, enough))
        if until is not None:
            clock.wait_until(lambda: until(world))
        return flown


async def _fly(
    plan: Plan,
    world: World,
    port: int,
    options: FlightOptions,
    during: Callable[[World, FlightSequence], Any] | None,
    safety: bool,
    folder: Path | None,
    stop: tuple[Step, float] | None,
    enough: Callable[[FlightSequence], bool] | None,
) -> Flown:
    async with AsyncExitStack() as stack:
        record = None if folder is None else stack.enter_context(FlightRecord(folder, print, lambda: None))
        on_frame = None if record is None else record.write_frame
        fleet = await stack.enter_async_context(LinkedFleet(f"udpin:127.0.0.1:{port}", on_frame=on_frame).open())
        sessions = await fleet.vehicles(plan.sysids, 20.0)
        events: list[Event] = []
        stream = build_stream(plan, plan.scenario.mission.setpoint_rate_hz)
        autopilots = {sysid: session.autopilot for sysid, session in sessions.items()}
        loads = build_loads(plan, autopilots, timed=False) if safety else missions_only(build_missions(plan))

        def step(now: Step, t0_unix_s: float | None) -> None:
            if stop is not None and now is stop[0]:
                for again_s in (0.0, 0.02, 0.2):  # people press Ctrl-C more than once
                    asyncio.get_running_loop().call_later(stop[1] + again_s, work.cancel)

        flight = FlightSequence(
            plan,
            sessions,
            options,
            PreparedFlight(
                loads, stream, returns_of(plan, tuple(Autopilot(autopilots[sysid]) for sysid in plan.sysids))
            ),
            FlightHooks(events.append, step),
        )
        flown = Flown(plan, flight, world, events=events)
        looking = asyncio.ensure_future(_look(world, flight, during))
        work = asyncio.ensure_future(flight.run())
        watching = asyncio.ensure_future(_cancel_when(enough, flight, work))
        try:
            flown.times = await work
        except GcsError as error:
            flown.error = error
        except asyncio.CancelledError:
            flown.stopped = True
        finally:
            looking.cancel()
            watching.cancel()
        return flown


def say(world: World, sysid: int, name: str, **fields: Any) -> None:
    """Have a vehicle hear this from another ground station, over a good link."""
    vehicle = world.vehicles[world.sysids.index(sysid)]
    message = Message(name, {"target_system": sysid, "target_component": 1} | fields, 254, 190)
    world.call(lambda: vehicle.receive(message, world.options.clock()))


def take_over(world: World, sysid: int, mode: int) -> None:
    """Have a pilot put a vehicle into a mode."""
    params = {"param1": 1.0, "param2": float(mode)} | {f"param{n}": 0.0 for n in range(3, 8)}
    say(world, sysid, "COMMAND_LONG", command=int(MavCommand.DO_SET_MODE), confirmation=0, **params)


async def _cancel_when(
    enough: Callable[[FlightSequence], bool] | None, flight: FlightSequence, work: asyncio.Future[Any]
) -> None:
    while enough is not None and not work.done():
        if enough(flight):
            work.cancel()
        await asyncio.sleep(0.01)


async def _look(world: World, flight: FlightSequence, during: Callable[[World, FlightSequence], Any] | None) -> None:
    while during is not None:
        during(world, flight)
        await asyncio.sleep(CONTROL_PERIOD_S)
