"""Where a flight's frames, events, notices and steps go while it lasts: into its record, and to the operator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.flight.monitoring.progress import Event, Step, notice_event, spared
from gcs.flight.recording.flight_folder import TELEMETRY
from gcs.flight.recording.flight_record import FlightRecord
from gcs.flight.recording.flight_state import FlightState
from gcs.link.protocols.mission.strategy import SentAs, sent_data
from gcs.link.session.linked_fleet import FrameDirection
from gcs.link.session.unknown_systems import LinkNotice


class FlightJournal:
    """The journal of one flight; close its `record` after it. A failing screen does not reach the flight.

    `state` is written to `flight.json` with the next step.
    """

    def __init__(
        self,
        folder: Path,
        state: FlightState,
        say: Callable[[str], None],
        warn: Callable[[str], None],
        telemetry: str = TELEMETRY,
    ) -> None:
        self.state = state
        self.say = spared(say, "the screen")
        self._warn = spared(warn, "the screen")
        self.record = FlightRecord(folder, self._warn, self._now_s, telemetry)
        self.on_frame: Callable[[FrameDirection, bytes], None] = spared(self.record.write_frame, telemetry, self.say)
        self.on_notice: Callable[[LinkNotice], None] = spared(self._notice, "the report of events")
        self._time: FleetTime | None = None

    def keep_time(self, time: FleetTime) -> None:
        """Date frames and notices by this time from now on."""
        self._time = time

    def on_event(self, event: Event) -> None:
        """Record an event, and say it; an alarm is a warning."""
        self.record.write_event(event)
        (self._warn if event.alarm else self.say)(str(event))

    def on_step(self, step: Step, t0_unix_s: float | None) -> None:
        """Record that a step began; T0 stays the last known one."""
        self.state = replace(self.state, step=step.value, t0_unix_s=t0_unix_s or self.state.t0_unix_s)
        self.record.write_state(self.state)

    def on_sent(self, sent: Mapping[int, SentAs]) -> None:
        """Note how each mission was sent."""
        self.state = replace(self.state, missions=tuple(sent_data(sent)))

    def _now_s(self) -> float | None:
        return None if self._time is None else self._time.now_s()

    def _notice(self, notice: LinkNotice) -> None:
        self.on_event(notice_event(notice, self.state.systems, self._now_s(), self.state.t0_unix_s))
