"""The MAVLink conversation of one vehicle: passes messages to the part that handles them, and reports events.

Two clocks: protocol timers run on wall time `now_s`, because the link is real. Flight, telemetry and stamps run on
simulated time `t_s`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs.errors import UsageError
from gcs.link.protocols.command import command_ack
from gcs.link.protocols.ftp.payload import NAME as FTP
from gcs.link.wire.message import Message, Station
from gcs.link.wire.signing import KEY_BYTES, Signature, Signing
from gcs.mavlink import MavType, MessageId, MissionType, Severity
from gcs.mission.model import MissionItem
from sim_bridge.autopilot.autopilot import EmulatedAutopilot
from sim_bridge.autopilot.events import Event, ModeChanged, Placed, Reached, Said
from sim_bridge.autopilot.failsafe import Failsafe
from sim_bridge.missions.acceptance import flyable
from sim_bridge.missions.fence import places, shapes
from sim_bridge.missions.ftp_files import MissionFiles
from sim_bridge.missions.store import MissionStore
from sim_bridge.personality import Milestone, Personality
from sim_bridge.personality.table import ReplyTraits
from sim_bridge.protocol.command_server import CommandServer
from sim_bridge.protocol.ftp_server import FileServer
from sim_bridge.protocol.param_server import ParamServer
from sim_bridge.protocol.position_targets import SETPOINTS, setpoint_in
from sim_bridge.protocol.telemetry import Instruments, Sources, Telemetry

_COMPID = 1
_NO_MESSAGES: tuple[Message, ...] = ()
_CHUNK_BYTES = 50
_HIGHEST_ID = 0xFFFF
_NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class VehicleFaults:
    """The present faults of one vehicle beside those of its link and of its physics."""

    rejects_missions: bool = False
    wrong_checksums: bool = False  # of files
    refuses_commands: bool = False
    ignores_commands: bool = False
    refuses_arming: bool = False
    fails_checks: bool = False
    slow_down: int | None = None  # which end of what its navigator may do; None: that of the seed
    sag_V: float = 0.0
    gnss_ahead_s: float = 0.0


class Conversation:
    """Sans-I/O: messages in, messages out."""

    def __init__(
        self, sysid: int, autopilot: EmulatedAutopilot, instruments: Instruments, personality: Personality
    ) -> None:
        self.station = Station(sysid, _COMPID)
        self.autopilot = autopilot
        self.instruments = instruments
        self._personality = personality
        self._failsafe = Failsafe(autopilot)
        self._telemetry = Telemetry(Sources(instruments, autopilot, self._failsafe, personality))
        self._texts = StatusTextSender(personality.replies.numbered_texts)
        self.commands = CommandServer(autopilot, self._telemetry)
        self._params = ParamServer(personality, sysid, instruments.capacity_mAh)
        self.store = MissionStore(
            self.station,
            personality.missions,
            instruments.place(autopilot.path_generator.home_ned_m),
            self._on_stored,
            self._queue_text,
            lambda: autopilot.progress.seq,
        )
        self.files = FileServer(MissionFiles(self.store)) if personality.missions.as_files else None
        self._clock = TimesyncResponder(personality.replies, self.station)
        self._signing = Signing()
        self.dead = False  # the fault `die` has acted
        self._heard = not personality.replies.waits_for_contact
        self.on_from_s = -math.inf  # until then the vehicle is off: it neither receives nor sends
        self._apply_params()

    def suffer(self, faults: VehicleFaults) -> None:
        """Have these faults from now on, and no others."""
        self.store.suffer(rejects=faults.rejects_missions)
        if self.files is not None:
            self.files.suffer(wrong_checksums=faults.wrong_checksums)
        self.commands.suffer(refuses=faults.refuses_commands, ignores=faults.ignores_commands)
        self.autopilot.arming.suffer(refuses=faults.refuses_arming, fails_checks=faults.fails_checks)
        self.autopilot.react(faults.slow_down)
        self.instruments.suffer(sag_V=faults.sag_V, gnss_ahead_s=faults.gnss_ahead_s)
        self.autopilot.mode_actions.change(epoch_unix_s=self.instruments.unix_at_0_s)

    def die(self) -> None:
        """Act on a fault: the motors stop until the end, and the vehicle sends nothing more."""
        self.dead = True
        self.autopilot.fall()

    def restart(self, earlier: Conversation, on_from_s: float) -> None:
        """Take over what survives a restart, and be off until `on_from_s`.

        Modes, message rates and an unfinished upload do not survive it.
        """
        self.on_from_s = on_from_s
        self._params.remember(earlier._params)
        self.store.remember(earlier.store)
        self._signing = earlier._signing
        self.dead = earlier.dead
        self._apply_params()

    def sign(self, key: bytes, ticks: int, now_s: float) -> None:
        """Sign with `key`, and accept nothing else. Raises `UsageError` if its autopilot does not sign."""
        if not self._personality.replies.signs:
            raise UsageError(
                f"vehicle {self.station.sysid} cannot have a signing key: this autopilot does not check signatures.",
                hint="leave --signing-key-file out, or emulate ArduPilot",
            )
        self._signing.set_up(key, ticks, now_s)

    def signature(self, now_s: float) -> Signature | None:
        """Return the signature for the next frame; None while signing is off."""
        return self._signing.signature(now_s)

    @property
    def speaks(self) -> bool:
        """Whether the vehicle is on, and sends."""
        return self._heard and not self.dead and self.instruments.t_s >= self.on_from_s

    def reminders(self) -> list[Message]:
        """Return what a station needs that is waited for: a new one finds the vehicle, a late one knows its time."""
        return self._telemetry.build(MessageId.HEARTBEAT, MessageId.SYSTEM_TIME)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Answer one message. Messages for other vehicles, unknown ones and badly signed ones get no answer."""
        any_component = self._personality.replies.any_component
        if self.dead or not message.is_for(Station(self.station.sysid, 0 if any_component else _COMPID)):
            return []
        if self.instruments.t_s < self.on_from_s:
            return []
        if not self._signing.accepts(message.raw, now_s):
            return []
        self._heard = True
        answers = self._answer(message, now_s)
        return answers + self._drain_events() if self.autopilot.events else answers

    def _answer(self, message: Message, now_s: float) -> list[Message]:
        name = message.name
        if name in SETPOINTS:
            self._take_setpoint(message)
            return []
        if name in ("COMMAND_LONG", "COMMAND_INT"):
            return self.commands.receive(message, self.instruments.t_s, now_s)
        if name == "MISSION_SET_CURRENT":
            self.autopilot.set_current(self.instruments.t_s, message.fields["seq"])
            return self._telemetry.build(MessageId.MISSION_CURRENT)
        if name.startswith("MISSION_"):
            return self.store.receive(message, now_s) + self._params.changes()
        if name == FTP and self.files is not None:
            return self.files.receive(message, now_s) + self._params.changes()
        if name.startswith("PARAM_"):
            return self._answer_param(message)
        if name == "TIMESYNC":
            return self._clock.receive(message, self._boot_ns)
        if name == "SETUP_SIGNING":
            key = bytes(message.fields["secret_key"])
            if self._personality.replies.signs and not self.autopilot.armed and len(key) == KEY_BYTES:
                self._signing.set_up(key, int(message.fields["initial_timestamp"]), now_s)
            return []
        if name == "SET_MODE":
            result = self.autopilot.set_mode(self.instruments.t_s, message.fields["custom_mode"])
            command = self._personality.replies.set_mode_command
            return [command_ack(Message(name, {"command": command}, *message.source), result)]
        if name == "REQUEST_DATA_STREAM":
            rate_hz = message.fields["req_message_rate"] if message.fields["start_stop"] else 0.0
            self._telemetry.set_group(message.fields["req_stream_id"], float(rate_hz))
        elif name == "HEARTBEAT" and message.fields["type"] == MavType.GCS:
            self._failsafe.hear(message.sysid, now_s)
        return []

    def step(self, t_s: float, now_s: float, landed: bool) -> Sequence[Message]:
        """Let the autopilot decide at `t_s`; return the messages to send."""
        self.instruments.pass_to(t_s)
        if t_s < self.on_from_s:
            return _NO_MESSAGES
        autopilot = self.autopilot
        autopilot.step(t_s, landed, self.instruments.healthy)
        if self.dead:
            autopilot.events.clear()
            return _NO_MESSAGES
        messages: list[Message] = self._telemetry.due(t_s)
        if self._failsafe.due(t_s):
            self._failsafe.step(t_s, now_s, self.instruments.readings)
        if self.commands.busy:
            messages += self.commands.step(t_s)
        if self.store.waits:
            messages += self.store.tick(now_s)
        if autopilot.events:
            messages += self._drain_events()
        return messages + self._params.changes() + self._clock.due(self._boot_ns)

    def _drain_events(self) -> list[Message]:
        messages: list[Message] = []
        replies, too_early = self._personality.replies, list[Event]()
        for event in self.autopilot.events:
            match event:
                case Said() if not self._telemetry.sources.reached(Milestone.SPEAKING):
                    too_early.append(event)
                case Said(severity, text):
                    messages += self._texts.messages(severity, text)
                case Reached(seq):
                    messages.append(Message("MISSION_ITEM_REACHED", {"seq": seq}))
                case ModeChanged() if replies.heartbeat_on_change:
                    messages += self._telemetry.build(MessageId.HEARTBEAT)
                case Placed():
                    self.store.move_home(self.instruments.place(self.autopilot.path_generator.home_ned_m))
                    both = (MessageId.GPS_GLOBAL_ORIGIN, MessageId.HOME_POSITION) if replies.announces_home else ()
                    messages += self._telemetry.build(*both)
        self.autopilot.events[:] = too_early
        return messages if self._heard else [m for m in messages if m.name == "HEARTBEAT"]

    def _take_setpoint(self, message: Message) -> None:
        autopilot, t_s = self.autopilot, self.instruments.t_s
        read = setpoint_in(message, self.instruments, autopilot.path.piece.at(t_s), autopilot.path_generator.home_ned_m)
        if read is not None:
            setpoint, to_rest = read
            autopilot.follow(t_s, setpoint, to_rest=to_rest)

    def _on_stored(self, kind: int, items: Sequence[MissionItem]) -> None:
        """Apply a new mission, fence or set of rally points."""
        if kind == MissionType.FENCE:
            self._failsafe.fence(shapes(items, self.instruments.origin))
        if kind == MissionType.RALLY:
            points = places(self.store.usable_rally(tuple(items)), self.instruments.origin)
            self.autopilot.mode_actions.change(rally_ned_m=tuple(points))
        if kind == MissionType.MISSION:  # PX4 accepts missions that cannot be flown
            self.autopilot.progress.hold(items if flyable(items) else ())
        total = self._personality.missions.storage[kind].total
        if total:
            self._params.change(total, self.store.total(kind))

    def _answer_param(self, message: Message) -> list[Message]:
        if message.name == "PARAM_REQUEST_LIST":
            for line in self._personality.param_traits.banner:
                self._queue_text(Severity.INFO, line)
        answers = self._params.receive(message)
        if message.name == "PARAM_SET":
            self._apply_params()
        return answers

    def _queue_text(self, severity: Severity, text: str) -> None:
        self.autopilot.events.append(Said(severity, text))

    @property
    def _boot_ns(self) -> int:
        return self.instruments.boot_ms * 1_000_000

    def _apply_params(self) -> None:
        settings = self._params.settings()
        self.autopilot.use(settings)
        self._failsafe.use(settings)


