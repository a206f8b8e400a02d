"""Emulated vehicles for programs, above all for tests of ground software. They run in a thread of their own.

async with Fleet("missions/field", vehicles=2, speedup=10) as fleet:      # or plain `with`
    host, port = fleet.address(1)
    ...                                                                    # connect, upload, arm
    await fleet.until(lambda: fleet.state(1).flying)
"""

import asyncio
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeVar

from gcs.errors import GcsError, UsageError
from gcs.link.endpoints.addresses import Address
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.types import Array
from sim_bridge.dynamics.presets import FIELD
from sim_bridge.dynamics.wind_field import parse_wind
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.personality import by_name
from sim_bridge.protocol.endpoint_address import LOOPBACK, PeerAddress, parse_link
from sim_bridge.sim.world import World, WorldOptions

T = TypeVar("T")
_POLL_S = 0.01  # wall time between two checks of a condition
_STOP_S = 10.0
SPACING_M = 5.0
_FAR_M = 2000.0
_HOVER_M = 10.0


@dataclass(frozen=True)
class TrueState:
    """The true state of one vehicle at simulated time `t_s`, which no telemetry shows."""

    t_s: float
    position_ned_m: Array  # (3,) in the local frame that all vehicles share
    velocity_ned_mps: Array  # (3,)
    roll_pitch_yaw_rad: Array  # (3,)
    rates_radps: Array  # (3,)
    armed: bool
    flying: bool
    landed: bool  # in contact with the ground
    mode: str


class NotInTime(GcsError):
    """A condition was not met within its timeout."""

    exit_code = 8


class Fleet:
    """Vehicles on links of this machine. `sysids` and `places` (their addresses) are valid from the start."""

    def __init__(
        self,
        scenario: Scenario | Path | str | None = None,
        *,
        vehicles: int | None = None,
        autopilot: str | None = None,
        links: Sequence[str] = ("udpin:0",),
        one_port: bool = False,
        bind: str = LOOPBACK,
        speedup: float = 1.0,
        seed: int = 0,
        faults: Iterable[str] = (),
        wind: str = "",
        gusts: str = "",
        epoch_unix_s: float | None = None,
    ) -> None:
        """Emulate a scenario, a mission folder, or six vehicles on a level field; `vehicles` sets another number.

        `autopilot` is "ardupilot" or "px4". `links`, `faults`, `wind` and `gusts` are as on the command line. With
        `one_port` all vehicles share one port of each link. `speedup` is times real time, math.inf for as fast as
        possible. `epoch_unix_s` is the vehicles' GNSS time at the start. Raises `GcsError` for invalid arguments.
        """
        known = scenario_for(scenario, vehicles)
        options = WorldOptions(
            links=[parse_link(link, bind=bind, shared=one_port) for link in links],
            speedup=speedup,
            seed=seed,
            faults=parse_faults(faults, known.formation.sysids),
            epoch_unix_s=epoch_unix_s,
            personality=by_name(autopilot) if autopilot is not None else None,
            wind=parse_wind(wind, gusts),
        )
        self._world = World(known, options)
        self.sysids: tuple[int, ...] = self._world.sysids
        self.places: dict[int, list[PeerAddress]] = self._world.places
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self._fly, name="emulated vehicles", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the vehicles. Raises any error of their thread."""
        self._world.stop()
        if self._thread is not None:
            self._thread.join(_STOP_S)
        self._world.close()
        if self._failure is not None:
            raise self._failure

    async def __aenter__(self) -> Self:
        return self.__enter__()

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.__exit__)

    def address(self, sysid: int, link: int = 0) -> Address:
        """Return host and port of a vehicle on one of its links. Raises `UsageError` for a link without ports."""
        place = self._place(sysid, link)
        if not place.port:
            raise UsageError(f"vehicle {sysid} is at {place.address}, which has no port.", hint="use path() for a pty")
        return place.address.rpartition(":")[0].strip("[]"), place.port

    def path(self, sysid: int, link: int = 0) -> Path:
        """Return the terminal of a vehicle on one of its links."""
        return Path(self._place(sysid, link).address)

    @property
    def t_s(self) -> float:
        """Simulated time."""
        return self._world.t_s

    def state(self, sysid: int) -> TrueState:
        """Return the true state of a vehicle, now."""
        row = self._row(sysid)
        return self._ask(lambda world: _state(world, row))

    def states(self) -> dict[int, TrueState]:
        """Return the true states of all vehicles at one time."""
        return self._ask(lambda world: {s: _state(world, row) for row, s in enumerate(self.sysids)})

    def fault(self, text: str) -> None:
        """Begin a fault, written as on the command line; its times count from now. Raises `UsageError`."""
        found = parse_faults([text], self.sysids)

        def begin(world: World) -> None:
            for sysid, faults in found.items():
                for fault in faults:
                    world.injector.add(self._row(sysid), fault, world.t_s)

        self._ask(begin)

    def wait_until(self, condition: Callable[[], bool], patience_s: float = 60.0) -> None:
        """Wait until `condition` is true, at most `patience_s` of simulated time. Raises `NotInTime`."""
        end_s = self.t_s + patience_s
        while not condition():
            self._check(end_s, patience_s)
            time.sleep(_POLL_S)

    async def until(self, condition: Callable[[], bool], patience_s: float = 60.0) -> None:
        """As `wait_until`, for coroutines."""
        end_s = self.t_s + patience_s
        while not condition():
            self._check(end_s, patience_s)
            await asyncio.sleep(_POLL_S)

    def _check(self, end_s: float, patience_s: float) -> None:
        if self._failure is not None:
            raise self._failure
        if self.t_s > end_s:
            raise NotInTime(f"the condition was not met within {patience_s:g} s of simulated time.")

    def _place(self, sysid: int, link: int) -> PeerAddress:
        return self.places[self.sysids[self._row(sysid)]][link]

    def _row(self, sysid: int) -> int:
        if sysid not in self.sysids:
            ids = ", ".join(map(str, self.sysids))
            raise UsageError(f"vehicle {sysid} is not in this fleet, which has {ids}.")
        return self.sysids.index(sysid)

    def _ask(self, question: Callable[[World], T]) -> T:
        """Return the answer of the world's own thread, given between two steps."""
        if self._thread is None or not self._thread.is_alive():
            if self._failure is not None:
                raise self._failure
            return question(self._world)
        answer: Future[T] = Future()

        def work() -> None:
            try:
                answer.set_result(question(self._world))
            except BaseException as error:
                answer.set_exception(error)

        self._world.call(work)
        return answer.result(_STOP_S)

    def _fly(self) -> None:
        try:
            self._world.run()
        except BaseException as failure:
            self._failure = failure


