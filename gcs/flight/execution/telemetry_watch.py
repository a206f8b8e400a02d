"""Vehicles whose HEARTBEATs go on without telemetry, and vehicles that rebooted: both are asked for telemetry again.

A vehicle that rebooted sends only its default messages, on ArduPilot only HEARTBEATs. Its clock is then no longer known
here, and every wait for a time on board would not end. So these limits are local time. What was checked and read back
before a reboot may be gone: until a vehicle is armed, it ends the flight. Later its motors have stopped, which its
HEARTBEATs show (`IncidentKind.MOTORS_STOPPED`).
"""

import asyncio
import math
from collections.abc import Callable, Mapping
from contextlib import suppress

from gcs.errors import FlightError, PeerError
from gcs.flight.execution.fleet_landing import Custody, named
from gcs.flight.execution.takeoff_landing import FlightVehicle, request_telemetry
from gcs.link.session.vehicle_session import VehicleSession
from gcs.util.aio import LOOK_S, ended

ASK_S = 3.0  # without telemetry, and between two attempts
LIMIT_S = 20.0  # a real ArduPilot answers 3 s after it rebooted
FRESH_S = 2.0  # no vehicle is armed with an older report
_BEATS_S = 2.5  # a HEARTBEAT comes once a second
_STAMPED = ("LOCAL_POSITION_NED", "SYSTEM_TIME")  # asked of every vehicle


class TelemetryWatch:
    """The telemetry of all vehicles of a flight."""

    def __init__(
        self, vehicles: Mapping[int, FlightVehicle], custody: Custody, report: Callable[[int, str, str], None]
    ) -> None:
        self._checked = False
        self._vehicles = vehicles
        self._custody = custody
        self._report = report
        self._restarts = {sysid: vehicle.session.clock.restarts for sysid, vehicle in vehicles.items()}
        self._asking: dict[int, asyncio.Future[None]] = {}
        self._asked = dict.fromkeys(vehicles, 0)  # attempts in this silence
        self._loop = asyncio.get_running_loop()

    def refuse_reboots(self) -> None:
        """The vehicles are checked: from now on a reboot before arming ends the flight."""
        self._checked = True

    async def run(self) -> None:
        """Look until cancelled. Raises `FlightError` for a reboot before arming, or a silence longer than `LIMIT_S`."""
        try:
            while True:
                await asyncio.sleep(LOOK_S)
                for sysid, vehicle in self._vehicles.items():
                    self._look(sysid, vehicle)
                mute = [i for i, vehicle in self._vehicles.items() if self._mute_s(vehicle.session) > LIMIT_S]
                if mute and (len(mute) == len(self._vehicles) or not self._any_armed()):
                    raise FlightError(
                        f"{named(mute)} sent HEARTBEATs but neither position nor time for {LIMIT_S:g} s, asked again "
                        f"{max(self._asked[i] for i in mute)} times.",
                        hint="restart it, check its link, then fly again",
                    )
        finally:
            await ended(*self._asking.values())

    def refuse_stale(self) -> None:
        """Raises `FlightError` if a vehicle's last report is older than `FRESH_S`: it may have rebooted since."""
        for sysid, vehicle in self._vehicles.items():
            silent_s = self._silent_s(vehicle.session)
            if silent_s > FRESH_S:
                raise FlightError(
                    f"vehicle {sysid} is not armed: its last report is {silent_s:.1f} s old (limit {FRESH_S:g} s).",
                    hint="it may have rebooted, or its link is bad; fly again",
                )

    def _look(self, sysid: int, vehicle: FlightVehicle) -> None:
        session = vehicle.session
        if self._mute_s(session) == 0.0:
            self._asked[sysid] = 0
        elif self._mute_s(session) > ASK_S * (1 + self._asked[sysid]) and not self._is_asking(sysid):
            self._asked[sysid] += 1
            self._ask(sysid, vehicle)
            if self._asked[sysid] == 1:
                self._report(sysid, "sends HEARTBEATs only", "Its telemetry is asked for again")
        if session.clock.restarts == self._restarts[sysid]:
            return
        self._restarts[sysid] = session.clock.restarts
        newest = max((name for name in _STAMPED if name in session.latest), key=session.latest_s.__getitem__)
        what = f"rebooted {(float(session.latest[newest].fields['time_boot_ms']) / 1e3):.0f} s ago"
        if self._checked and not self._any_armed():
            raise FlightError(
                f"vehicle {sysid} {what}: what was checked and read back may be gone.",
                hint="fly again: all is repeated",
            )
        self._report(sysid, what, "Its telemetry is asked for again")
        if not self._is_asking(sysid):
            self._ask(sysid, vehicle)

    def _any_armed(self) -> bool:
        return any(map(self._custody.holds, self._vehicles))

    def _is_asking(self, sysid: int) -> bool:
        return sysid in self._asking and not self._asking[sysid].done()

    def _ask(self, sysid: int, vehicle: FlightVehicle) -> None:
        async def ask() -> None:
            with suppress(PeerError):  # it may not be up yet
                await request_telemetry(vehicle)

        self._asking[sysid] = asyncio.ensure_future(ask())

    def _silent_s(self, session: VehicleSession) -> float:
        """Local time since its last report with a time; infinite before the first."""
        return self._loop.time() - max(session.latest_s.get(name, -math.inf) for name in _STAMPED)

    def _mute_s(self, session: VehicleSession) -> float:
        """How long HEARTBEATs have come alone; 0 while a report is as young as they are, or was never asked for."""
        silent_s = self._silent_s(session)
        return silent_s if _BEATS_S < silent_s < math.inf and session.heartbeat_age_s() < _BEATS_S else 0.0
