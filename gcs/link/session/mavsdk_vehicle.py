"""The MAVSDK backend, with the interface of our own sessions: missions, fences, rally points and parameters.

MAVSDK cannot sign and has timers of its own. Its calls block and run in threads; a cancelled call ends with the timeout
of MAVSDK. Its success is no proof, so here too everything is read back and compared.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable, Collection, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from functools import partial
from typing import TypeVar

import mavsdk
from mavsdk.plugins import mission_raw, param, telemetry

from gcs.autopilots.parameter_names import spellings
from gcs.autopilots.traits import Autopilot, link_behaviour
from gcs.errors import LinkError, PeerError, PeerTimeout, UsageError
from gcs.link.endpoints.base import LinkMode, parse_link_spec
from gcs.link.protocols.mission.item_messages import file_frame, with_home
from gcs.link.protocols.mission.read_back import compare_missions, read_back_error
from gcs.link.protocols.mission.strategy import SentAs, Transfer
from gcs.link.protocols.parameter_transfer import REAL32, Parameter
from gcs.link.session.mavsdk_flight import MavsdkControl, report
from gcs.link.session.status_report import VehicleReport
from gcs.link.wire.message import Station
from gcs.mavlink import GENERIC_AUTOPILOT, MissionType, ParameterType
from gcs.mission.model import Home, MissionItem, VehicleMission

T = TypeVar("T")
_LOOK_S = 0.05
_BUSY_MAX_S, _RETRY_S = 12.0, 0.5
_HEARTBEAT_WAIT_S = 1.5  # heartbeats arrive once a second
_SCHEMES = {LinkMode.LISTEN: "udpin", LinkMode.CALL: "udpout", LinkMode.TCP: "tcpout", LinkMode.SERIAL: "serial"}
_AUTOPILOTS = {theirs: Autopilot[theirs.name] for theirs in mavsdk.Autopilot if theirs.name in Autopilot.__members__}


class MavsdkVehicle:
    """One system of MAVSDK with the interface `gcs.link.session.vehicle_api.Loadable`."""

    def __init__(self, system: mavsdk.System) -> None:
        self.sysid = int(system.get_system_id())
        self._system = system
        self._missions = mission_raw.MissionRaw(system)
        self._params = param.Param(system)
        self._telemetry = telemetry.Telemetry(system)
        self._heard = False
        self._telemetry.subscribe_armed(self._note_heartbeat)
        self._lock = asyncio.Lock()

    def _note_heartbeat(self, *_: object) -> None:
        self._heard = True

    @property
    def heard(self) -> bool:
        """Whether a heartbeat has arrived. Before the first one, MAVSDK reports every vehicle as disarmed."""
        return self._heard

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT."""
        return int(_AUTOPILOTS.get(self._system.autopilot_type(), GENERIC_AUTOPILOT))

    @property
    def armed(self) -> bool:
        """Whether it is armed, by its last heartbeat."""
        return bool(self._telemetry.armed())

    @property
    def home_is_item_0(self) -> bool:
        """Whether item 0 of its missions is home."""
        return link_behaviour(self.autopilot).home_is_item_0

    @property
    def sent_as(self) -> SentAs:
        """How its missions go."""
        return SentAs(Transfer.ITEMS, "the MAVSDK backend sends items")

    def heartbeat_age_s(self) -> float:
        """Return 0, or infinity once MAVSDK reports it as lost."""
        return 0.0 if self._system.is_connected() else float("inf")

    async def upload_items(self, items: Sequence[MissionItem], mission_type: int = MissionType.MISSION) -> None:
        """Upload items once, read them back and compare."""
        raw = [_raw(seq, item, mission_type) for seq, item in enumerate(items)]
        if not raw:
            on_board = await self._cleared(mission_type)
        elif mission_type == MissionType.FENCE:
            await self.call("upload its fence", lambda: self._missions.upload_geofence(raw))
        elif mission_type == MissionType.RALLY:
            await self.call("upload its rally points", lambda: self._missions.upload_rally_points(raw))
        else:
            await self.call("upload its mission", lambda: self._missions.upload_mission(raw))
        first = int(self.home_is_item_0 and mission_type == MissionType.MISSION)
        if raw:
            on_board = await self.download(mission_type)
        differences = compare_missions(items[first:], on_board[first:], autopilot=self.autopilot)
        if differences:
            raise read_back_error(Station(self.sysid, 1), mission_type, differences)

    async def _cleared(self, mission_type: int) -> tuple[MissionItem, ...]:
        """Clear all items, and return what is still on board.

        PX4 answers "busy" to both requests until it has forgotten a transfer that MAVSDK cancelled.
        """
        end_s = time.monotonic() + _BUSY_MAX_S
        while True:
            try:
                await self.call("clear its items", self._missions.clear_mission)
                return await self.download(mission_type)
            except PeerError:
                if time.monotonic() > end_s:
                    raise
            await asyncio.sleep(_RETRY_S)

    async def upload_mission(self, mission: VehicleMission) -> None:
        """Upload a mission, with home as item 0 if the autopilot requires it."""
        await self.upload_items(with_home(mission.items, mission.home) if self.home_is_item_0 else mission.items)

    async def download(self, mission_type: int = MissionType.MISSION) -> tuple[MissionItem, ...]:
        """Return the items on board."""
        downloads = {
            MissionType.MISSION: self._missions.download_mission,
            MissionType.FENCE: self._missions.download_geofence,
            MissionType.RALLY: self._missions.download_rallypoints,
        }
        try:
            raw = await self.call("download its items", downloads[MissionType(mission_type)])
        except PeerError as error:
            refusal = getattr(error.__cause__, "result", None)
            if refusal is mission_raw.MissionRawResult.NO_MISSION_AVAILABLE:  # MAVSDK's answer for an empty mission
                return ()
            raise
        return tuple(_item(one) for one in raw)

    async def read_parameters(self, names: Sequence[str]) -> dict[str, Parameter]:
        """Return parameters by the requested names, each with the name and unit that this vehicle has for it.

        MAVSDK has one call for integers and one for floats, so both are tried.
        """
        return {name: await self._read_any(spellings(self.autopilot, name)) for name in names}

    async def write_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Set parameters and read each one back."""
        for wanted in parameters:
            setter = self._params.set_param_float if wanted.kind == REAL32 else self._params.set_param_int
            await self.call(f"set {wanted.name}", partial(setter, wanted.name, wanted.value))
            found = await self.call(f"read {wanted.name}", partial(self._read, wanted.name))
            if not wanted.same_value(found):
                raise PeerError(f"vehicle {self.sysid} did not set {wanted}: it reports {found.value}.")

    async def home(self) -> Home | None:
        """Return its last reported home position."""
        home = self._telemetry.home()
        if home is None or math.isnan(home.latitude_deg):
            return None
        return Home(home.latitude_deg, home.longitude_deg, home.absolute_altitude_m)

    def close(self) -> None:
        """Destroy the plugins."""
        for plugin in (self._missions, self._params, self._telemetry):
            plugin.destroy()

    async def _read_any(self, names: tuple[str, ...]) -> Parameter:
        for name in names[:-1]:
            with suppress(PeerError):
                return await self.call(f"read {name}", partial(self._read, name))
        return await self.call(f"read {' or '.join(names)}", partial(self._read, names[-1]))

    def _read(self, name: str) -> Parameter:
        try:
            return Parameter(name, int(self._params.get_param_int(name)), int(ParameterType.INT32))
        except Exception:  # a float, or unknown: the next call decides
            return Parameter(name, float(self._params.get_param_float(name)), REAL32)

    def control(self) -> MavsdkControl:
        """Return the control of the vehicle in flight. The caller closes it."""
        return MavsdkControl(self.sysid, self._system, self.call)

    async def report(self) -> VehicleReport:
        """Return its status report."""
        return await report(self.sysid, self._system, self.autopilot, self.call)

    async def call(self, what: str, call: Callable[[], T]) -> T:
        """Run a blocking call of MAVSDK in a thread, one at a time. Raises `PeerError` with its reason."""
        async with self._lock:
            work = asyncio.ensure_future(asyncio.to_thread(call))
            try:
                return await asyncio.shield(work)
            except asyncio.CancelledError:
                self._missions.cancel_mission_upload()
                await asyncio.wait({work})  # MAVSDK must not be destroyed during a call
                work.exception()
                raise
            except Exception as error:  # MAVSDK's plugins have an exception class each
                result = getattr(error, "result", None)
                reason = error if result is None else result.name
                raise PeerError(f"vehicle {self.sysid}: MAVSDK could not {what}: {reason}.") from error


class MavsdkFleet:
    """All vehicles on the links of MAVSDK, with the interface of `gcs.link.session.linked_fleet.LinkedFleet`."""

    def __init__(self, sdk: mavsdk.Mavsdk) -> None:
        self._sdk = sdk
        self._known: dict[int, MavsdkVehicle] = {}

    @classmethod
    @asynccontextmanager
    async def open(cls, specs: Sequence[str]) -> AsyncIterator[MavsdkFleet]:
        """Open links by their names (see `parse_link_spec`). Raises `UsageError`, `LinkError`."""
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
        """Return these vehicles once each has sent a heartbeat. Raises `PeerTimeout` that names the silent ones."""
        system_of = {sysid: (systems or {}).get(sysid, sysid) for sysid in sorted(sysids)}
        end_s = time.monotonic() + timeout_s
        while missing := [s for s, system in system_of.items() if not self._is_heard(system)]:
            if time.monotonic() > end_s:
                silent = ", ".join(map(str, missing))
                raise PeerTimeout(
                    f"no heartbeat from vehicles {silent} within {timeout_s:g} s.",
                    hint="start them, or check the address and port that they send to",
                )
            await asyncio.sleep(_LOOK_S)
        found = {sysid: self._known[system] for sysid, system in system_of.items()}
        for sysid, vehicle in found.items():
            vehicle.sysid = sysid
        return found

    async def listen(self, duration_s: float) -> dict[int, MavsdkVehicle]:
        """Return all vehicles heard within `duration_s`, by system id."""
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s:
            self._look()
            await asyncio.sleep(_LOOK_S)
        while not all(vehicle.heard for vehicle in self.known) and time.monotonic() < end_s + _HEARTBEAT_WAIT_S:
            await asyncio.sleep(_LOOK_S)
        return {system: vehicle for system, vehicle in sorted(self._known.items()) if vehicle.heard}

    @property
    def known(self) -> tuple[MavsdkVehicle, ...]:
        """All vehicles found so far, by system id."""
        return tuple(vehicle for _, vehicle in sorted(self._known.items()))

    def close(self) -> None:
        """Destroy all plugins, which must precede the end of MAVSDK."""
        for vehicle in self._known.values():
            vehicle.close()

    def check(self) -> None:
        """Do nothing: MAVSDK cannot distinguish two vehicles with one system id."""

    def refused_words(self) -> str:
        """Return nothing: MAVSDK has no signing."""
        return ""

    def _is_heard(self, system: int) -> bool:
        vehicle = self._look().get(system)
        return vehicle is not None and vehicle.heard

    def _look(self) -> dict[int, MavsdkVehicle]:
        for system in self._sdk.get_systems():
            if system.is_connected() and system.has_autopilot() and system.get_system_id() not in self._known:
                self._known[system.get_system_id()] = MavsdkVehicle(system)
        return self._known


def mavsdk_url(spec: str) -> str:
    """Return the name of a link in the form of MAVSDK. Raises `UsageError`."""
    link = parse_link_spec(spec)
    if ":" in link.host and link.mode is not LinkMode.SERIAL:
        raise UsageError(f"MAVSDK has no IPv6: {spec}.", hint="use an IPv4 address, or --backend skein")
    return f"{_SCHEMES[link.mode]}://{link.host}:{link.port}"


def _raw(seq: int, item: MissionItem, mission_type: int) -> mission_raw.MissionItem:
    params = (float(p) for p in item.params)
    position = (item.lat_degE7, item.lon_degE7, item.alt_m)
    auto = int(item.autocontinue)
    return mission_raw.MissionItem(seq, item.frame, item.command, int(seq == 0), auto, *params, *position, mission_type)


def _item(raw: mission_raw.MissionItem) -> MissionItem:
    params = (raw.param1, raw.param2, raw.param3, raw.param4)
    return MissionItem(raw.command, file_frame(raw.frame), params, raw.x, raw.y, raw.z, bool(raw.autocontinue))