class StatusTextSender:
    """Numbers the texts of one vehicle."""

    def __init__(self, numbers_all: bool) -> None:
        self._numbers_all = numbers_all
        self._id = 0

    def messages(self, severity: int, text: str) -> list[Message]:
        """Return the chunks of one text."""
        data = text.encode()
        chunks = [data[at : at + _CHUNK_BYTES] for at in range(0, len(data), _CHUNK_BYTES)] or [b""]
        if len(chunks) > 1 and len(chunks[-1]) == _CHUNK_BYTES:
            chunks.append(b"")  # a text ends with a chunk that is not full
        number = 0
        if self._numbers_all or len(chunks) > 1:
            self._id = self._id % _HIGHEST_ID + 1
            number = self._id
        return [
            Message(
                "STATUSTEXT",
                {"severity": int(severity), "text": chunk.decode(errors="replace"), "id": number, "chunk_seq": seq},
            )
            for seq, chunk in enumerate(chunks)
        ]


class TimesyncResponder:
    """TIMESYNC: answers with the vehicle's clock at the resolution of the original, and sends its own requests.

    `t_ns` is the vehicle's time since boot.
    """

    def __init__(self, traits: ReplyTraits, me: Station) -> None:
        self._traits = traits
        self._me = me
        self._next_ns: float | None = None

    def receive(self, message: Message, t_ns: int) -> list[Message]:
        """Answer a request; answers to the vehicle's own requests are ignored."""
        if message.fields["tc1"] != 0:
            return []
        step = self._traits.clock_step_ns
        return [Message("TIMESYNC", {"tc1": t_ns // step * step, "ts1": message.fields["ts1"]})]

    def due(self, t_ns: int) -> list[Message]:
        """Return the vehicle's own request when it is due. It contains the system id, which identifies the answer."""
        if self._next_ns is not None and t_ns < self._next_ns:
            return []
        first, self._next_ns = self._next_ns is None, t_ns + self._traits.timesync_period_s * _NS_PER_S
        if first:
            return []
        return [Message("TIMESYNC", {"tc1": 0, "ts1": t_ns // 1000 * 1000 + self._me.sysid})]
