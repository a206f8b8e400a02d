"""One vehicle's MAVLink conversation: what arrives is handed on, what happens is told.

Knows: which part answers which message. Does not know: sockets, bytes, physics.
Two clocks: protocol timers run on the wall's clock `now_s`, because the link is real; flight, telemetry and
stamps run on simulated time `t_s`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs.link.ftp.payload import NAME as FTP
from gcs.link.microservices.command import command_ack
from gcs.link.wire.message import Message, Station
from gcs.link.wire.signing import Signature
from gcs.mavlink import MavType, MessageId, MissionType, Severity
from gcs.mission.model import MissionItem
from sim_bridge.autopilot.autopilot import EmulatedAutopilot
from sim_bridge.autopilot.events import Event, ModeChanged, Placed, Reached, Said
from sim_bridge.autopilot.failsafe import Failsafe
from sim_bridge.personality import Milestone, Personality
from sim_bridge.protocol.command_server import CommandServer
from sim_bridge.protocol.ftp_server import FileServer
from sim_bridge.protocol.missions.acceptance import flyable
from sim_bridge.protocol.missions.fence import places, shapes
from sim_bridge.protocol.missions.ftp_files import MissionFiles
from sim_bridge.protocol.missions.store import MissionStore
from sim_bridge.protocol.param_server import ParamServer
from sim_bridge.protocol.position_targets import SETPOINTS, setpoint_in
from sim_bridge.protocol.statustext_sender import StatusTextSender
from sim_bridge.protocol.telemetry import Instruments, Sources, Telemetry, heartbeat
from sim_bridge.protocol.timesync_signing import TimeKeeper, Trust

_COMPID = 1
_SILENCE: tuple[Message, ...] = ()


class Conversation:
    """Sans-I/O: messages in, messages out."""

    def __init__(
        self, sysid: int, autopilot: EmulatedAutopilot, instruments: Instruments, personality: Personality
    ) -> None:
        self.station = Station(sysid, _COMPID)
        self.autopilot = autopilot
        self._instruments = instruments
        self._personality = personality
        self._failsafe = Failsafe(autopilot)
        self._telemetry = Telemetry(Sources(instruments, autopilot, self._failsafe, personality))
        self._texts = StatusTextSender(personality.replies.numbered_texts)
        self._commands = CommandServer(autopilot, self._telemetry)
        self._params = ParamServer(personality, sysid)
        self._shelf = MissionStore(
            self.station,
            personality.missions,
            instruments.place(autopilot.guide.home_ned_m),
            self._shelved,
            self._say,
        )
        self._files = FileServer(MissionFiles(self._shelf)) if personality.missions.as_files else None
        self._clock = TimeKeeper(personality.link, self.station)
        self._trust = Trust(personality.link)
        self._dead = False
        self._heard = not personality.replies.waits_to_be_heard
        self.on_from_s = -math.inf  # until then it is off: neither hears nor says anything
        self._apply_params()

    @property
    def dead(self) -> bool:
        """Whether a fault has struck it down."""
        return self._dead

    @property
    def rejects_missions(self) -> bool:
        """A fault: no item of any upload pleases it."""
        return self._shelf.rejects

    @rejects_missions.setter
    def rejects_missions(self, rejects: bool) -> None:
        self._shelf.rejects = rejects

    def die(self) -> None:
        """A fault: motors stop for good, and nothing is heard any more."""
        self._dead = True
        self.autopilot.fall()

    def remember(self, earlier: Conversation) -> None:
        """Restart: take over what survives it. Modes, message rates and half an upload do not."""
        self._params.remember(earlier._params)
        self._shelf.remember(earlier._shelf)
        self._trust.remember(earlier._trust)
        self._dead = earlier._dead
        self._apply_params()

    def simulated_s(self, boot_ms: int) -> float:
        """Simulated time of an instant of the vehicle's own clock."""
        return self._instruments.simulated_s(boot_ms)

    def signature(self, now_s: float) -> Signature | None:
        """What its next frame is to be signed with; None where it is not."""
        return self._trust.signature(now_s)

    def time_message(self) -> Message | None:
        """SYSTEM_TIME as of now; None from one that is off, silent or without it."""
        off = self._dead or not self._heard or self._instruments.t_s < self.on_from_s
        return None if off else self._telemetry.build(MessageId.SYSTEM_TIME)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Answer one message; those for other vehicles, unknown ones and those it does not trust get none."""
        everyone = self._personality.replies.any_component
        if self._dead or not message.is_for(Station(self.station.sysid, 0 if everyone else _COMPID)):
            return []
        if self._instruments.t_s < self.on_from_s:
            return []
        if not self._trust.believes(message, now_s):
            return []
        self._heard = True
        answers = self._answer(message, now_s)
        return answers + self._tell() if self.autopilot.events else answers

    def _answer(self, message: Message, now_s: float) -> list[Message]:
        name = message.name
        if name in SETPOINTS:
            self._take_setpoint(message)
            return []
        if name in ("COMMAND_LONG", "COMMAND_INT"):
            return self._commands.receive(message, self._instruments.t_s, now_s)
        if name == "MISSION_SET_CURRENT":
            self.autopilot.set_current(self._instruments.t_s, message.fields["seq"])
            return [m for m in [self._telemetry.build(MessageId.MISSION_CURRENT)] if m is not None]
        if name.startswith("MISSION_"):
            self._shelf.current_seq = self.autopilot.current_seq
            return self._shelf.receive(message, now_s) + self._params.news()
        if name == FTP and self._files is not None:
            self._shelf.current_seq = self.autopilot.current_seq
            return self._files.receive(message, now_s) + self._params.news()
        if name.startswith("PARAM_"):
            return self._talk_of_params(message)
        if name == "TIMESYNC":
            return self._clock.receive(message, self._boot_ns)
        if name == "SETUP_SIGNING":
            self._trust.set_up(message, now_s, armed=self.autopilot.armed)
            return []
        if name == "SET_MODE":
            result = self.autopilot.set_mode(self._instruments.t_s, message.fields["custom_mode"])
            command = self._personality.replies.set_mode_command
            return [command_ack(Message(name, {"command": command}, *message.source), result)]
        if name == "REQUEST_DATA_STREAM":
            rate_hz = message.fields["req_message_rate"] if message.fields["start_stop"] else 0.0
            self._telemetry.set_group(message.fields["req_stream_id"], float(rate_hz))
        elif name == "HEARTBEAT" and message.fields["type"] == MavType.GCS:
            self._failsafe.hear(message.sysid, now_s)
        return []

    def step(self, t_s: float, now_s: float, landed: bool) -> Sequence[Message]:
        """Let the autopilot decide for `t_s`; what is to be told and sent then."""
        self._instruments.t_s = t_s
        if t_s < self.on_from_s:
            return _SILENCE
        autopilot = self.autopilot
        autopilot.step(t_s, landed, self._instruments.healthy)
        if self._dead:
            autopilot.events.clear()
            return _SILENCE
        messages: list[Message] = self._telemetry.due(t_s)
        if self._failsafe.due(t_s):
            self._failsafe.step(t_s, now_s, self._instruments.readings)
        if self._commands.busy:
            messages += self._commands.step(t_s)
        if self._shelf.waits:
            messages += self._shelf.tick(now_s)
        if autopilot.events:
            messages += self._tell()
        return messages + self._params.news() + self._clock.due(self._boot_ns)

    def _tell(self) -> list[Message]:
        messages: list[Message] = []
        replies, unsaid = self._personality.replies, list[Event]()
        for event in self.autopilot.events:
            match event:
                case Said() if not self._telemetry.sources.reached(Milestone.SPEAKING):
                    unsaid.append(event)
                case Said(severity, text):
                    messages += self._texts.messages(severity, text)
                case Reached(seq):
                    messages.append(Message("MISSION_ITEM_REACHED", {"seq": seq}))
                case ModeChanged() if replies.heartbeat_on_change:
                    messages.append(heartbeat(self._telemetry.sources))
                case Placed():
                    self._shelf.move_home(self._instruments.place(self.autopilot.guide.home_ned_m))
                    both = (MessageId.GPS_GLOBAL_ORIGIN, MessageId.HOME_POSITION) if replies.announces_home else ()
                    messages += [m for m in map(self._telemetry.build, both) if m is not None]
        self.autopilot.events[:] = unsaid
        return messages if self._heard else [m for m in messages if m.name == "HEARTBEAT"]

    def _take_setpoint(self, message: Message) -> None:
        autopilot, t_s = self.autopilot, self._instruments.t_s
        read = setpoint_in(message, self._instruments, autopilot.piece.at(t_s), autopilot.guide.home_ned_m)
        if read is not None:
            setpoint, to_rest = read
            autopilot.follow(t_s, setpoint, to_rest=to_rest)

    def _shelved(self, kind: int, items: Sequence[MissionItem]) -> None:
        """There is a new mission, fence or set of rally points."""
        if kind == MissionType.FENCE:
            self._failsafe.fence(shapes(items, self._instruments.origin))
        if kind == MissionType.RALLY:
            self.autopilot.helm.rally(places(items, self._instruments.origin))
        if kind == MissionType.MISSION:  # PX4 takes missions that nobody can fly
            self.autopilot.set_mission(items if flyable(items) else ())
        total = self._personality.missions.keeping[kind].total
        if total:
            self._params.change(total, self._shelf.total(kind))

    def _talk_of_params(self, message: Message) -> list[Message]:
        if message.name == "PARAM_REQUEST_LIST":
            for line in self._personality.param_habits.banner:
                self._say(Severity.INFO, line)
        answers = self._params.receive(message)
        if message.name == "PARAM_SET":
            self._apply_params()
        return answers

    def _say(self, severity: Severity, text: str) -> None:
        self.autopilot.events.append(Said(severity, text))

    @property
    def _boot_ns(self) -> int:
        return self._instruments.boot_ms * 1_000_000

    def _apply_params(self) -> None:
        settings = self._params.settings()
        self.autopilot.use(settings)
        self._failsafe.use(settings)
