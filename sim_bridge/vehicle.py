"""One vehicle's MAVLink conversation: what arrives is handed on, what happens is told.

Knows: which part answers which message. Does not know: sockets, bytes, physics.
Two clocks: protocol timers run on the wall's clock `now_s`, because the link is real; flight, telemetry and
stamps run on simulated time `t_s`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs.link.command import command_ack
from gcs.link.dialect import MessageId, SetpointMask, WireFrame
from gcs.link.message import Message, Station
from gcs.link.timesync import answer_timesync
from gcs.mission.model import MissionItem
from sim_bridge.autopilot import Armed, Autopilot, ModeChanged, Reached, Said
from sim_bridge.commands import Commands
from sim_bridge.guidance.stream import LONGEST_GAP_S, Setpoint
from sim_bridge.mission_shelf import MissionShelf
from sim_bridge.params import Params
from sim_bridge.personality import Milestone, Personality, Setting
from sim_bridge.telemetry import Instruments, Telemetry, heartbeat

_COMPID = 1
_SET_MODE_NUMBER = 11  # ArduPilot acknowledges this message with its own number
_FAR = 1e6  # m, m/s, m/s²: no setpoint is as large as this
_SILENCE: tuple[Message, ...] = ()


class Vehicle:
    """Sans-I/O: messages in, messages out."""

    def __init__(self, sysid: int, autopilot: Autopilot, instruments: Instruments, personality: Personality) -> None:
        self.station = Station(sysid, _COMPID)
        self.autopilot = autopilot
        self._instruments = instruments
        self._personality = personality
        self._telemetry = Telemetry(instruments, autopilot, personality)
        self._commands = Commands(autopilot, self._telemetry)
        self._params = Params(personality, sysid)
        self._shelf = MissionShelf(
            self.station,
            personality,
            instruments.place(autopilot.guide.home_ned_m),
            self._hold_mission,
        )
        self._dead = False
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

    def simulated_s(self, boot_ms: int) -> float:
        """Simulated time of an instant of the vehicle's own clock."""
        return self._instruments.simulated_s(boot_ms)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Answer one message; those for other vehicles and unknown ones get none."""
        if self._dead or not message.is_for(Station(self.station.sysid, 0)):
            return []
        name = message.name
        if name == "SET_POSITION_TARGET_LOCAL_NED":
            self._take_setpoint(message)
            return []
        if name in ("COMMAND_LONG", "COMMAND_INT"):
            return self._commands.receive(message, self._instruments.t_s, now_s)
        if name == "MISSION_SET_CURRENT":
            self.autopilot.set_current(self._instruments.t_s, message.fields["seq"])
            return [m for m in [self._telemetry.build(MessageId.MISSION_CURRENT)] if m is not None]
        if name.startswith("MISSION_"):
            return self._shelf.receive(message, now_s)
        if name.startswith("PARAM_"):
            answers = self._params.receive(message)
            self._apply_params()
            return answers
        if name == "TIMESYNC":
            answer = answer_timesync(message, self._instruments.boot_ms / 1000.0)
            return [answer] if answer is not None else []
        if name == "SET_MODE":
            result = self.autopilot.set_mode(self._instruments.t_s, message.fields["custom_mode"])
            return [command_ack(Message(name, {"command": _SET_MODE_NUMBER}, *message.source), result)]
        return []

    def step(self, t_s: float, now_s: float, landed: bool) -> Sequence[Message]:
        """Let the autopilot decide for `t_s`; what is to be told and sent then."""
        self._instruments.t_s = t_s
        autopilot = self.autopilot
        autopilot.step(t_s, landed)
        if not autopilot.ready and not self._dead:
            autopilot.ready = t_s >= self._personality.boot.at_s(Milestone.READY) and self._instruments.healthy
        if self._dead:
            autopilot.events.clear()
            return _SILENCE
        messages: list[Message] = self._telemetry.due(t_s)
        if autopilot.events:
            messages += self._tell()
        if self._shelf.busy:
            messages += self._shelf.tick(now_s)
        return messages

    def _tell(self) -> list[Message]:
        messages: list[Message] = []
        for event in self.autopilot.events:
            match event:
                case Said(severity, text):
                    fields = {"severity": int(severity), "text": text[:50], "id": 0, "chunk_seq": 0}
                    messages.append(Message("STATUSTEXT", fields))
                case Reached(seq):
                    messages.append(Message("MISSION_ITEM_REACHED", {"seq": seq}))
                case ModeChanged():
                    messages.append(heartbeat(self._telemetry))
                case Armed():
                    self._shelf.move_home(self._instruments.place(self.autopilot.guide.home_ned_m))
                    both = (MessageId.GPS_GLOBAL_ORIGIN, MessageId.HOME_POSITION)
                    messages += [m for m in map(self._telemetry.build, both) if m is not None]
        self.autopilot.events.clear()
        return messages

    def _take_setpoint(self, message: Message) -> None:
        f = message.fields
        mask = f["type_mask"]
        if f["coordinate_frame"] != WireFrame.LOCAL_NED:
            return
        t_s, flat_now = self._instruments.t_s, self.autopilot.piece.at(self._instruments.t_s)
        flat = np.zeros((3, 4))
        flat[0] = flat_now[0]
        if not mask & SetpointMask.IGNORE_POSITION:
            flat[0, :3] = self._instruments.pad_ned_m + np.array([f["x"], f["y"], f["z"]])
        if not mask & SetpointMask.IGNORE_VELOCITY:
            flat[1, :3] = f["vx"], f["vy"], f["vz"]
        if not mask & SetpointMask.IGNORE_ACCELERATION:
            flat[2, :3] = f["afx"], f["afy"], f["afz"]
        if not mask & SetpointMask.IGNORE_YAW:
            flat[0, 3] = f["yaw"]
        if not mask & SetpointMask.IGNORE_YAW_RATE:
            flat[1, 3] = f["yaw_rate"]
        if not np.abs(flat).max() < _FAR:  # neither NaN nor nonsense
            return
        flat[0, 3] = flat_now[0, 3] + math.remainder(flat[0, 3] - flat_now[0, 3], math.tau)
        if mask & SetpointMask.IGNORE_VELOCITY and mask & SetpointMask.IGNORE_ACCELERATION:
            self.autopilot.go_to(t_s, flat[0])
            return
        stamp_s = self._instruments.simulated_s(f["time_boot_ms"])
        stamped = abs(stamp_s - t_s) <= LONGEST_GAP_S
        self.autopilot.follow(t_s, Setpoint(stamp_s if stamped else t_s, flat, stamped))

    def _hold_mission(self, items: Sequence[MissionItem]) -> None:
        self.autopilot.set_mission(items)
        self._params["MIS_TOTAL"] = float(len(items))

    def _apply_params(self) -> None:
        used, guide = self._params.setting, self.autopilot.guide
        self.autopilot.guided_timeout_s = used(Setting.STREAM_TIMEOUT_S)
        self.autopilot.guide = replace(
            guide,
            speed_mps=min(used(Setting.CRUISE_MPS), guide.limits.horizontal_mps),
            descend_mps=used(Setting.DESCEND_MPS),
            land_mps=used(Setting.LAND_MPS),
            rtl_height_m=used(Setting.RETURN_HEIGHT_M),
        )
