"""MAVSDK in place of our own machines, behind the same interface; only this module and `backend_mavsdk_flight` know it.

Knows: its plugins for missions and parameters, its names of links. Does not know: MAVLink messages.
It cannot sign, and has timers of its own. Its calls block and run in threads; one that was given up ends with its own
patience. Success is its word only, so here too everything is read back and compared.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Collection, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from typing import Any, TypeVar

import mavsdk
from mavsdk.plugins import mission_raw, param, telemetry

from gcs.autopilots.traits import Autopilot, link_behaviour
from gcs.errors import LinkError, PeerError, PeerTimeout
from gcs.link.endpoints.base import LinkMode, parse_link_spec
from gcs.link.mavsdk.mavsdk_flight import MavsdkControl, report
from gcs.link.microservices.parameter import REAL32, Parameter
from gcs.link.mission_protocol.item_messages import with_home
from gcs.link.mission_protocol.read_back import compare_missions
from gcs.link.session.status_report import VehicleReport
from gcs.mavlink import GENERIC_AUTOPILOT, MissionType
from gcs.mission.model import Home, MissionItem, VehicleMission

T = TypeVar("T")
_INT32 = 6
_LOOK_S = 0.05
_FORGOTTEN_S, _AGAIN_S = 12.0, 0.5
_BEAT_S = 1.5  # heartbeats come once a second
_SCHEMES = {LinkMode.LISTEN: "udpin", LinkMode.CALL: "udpout", LinkMode.TCP: "tcpout", LinkMode.SERIAL: "serial"}
_AUTOPILOTS = {theirs: Autopilot[theirs.name] for theirs in mavsdk.Autopilot if theirs.name in Autopilot.__members__}


class MavsdkVehicle:
    """One of MAVSDK's systems, as `gcs.link.session.vehicle_api.Loadable` has it."""

    def __init__(self, system: Any) -> None:
        self.sysid = int(system.get_system_id())
        self._system = system
        self._missions = mission_raw.MissionRaw(system)
        self._params = param.Param(system)
        self._telemetry = telemetry.Telemetry(system)
        self._heard = False
        self._telemetry.subscribe_armed(self._hear)
        self._lock = asyncio.Lock()

    def _hear(self, *_: Any) -> None:
        self._heard = True

    @property
    def heard(self) -> bool:
        """Whether a heartbeat came since it was found: before, MAVSDK calls everybody disarmed."""
        return self._heard

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT."""
        return int(_AUTOPILOTS.get(self._system.autopilot_type(), GENERIC_AUTOPILOT))

    @property
    def armed(self) -> bool:
        """Whether its last heartbeat says so."""
        return bool(self._telemetry.armed())

    @property
    def home_is_item_0(self) -> bool:
        """Whether its missions carry home as item 0."""
        return link_behaviour(self.autopilot).home_is_item_0

    def heartbeat_age_s(self) -> float:
        """0, or infinite once MAVSDK calls it lost."""
        return 0.0 if self._system.is_connected() else float("inf")

    async def deliver(self, items: Sequence[MissionItem], mission_type: int = MissionType.MISSION) -> None:
        """Uploads once, reads back and compares."""
        raw = [_raw(seq, item, mission_type) for seq, item in enumerate(items)]
        if not raw:
            await self._clear()
        elif mission_type == MissionType.FENCE:
            await self.call("upload its fence", lambda: self._missions.upload_geofence(raw))
        elif mission_type == MissionType.RALLY:
            await self.call("upload its rally points", lambda: self._missions.upload_rally_points(raw))
        else:
            await self.call("upload its mission", lambda: self._missions.upload_mission(raw))
        first = int(self.home_is_item_0 and mission_type == MissionType.MISSION)
        held = await self.download(mission_type)
        differences = compare_missions(items[first:], held[first:], autopilot=self.autopilot)
        if differences:
            raise PeerError(f"vehicle {self.sysid} does not hold what it was sent: {differences[0]}.")

    async def _clear(self) -> None:
        """What MAVSDK was told to give up may go on on board: PX4 answers "busy" until it has forgotten that."""
        end_s = time.monotonic() + _FORGOTTEN_S
        while True:
            try:
                return await self.call("clear what it holds", self._missions.clear_mission)
            except PeerError:
                if time.monotonic() > end_s:
                    raise
            await asyncio.sleep(_AGAIN_S)

    async def upload_mission(self, mission: VehicleMission) -> None:
        """Delivers a mission, with home where the autopilot wants it."""
        await self.deliver(with_home(mission.items, mission.home) if self.home_is_item_0 else mission.items)

    async def download(self, mission_type: int = MissionType.MISSION) -> tuple[MissionItem, ...]:
        """What the vehicle holds."""
        downloads = {
            MissionType.MISSION: self._missions.download_mission,
            MissionType.FENCE: self._missions.download_geofence,
            MissionType.RALLY: self._missions.download_rallypoints,
        }
        try:
            raw = await self.call("download what it holds", downloads[MissionType(mission_type)])
        except PeerError as error:
            if "NO_MISSION_AVAILABLE" in error.message:  # how it says that there are none
                return ()
            raise
        return tuple(_item(one) for one in raw)

    async def read_parameters(self, names: Sequence[str]) -> dict[str, Parameter]:
        """Parameters by name; MAVSDK tells a whole number only from one that is none, so both are tried."""
        return {name: await self.call(f"read {name}", partial(self._read, name)) for name in names}

    async def write_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Sets parameters, and reads each again."""
        for wanted in parameters:
            put = self._params.set_param_float if wanted.kind == REAL32 else self._params.set_param_int
            await self.call(f"set {wanted.name}", partial(put, wanted.name, wanted.value))
            found = (await self.read_parameters([wanted.name]))[wanted.name]
            if not wanted.same_value(found):
                raise PeerError(f"vehicle {self.sysid} was told {wanted}, and keeps {found.value}.")

    async def home(self) -> Home | None:
        """Where its home is, as last told."""
        place = self._telemetry.home()
        if place is None or place.latitude_deg != place.latitude_deg:
            return None
        return Home(place.latitude_deg, place.longitude_deg, place.absolute_altitude_m)

    def close(self) -> None:
        """Let go of the plugins."""
        for plugin in (self._missions, self._params, self._telemetry):
            plugin.destroy()

    def _read(self, name: str) -> Parameter:
        try:
            return Parameter(name, int(self._params.get_param_int(name)), _INT32)
        except Exception:  # it has a float's type, or is not there: the next call tells
            return Parameter(name, float(self._params.get_param_float(name)), REAL32)

    def hands(self) -> MavsdkControl:
        """What it can be asked in flight; to be closed by whoever asks."""
        return MavsdkControl(self.sysid, self._system, self.call)

    async def report(self) -> VehicleReport:
        """What it tells of itself."""
        return await report(self.sysid, self._system, self.autopilot, self.call)

    async def call(self, what: str, call: Callable[[], T]) -> T:
        """One of MAVSDK's calls that block, in a thread, one at a time. Raises `PeerError` with its reason."""
        async with self._lock:
            work = asyncio.ensure_future(asyncio.to_thread(call))
            try:
                return await asyncio.shield(work)
            except asyncio.CancelledError:
                self._missions.cancel_mission_upload()
                await asyncio.wait({work})  # MAVSDK must not be taken away under a call
                work.exception()
                raise
            except Exception as error:  # MAVSDK's plugins have an exception class each
                reason = str(error).partition(";")[0]
                raise PeerError(f"vehicle {self.sysid}: MAVSDK could not {what}: {reason}.") from None


