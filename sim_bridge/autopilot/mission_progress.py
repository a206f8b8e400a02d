"""Where a vehicle is in its mission, and what it says of that.

Knows: the items held, which one is current, the habits of MISSION_CURRENT and MISSION_ITEM_REACHED. Does not know:
motion, modes, messages.

Courses (`sim_bridge.autopilot.guidance.path_generator`) count items as ArduPilot does, home being item 0; where home
is no item, they are given one more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum

from gcs.mavlink import MavResult
from gcs.mission.model import Command, Frame, MissionItem
from sim_bridge.autopilot.events import Reached, Voice
from sim_bridge.autopilot.guidance.mission_guidance import is_navigation
from sim_bridge.autopilot.guidance.piece import Mark
from sim_bridge.personality import Intent, Note
from sim_bridge.personality.flight_traits import ReportTraits

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
    """`items` as the vehicle holds them, `seq` the current one, `running` while they are flown."""

    def __init__(self, reports: ReportTraits, home_is_item_0: bool, voice: Voice) -> None:
        self._reports = reports
        self._voice = voice
        self._shift = 0 if home_is_item_0 else 1
        self.items: tuple[MissionItem, ...] = ()
        self.seq = 0
        self.running = False
        self.finished = False
        self._begun = False
        self._flown: tuple[MissionItem, ...] = ()  # what `items` were when the mission began
        self._told: int | None = None  # the item whose beginning was told last
        self._repeated: Reached | None = None
        self._repeats_left = 0
        self._repeat_s = math.inf

    @property
    def first(self) -> int:
        """The first item that is no home."""
        return 1 - self._shift

    @property
    def counted(self) -> int:
        """MISSION_CURRENT.total."""
        items = len(self.items) - (0 if self._reports.counts_home else self.first)
        return items if items > 0 else self._reports.empty_total

    def hold(self, items: Sequence[MissionItem]) -> None:
        """Have these items from now on. A mission under way is flown to its end as it was."""
        self.items = tuple(items)
        if not self.running:
            self.seq, self.finished, self._begun = 0, False, False

    def select(self, seq: int) -> MavResult:
        """Make item `seq` the current one, or the next one that moves the vehicle."""
        if not 0 <= seq < len(self.items):
            return MavResult.DENIED
        seq = max(seq, self.first) if len(self.items) > self.first else seq
        while seq + 1 < len(self.items) and not is_navigation(self.items[seq].command):
            seq += 1
        self.seq, self.finished = seq, False
        return MavResult.ACCEPTED

    def next_command(self) -> int | None:
        """The command that comes next of those that move the vehicle."""
        ahead = (item.command for item in self.items[max(self.seq, self.first) :])
        return next((command for command in ahead if is_navigation(command)), None)

    @property
    def padded(self) -> tuple[tuple[MissionItem, ...], int]:
        """Items and current one as courses count them."""
        return (*(_PLACEHOLDER,) * self._shift, *self.items), self.seq + self._shift

    def begin(self, *, anew: bool = True) -> None:
        """The mission is flown from here on; unless `anew`, it has been flown so far."""
        self.running, self.finished, self._begun = True, False, True
        self._flown = self.items
        if anew:
            self._repeated = self._told = None

    def pass_mark(self, mark: Mark) -> None:
        """An item was completed, or begins."""
        if mark.reached is not None:
            self.reached(mark.reached - self._shift)
            if self._flown[self.seq].command == Command.NAV_WAYPOINT:
                self._voice.say(Note.WAYPOINT_REACHED, seq=self.seq)
            for seq in range(self.seq + 1, mark.reached - self._shift + 1):
                self._tell_item(seq)
        if mark.current is not None:
            self.seq = mark.current - self._shift
            self._tell_item(self.seq)

    def reached(self, seq: int) -> None:
        """Item `seq` is done."""
        self._repeated = Reached(seq)
        self._repeats_left, self._repeat_s = self._reports.repeats, -math.inf
        self._voice.tell(self._repeated)

    def descends(self) -> None:
        """The descent of a landing begins."""
        if self.running and self._reports.tells_landing:
            self.reached(self.seq)

    def manoeuvred(self, intent: Intent) -> None:
        """A take-off or a landing by itself is over."""
        if self._reports.counts_manoeuvres and intent in _MANOEUVRES:
            self.finished = True

    def land(self, intent: Intent) -> None:
        """On the ground; the mission, or what was flown for `intent`, is over."""
        if self.running:
            self._voice.say(Note.MISSION_ENDS)
            self.running, self.finished = False, True
        self.manoeuvred(intent)

    def start_over(self) -> None:
        """After the landing the first item is current again, where that is the habit."""
        if self.finished and self._reports.starts_over:
            self.seq, self.finished, self._told = self._first_moving(), False, None
            self.tell_current()

    def tell_current(self) -> None:
        """Say which item is current, and that it will be flown."""
        self._begun = True
        if not self.running:
            self._flown = self.items
        ahead = range(max(self.seq, self.first), len(self._flown))
        self.seq = next((seq for seq in ahead if is_navigation(self._flown[seq].command)), self.seq)
        if self.seq < len(self._flown):
            self._tell_item(self.seq)

    def step(self, t_s: float) -> None:
        """Say again what was reached, where that is the habit."""
        if self._repeated is None or not self._repeats_left:
            return
        if math.isinf(self._repeat_s):
            self._repeat_s = t_s + self._reports.repeat_s
        elif t_s >= self._repeat_s:
            self._repeat_s += self._reports.repeat_s
            self._repeats_left -= 1
            self._voice.tell(self._repeated)

    def state(self, intent: Intent, *, flying: bool) -> tuple[MissionState, int]:
        """MISSION_CURRENT's mission_state and mission_mode in a mode for `intent`."""
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

    def _tell_item(self, seq: int) -> None:
        if seq == self._told:
            return
        item, self._told = self._flown[seq], seq
        name = self._reports.item_names.get(item.command, f"Cmd{item.command}")
        self._voice.say(Note.ITEM_BEGINS, seq=seq, name=name)
        if item.command == Command.NAV_DELAY and item.params[0] > 0.0:
            self._voice.say(Note.DELAY_BEGINS, seconds=item.params[0])
