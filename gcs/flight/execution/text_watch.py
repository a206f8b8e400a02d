"""Alarms in STATUSTEXTs during a flight: each is an event, and no vehicle is armed after a critical one.

A text is an alarm if its severity is WARNING or worse, or if the autopilot's table has it as a grave one.

A text that a vehicle repeats is an event again after `REPEAT_S`, with the number of times. `telemetry.tlog` has every
one.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial

from gcs.autopilots.alarms import GRAVE
from gcs.autopilots.traits import traits_of
from gcs.errors import FlightError
from gcs.flight.monitoring.monitor import Monitor
from gcs.flight.monitoring.preflight_check import CheckName
from gcs.flight.monitoring.progress import Event
from gcs.link.protocols.statustext import StatusText
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mavlink import Severity
from gcs.mavlink_names import severity_name

REPEAT_S = 30.0  # vehicle time
_TOLD_MAX = 256  # texts


class TextWatch:
    """The alarms that the vehicles of a flight say in words."""

    def __init__(
        self, sessions: Mapping[int, VehicleSession], monitor: Monitor, on_event: Callable[[Event], None]
    ) -> None:
        self._sessions = sessions
        self._monitor = monitor
        self._on_event = on_event
        self._reported: dict[tuple[int, str], tuple[float, int]] = {}  # when it was an event, times since

    def start(self) -> Callable[[], None]:
        """Report alarms, those since each vehicle was found included. Return the function that ends this."""
        stops = []
        for sysid, session in self._sessions.items():
            for at_s, said in tuple(session.texts.kept):
                self._receive(sysid, at_s, said)
            stops.append(session.texts.subscribe(partial(self._receive, sysid)))

        def stop() -> None:
            for end in stops:
                end()

        return stop

    def refuse(self, sysid: int | None = None) -> None:
        """Raises `FlightError` if this vehicle, or any, has sent a critical text since it was found."""
        for vehicle, session in self._sessions.items():
            texts = session.texts.critical(session.ready_since_s)
            if texts and sysid in (None, vehicle):
                raise FlightError(
                    f"vehicle {vehicle} reports before it is armed: {'; '.join(texts)}.",
                    hint=f"remove the cause, then fly again; `--waive {CheckName.MESSAGES}` ignores such texts for one "
                    "flight",
                )

    def _receive(self, sysid: int, at_s: float, said: StatusText) -> None:
        row = traits_of(self._sessions[sysid].autopilot)
        alarm = None if row is None else row.flight.alarms.alarm(said.text)
        if alarm not in GRAVE and said.severity > Severity.WARNING:
            return
        unix_s = self._sessions[sysid].clock.now_unix_s(at_s)
        now_s = at_s if unix_s is None else unix_s
        reported_s, times = self._reported.get((sysid, said.text), (-math.inf, 0))
        if abs(now_s - reported_s) < REPEAT_S:  # further back, the vehicle's clock was set
            self._reported[sysid, said.text] = reported_s, times + 1
            return
        self._reported.pop((sysid, said.text), None)
        self._reported[sysid, said.text] = now_s, 0
        if len(self._reported) > _TOLD_MAX:  # a vehicle that says something new each time
            del self._reported[next(iter(self._reported))]
        t0_s = self._monitor.t0_unix_s
        t_s = math.nan if unix_s is None or t0_s is None else unix_s - t0_s
        again = f" ({times + 1} times since)" if times else ""
        what = f"reports: {severity_name(said.severity)}: {said.text.strip()}{again}"
        rule = "" if alarm is None else f"Alarm: {alarm}"
        self._on_event(Event(math.nan if unix_s is None else unix_s, t_s, sysid, what, rule, alarm=True))