class MavsdkFleet:
    """What `gcs.link.session.linked_fleet.Fleet` is for loading, on MAVSDK."""

    def __init__(self, sdk: Any) -> None:
        self._sdk = sdk
        self._known: dict[int, MavsdkVehicle] = {}

    @classmethod
    @asynccontextmanager
    async def open(cls, specs: Sequence[str]) -> AsyncIterator[MavsdkFleet]:
        """Opens links by our names for them. Raises `UsageError`, `LinkError`."""
        urls = [mavsdk_url(spec) for spec in specs]
        station = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
        sdk = mavsdk.Mavsdk(station)
        fleet: MavsdkFleet | None = None
        try:
            for spec, url in zip(specs, urls, strict=True):
                result = sdk.add_any_connection(url)
                if result != mavsdk.ConnectionResult.SUCCESS:
                    raise LinkError(f"MAVSDK cannot open {spec}: {result.name}.", hint="check host, port and network")
            fleet = cls(sdk)
            yield fleet
        finally:
            if fleet is not None:
                fleet.close()
            sdk.destroy()

    async def vehicles(
        self, sysids: Collection[int], timeout_s: float, *, systems: Mapping[int, int] | None = None
    ) -> dict[int, MavsdkVehicle]:
        """These vehicles, once each has been heard. Raises `PeerTimeout` that names the silent ones."""
        system_of = {sysid: (systems or {}).get(sysid, sysid) for sysid in sorted(sysids)}
        end_s = time.monotonic() + timeout_s
        while missing := [s for s, system in system_of.items() if not self._is_heard(system)]:
            if time.monotonic() > end_s:
                silent = ", ".join(map(str, missing))
                raise PeerTimeout(f"no heartbeat from vehicles {silent} within {timeout_s:g} s.")
            await asyncio.sleep(_LOOK_S)
        found = {sysid: self._known[system] for sysid, system in system_of.items()}
        for sysid, vehicle in found.items():
            vehicle.sysid = sysid
        return found

    async def listen(self, duration_s: float) -> dict[int, MavsdkVehicle]:
        """Whoever is heard within `duration_s`, by system id."""
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s:
            self._look()
            await asyncio.sleep(_LOOK_S)
        while not all(vehicle.heard for vehicle in self.known) and time.monotonic() < end_s + _BEAT_S:
            await asyncio.sleep(_LOOK_S)
        return {system: vehicle for system, vehicle in sorted(self._known.items()) if vehicle.heard}

    @property
    def known(self) -> tuple[MavsdkVehicle, ...]:
        """Everybody heard so far, by system id."""
        return tuple(vehicle for _, vehicle in sorted(self._known.items()))

    def close(self) -> None:
        """Let go of the plugins before MAVSDK goes."""
        for vehicle in self._known.values():
            vehicle.close()

    def check(self) -> None:
        """MAVSDK does not tell two vehicles with one id apart."""

    def _is_heard(self, system: int) -> bool:
        vehicle = self._look().get(system)
        return vehicle is not None and vehicle.heard

    def _look(self) -> dict[int, MavsdkVehicle]:
        for system in self._sdk.get_systems():
            if system.is_connected() and system.has_autopilot() and system.get_system_id() not in self._known:
                self._known[system.get_system_id()] = MavsdkVehicle(system)
        return self._known


def mavsdk_url(spec: str) -> str:
    """A link as MAVSDK writes it. Raises `UsageError`."""
    link = parse_link_spec(spec)
    return f"{_SCHEMES[link.mode]}://{link.host}:{link.port}"


def _raw(seq: int, item: MissionItem, mission_type: int) -> Any:
    params = (float(p) for p in item.params)
    place = (item.lat_degE7, item.lon_degE7, item.alt_m)
    auto = int(item.autocontinue)
    return mission_raw.MissionItem(seq, item.frame, item.command, int(seq == 0), auto, *params, *place, mission_type)


def _item(raw: Any) -> MissionItem:
    params = (raw.param1, raw.param2, raw.param3, raw.param4)
    frame = {5: 0, 6: 3, 11: 10}.get(raw.frame, raw.frame)
    return MissionItem(raw.command, frame, params, raw.x, raw.y, raw.z, bool(raw.autocontinue))
