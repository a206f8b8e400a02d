"""The current mission item, and what the vehicle reports about it (MISSION_CURRENT, MISSION_ITEM_REACHED).

Paths (`sim_bridge.autopilot.guidance.path_generator`) count items as ArduPilot does: home is item 0. For an autopilot
without that item, one is added in front.
"""

import math
from collections.abc import Sequence
from enum import IntEnum

from gcs.mavlink import MavResult
from gcs.mission.model import Command, Frame, MissionItem
from sim_bridge.autopilot.events import EventQueue, Reached
from sim_bridge.autopilot.guidance.mission_guidance import is_navigation
from sim_bridge.autopilot.guidance.piece import Mark
from sim_bridge.personality import Intent, Note
from sim_bridge.personality.table import ReportTraits

_MANOEUVRES = frozenset({Intent.TAKEOFF, Intent.LAND})
_PLACEHOLDER = MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL, (0.0,) * 4, 0, 0, 0.0)


class MissionState(IntEnum):
    """MISSION_STATE."""

    UNKNOWN = 0
    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class MissionProgress:
    """`items` as stored, `seq` the current item, `running` while the mission is flown."""

    def __init__(self, reports: ReportTraits, home_is_item_0: bool, event_queue: EventQueue) -> None:
        self._reports = reports
        self._event_queue = event_queue
        self._shift = 0 if home_is_item_0 else 1
        self.items: tuple[MissionItem, ...] = ()
        self.seq = 0
        self.running = False
        self.finished = False
        self._begun = False
        self._flown: tuple[MissionItem, ...] = ()  # the items when the mission began
        self._announced: int | None = None  # the last item whose beginning was reported
        self._repeated: Reached | None = None
        self._repeats_left = 0
        self._repeat_s = math.inf

    @property
    def first(self) -> int:
        """The first item that is not home."""
        return 1 - self._shift

    @property
    def counted(self) -> int:
        """MISSION_CURRENT.total."""
        items = len(self.items) - (0 if self._reports.counts_home else self.first)
        return items if items > 0 else self._reports.empty_total

    def hold(self, items: Sequence[MissionItem]) -> None:
        """Store these items. A mission under way is flown to its end unchanged."""
        self.items = tuple(items)
        if not self.running:
            self.seq, self.finished, self._begun = 0, False, False

    def select(self, seq: int) -> MavResult:
        """Make item `seq` the current one, or the next item that moves the vehicle."""
        if not 0 <= seq < len(self.items):
            return MavResult.DENIED
        seq = max(seq, self.first) if len(self.items) > self.first else seq
        while seq + 1 < len(self.items) and not is_navigation(self.items[seq].command):
            seq += 1
        self.seq, self.finished = seq, False
        return MavResult.ACCEPTED

    def next_command(self) -> int | None:
        """The command of the next item that moves the vehicle, or None."""
        ahead = (item.command for item in self.items[max(self.seq, self.first) :])
        return next((command for command in ahead if is_navigation(command)), None)

    @property
    def padded(self) -> tuple[tuple[MissionItem, ...], int]:
        """The items and the current number, counted as paths count them."""
        return (*(_PLACEHOLDER,) * self._shift, *self.items), self.seq + self._shift

    def begin(self, *, anew: bool = True) -> None:
        """Start flying the mission. Unless `anew`, it was already being flown."""
        self.running, self.finished, self._begun = True, False, True
        self._flown = self.items
        if anew:
            self._repeated = self._announced = None

    def stop(self) -> None:
        """The mission is not flown any more; it has not ended."""
        self.running = False

    def pass_mark(self, mark: Mark) -> None:
        """Record that an item was completed, or that one begins."""
        if mark.reached is not None:
            self.reached(mark.reached - self._shift)
            if self._flown[self.seq].command == Command.NAV_WAYPOINT:
                self._event_queue.add_text(Note.WAYPOINT_REACHED, seq=self.seq)
            for seq in range(self.seq + 1, mark.reached - self._shift + 1):
                self._announce_item(seq)
        if mark.current is not None:
            self.seq = mark.current - self._shift
            self._announce_item(self.seq)

    def reached(self, seq: int) -> None:
        """Report item `seq` as reached."""
        self._repeated = Reached(seq)
        self._repeats_left, self._repeat_s = self._reports.repeats, -math.inf
        self._event_queue.add(self._repeated)

    def descends(self) -> None:
        """Record that the descent of a landing begins."""
        if self.running and self._reports.reports_landing:
            self.reached(self.seq)

    def manoeuvred(self, intent: Intent) -> None:
        """Record the end of a take-off or a landing that was not part of a mission."""
        if self._reports.counts_manoeuvres and intent in _MANOEUVRES:
            self.finished = True

    def land(self, intent: Intent) -> None:
        """Record the landing: the mission, or what was flown for `intent`, has ended."""
        if self.running:
            self._event_queue.add_text(Note.MISSION_ENDS)
            self.running, self.finished = False, True
        self.manoeuvred(intent)

    def start_over(self) -> None:
        """After the landing make the first item current again, where the autopilot does so."""
        if self.finished and self._reports.starts_over:
            self.seq, self.finished, self._announced = self._first_moving(), False, None
            self.announce_current()

    def announce_current(self) -> None:
        """Report the current item as the next one to be flown."""
        self._begun = True
        if not self.running:
            self._flown = self.items
        ahead = range(max(self.seq, self.first), len(self._flown))
        self.seq = next((seq for seq in ahead if is_navigation(self._flown[seq].command)), self.seq)
        if self.seq < len(self._flown):
            self._announce_item(self.seq)

    def step(self, t_s: float) -> None:
        """Repeat MISSION_ITEM_REACHED, where the autopilot does so."""
        if self._repeated is None or not self._repeats_left:
            return
        if math.isinf(self._repeat_s):
            self._repeat_s = t_s + self._reports.repeat_s
        elif t_s >= self._repeat_s:
            self._repeat_s += self._reports.repeat_s
            self._repeats_left -= 1
            self._event_queue.add(self._repeated)

    def state(self, intent: Intent, *, flying: bool) -> tuple[MissionState, int]:
        """Return MISSION_CURRENT's mission_state and mission_mode in a mode for `intent`."""
        reports = self._reports
        manoeuvre = intent in _MANOEUVRES and reports.counts_manoeuvres
        here = intent is Intent.MISSION or manoeuvre
        underway = manoeuvre and (flying or intent is Intent.TAKEOFF)
        mode = 1 if here else reports.mode_elsewhere
        complete = self.finished and not reports.starts_over
        if len(self.items) <= self.first:
            return MissionState.NO_MISSION, mode
        if underway or (here and not complete and (self._begun or not reports.starts_over)):
            return MissionState.ACTIVE, mode
        if complete:
            return MissionState.COMPLETE, mode
        on_the_way = self._begun and self.seq > self._first_moving()
        return (MissionState.PAUSED if on_the_way else MissionState.NOT_STARTED), mode

    def _first_moving(self) -> int:
        return next((n for n, item in enumerate(self.items) if n >= self.first and is_navigation(item.command)), 0)

    def _announce_item(self, seq: int) -> None:
        if seq == self._announced:
            return
        item, self._announced = self._flown[seq], seq
        name = self._reports.item_names.get(item.command, f"Cmd{item.command}")
        self._event_queue.add_text(Note.ITEM_BEGINS, seq=seq, name=name)
        if item.command == Command.NAV_DELAY and item.params[0] > 0.0:
            self._event_queue.add_text(Note.DELAY_BEGINS, seconds=item.params[0])