def _state(world: World, row: int) -> TrueState:
    truth, autopilot = world.airframes.truth[row].copy(), world.vehicles[row].autopilot
    return TrueState(
        t_s=world.t_s,
        position_ned_m=truth[:3],
        velocity_ned_mps=truth[3:6],
        roll_pitch_yaw_rad=truth[6:9],
        rates_radps=truth[9:12],
        armed=autopilot.armed,
        flying=autopilot.flying,
        landed=bool(world.airframes.landed[row]),
        mode=autopilot.mode.name,
    )


def scenario_for(scenario: Scenario | Path | str | None, vehicles: int | None) -> Scenario:
    """Return the given, loaded or default scenario with `vehicles` vehicles, if that number is given.

    A smaller number takes the first vehicles of the scenario; a larger one places them on a grid. Raises
    `ScenarioError` or `UsageError`.
    """
    if vehicles is not None and vehicles < 1:
        raise UsageError(f"a fleet needs at least 1 vehicle, not {vehicles}.", hint="set vehicles to 1 or more")
    if scenario is None:
        return plain_scenario(6 if vehicles is None else vehicles)
    known = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    if vehicles is None or vehicles == len(known.formation.sysids):
        return known
    data = known.model_dump(mode="json")
    listed = data["formation"]["vehicle"]
    if vehicles < len(listed):
        data["formation"] = {"leader": listed[0]["sysid"], "vehicle": listed[:vehicles]}
    else:
        data["formation"] = _grid(vehicles)
    return Scenario.model_validate(data)


def plain_scenario(vehicles: int) -> Scenario:
    """Return a scenario of `field` vehicles with RTK-grade receivers, `SPACING_M` apart, on level ground."""
    body = FIELD.quadrotor
    data = {
        "schema_version": 1,
        "name": "plain",
        "origin": {"lat_deg": -35.363262, "lon_deg": 149.165237, "alt_amsl_m": 584.0},
        "time": {"flight_s": 60.0},
        "vehicle": {
            "name": FIELD.name,
            **{name: getattr(body, name) for name in type(body).__dataclass_fields__ if name != "wind"},
        },
        "limits": {
            "north_m": [-_FAR_M, _FAR_M],
            "east_m": [-_FAR_M, _FAR_M],
            "height_m": [0.0, 120.0],
            "speed_ned_mps": [10.0, 10.0, 2.5],
            "roll_pitch_yaw_deg": [25.0, 25.0, 180.0],
            "rates_degps": [45.0, 45.0, 30.0],
            "thrust_N": [4.0, FIELD.limits.thrust_N],
            "roll_pitch_force_N": list(FIELD.limits.torque[:2]),
            "yaw_moment_Nm": FIELD.limits.torque[2],
            "clearance_min_m": 0.0,
            "load_factor_max": 0.3,
            "separation_min_m": 1.0,
        },
        "start": {"position_m": [0.0, 0.0, _HOVER_M]},
        "end": {"position_m": [50.0, 0.0, _HOVER_M]},
        "objective": {
            "weights": [1.0, 0.0, 0.0],
            "terminal_weight": "1/(tf-t+0.5)",
            "heading_ref_deg": 0.0,
            "height_ref_m": _HOVER_M,
        },
        "formation": _grid(vehicles),
        "ground_phases": {"takeoff_s": 10.0, "landing_s": 20.0},
        "sensors": {"grade": "rtk"},
        "judge": {"separation_min_m": 1.0, "arrival_position_m": 2.0, "position_rms_m": 2.0},
    }
    return Scenario.model_validate(data)


def _grid(vehicles: int) -> dict[str, object]:
    shape = {"name": "grid", "generator": "grid", "spacing_m": SPACING_M}
    return {"leader": 1, "count": vehicles, "start_shape": "grid", "shape": [shape]}
