"""Carries out COMMAND_LONG and COMMAND_INT, and acknowledges them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gcs.frames import from_degE7, geodetic_to_ned
from gcs.link.protocols.command import CommandMemory, command_ack
from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand, MavResult, MessageId, ModeFlag, WireFrame
from gcs.types import Array
from sim_bridge.autopilot.autopilot import EmulatedAutopilot
from sim_bridge.personality import Intent, Note
from sim_bridge.protocol.telemetry import Telemetry

_FORCE = 21196.0  # MAV_CMD_COMPONENT_ARM_DISARM's param2
_CHANGE_MODE = 1  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
_FARTHEST_M = 50_000.0  # from the origin: positions further away are refused
_FORMAT_S, _PROGRESS_PERIOD_S = 3.0, 1.0  # of STORAGE_FORMAT
_MESSAGE_FIRST = frozenset({MavCommand.GET_MESSAGE_INTERVAL, MavCommand.GET_HOME_POSITION})


@dataclass(frozen=True)
class Request:
    """A command in either form; x and y in degrees where they are coordinates."""

    command: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    frame: int | None  # None where the form has none


@dataclass(frozen=True)
class CommandAnswer:
    """The result, and the messages that the command produced."""

    result: MavResult
    messages: list[Message] = field(default_factory=list)


@dataclass
class _Task:
    """A command that takes time."""

    command: Message
    end_s: float
    report_s: float


class CommandServer:
    """Carries out the commands of one vehicle. Faults: it `refuses` all of them, or `ignores` them."""

    def __init__(self, autopilot: EmulatedAutopilot, telemetry: Telemetry) -> None:
        self._autopilot = autopilot
        self._telemetry = telemetry
        self._replies = autopilot.personality.replies
        self.refuses = self.ignores = False
        self._memory = CommandMemory()
        self._task: _Task | None = None
        self._handlers: dict[int, Callable[[Request, float], CommandAnswer]] = {
            MavCommand.COMPONENT_ARM_DISARM: self._arm,
            MavCommand.NAV_TAKEOFF: self._take_off,
            MavCommand.NAV_LAND: lambda r, t: CommandAnswer(autopilot.pursue(t, Intent.LAND)),
            MavCommand.NAV_RETURN_TO_LAUNCH: lambda r, t: CommandAnswer(autopilot.pursue(t, Intent.RETURN)),
            MavCommand.DO_SET_MODE: self._set_mode,
            MavCommand.DO_CHANGE_SPEED: lambda r, t: CommandAnswer(autopilot.set_speed(t, r.params[0], r.params[1])),
            MavCommand.DO_SET_HOME: self._set_home,
            MavCommand.DO_REPOSITION: self._reposition,
            MavCommand.MISSION_START: lambda r, t: CommandAnswer(autopilot.start_mission(t, self._estimate)),
            MavCommand.DO_SET_MISSION_CURRENT: self._set_current,
            MavCommand.SET_MESSAGE_INTERVAL: self._set_interval,
            MavCommand.GET_MESSAGE_INTERVAL: self._get_interval,
            MavCommand.REQUEST_MESSAGE: lambda r, t: self._request(_whole(r.params[0])),
            MavCommand.REQUEST_AUTOPILOT_CAPABILITIES: lambda r, t: self._request(MessageId.AUTOPILOT_VERSION),
            MavCommand.GET_HOME_POSITION: lambda r, t: CommandAnswer(
                MavResult.ACCEPTED, telemetry.build(MessageId.HOME_POSITION, MessageId.GPS_GLOBAL_ORIGIN)
            ),
        }

    def suffer(self, *, refuses: bool, ignores: bool) -> None:
        """Have these faults from now on, or not any more."""
        self.refuses, self.ignores = refuses, ignores

    def receive(self, message: Message, t_s: float, now_s: float) -> list[Message]:
        """Carry out the command; return its acknowledgement and the messages it produced.

        A command that is repeated because its COMMAND_ACK was lost is acknowledged again, but not carried out again.
        """
        if self.ignores:
            return []
        known = self._memory.repeated(message, now_s)
        if known is not None:
            return [known]
        request = _request_in(message)
        if self.refuses:
            answer = CommandAnswer(self._replies.refused)
        elif request.command == MavCommand.STORAGE_FORMAT and self._replies.formats:
            answer = self._format(message, t_s)
        else:
            handler = self._handlers.get(request.command) if request.command not in self._replies.unsupported else None
            answer = handler(request, t_s) if handler is not None else CommandAnswer(MavResult.UNSUPPORTED)
        ack = command_ack(message, answer.result)
        self._memory.answered(message, ack, now_s)
        changed = request.command == MavCommand.DO_SET_MODE and answer.result == MavResult.ACCEPTED
        acks = [ack] * (self._replies.mode_acks if changed else 1)
        if self._replies.message_first or request.command in _MESSAGE_FIRST:
            return [*answer.messages, *acks]
        return [*acks, *answer.messages]

    def step(self, t_s: float) -> list[Message]:
        """Return the progress messages of earlier commands that are due."""
        task = self._task
        if task is None or t_s < task.report_s:
            return []
        if t_s >= task.end_s:
            self._task = None
            return [command_ack(task.command, MavResult.ACCEPTED, progress=100)]
        task.report_s = min(t_s + _PROGRESS_PERIOD_S, task.end_s)
        done = 100 - math.ceil(100.0 * (task.end_s - t_s) / _FORMAT_S)
        return [command_ack(task.command, MavResult.IN_PROGRESS, progress=min(max(done, 0), 99))]

    @property
    def busy(self) -> bool:
        """Whether `step` has messages to send, now or later."""
        return self._task is not None

    def _arm(self, request: Request, t_s: float) -> CommandAnswer:
        arm, force = request.params[0], request.params[1] == _FORCE
        if arm == 1.0:
            return CommandAnswer(self._autopilot.arm(t_s, self._estimate))
        if arm == 0.0:
            return CommandAnswer(self._autopilot.disarm(force=force))
        return CommandAnswer(MavResult.UNSUPPORTED)

    def _take_off(self, request: Request, t_s: float) -> CommandAnswer:
        home_amsl_m = (
            self._autopilot.path_generator.home_amsl_m if self._autopilot.personality.flight.takeoff_above_sea else 0.0
        )
        return CommandAnswer(self._autopilot.take_off(t_s, request.z - home_amsl_m))

    def _set_mode(self, request: Request, t_s: float) -> CommandAnswer:
        flags, mode, sub = (_whole(p) for p in request.params[:3])
        if not max(flags, 0) & ModeFlag.CUSTOM:
            return CommandAnswer(MavResult.DENIED)
        if self._autopilot.personality.modes.two_part:
            mode = (max(mode, 0) & 0xFF) << 16 | (max(sub, 0) & 0xFF) << 24
        return CommandAnswer(self._autopilot.set_mode(t_s, mode))

    def _set_current(self, request: Request, t_s: float) -> CommandAnswer:
        result = self._autopilot.set_current(t_s, _whole(request.params[0]))
        return CommandAnswer(result, self._request(MessageId.MISSION_CURRENT).messages)

    def _set_home(self, request: Request, _: float) -> CommandAnswer:
        if not self._autopilot.readiness.ready:
            return CommandAnswer(self._replies.refused)
        here = request.params[0] == 1.0
        has_position = all(map(math.isfinite, (request.x, request.y, request.z)))
        place = self._estimate[:3] if here else self._place(request, WireFrame.GLOBAL) if has_position else None
        if place is None:
            return CommandAnswer(MavResult.DENIED)
        self._autopilot.mode_actions.set_home(place)
        return CommandAnswer(MavResult.ACCEPTED)

    def _reposition(self, request: Request, t_s: float) -> CommandAnswer:
        now = self._autopilot.path.piece.at(t_s)[0]
        place = self._place(request, WireFrame.GLOBAL)
        if place is None:
            return CommandAnswer(MavResult.DENIED)
        yaw_rad = request.params[3]
        turn = math.remainder(yaw_rad - now[3], math.tau) if math.isfinite(yaw_rad) else 0.0
        change = bool(max(_whole(request.params[1]), 0) & _CHANGE_MODE)
        target, speed_mps = np.append(place, now[3] + turn), request.params[0]
        return CommandAnswer(self._autopilot.reposition(t_s, target, change_mode=change, speed_mps=speed_mps))

    def _set_interval(self, request: Request, _: float) -> CommandAnswer:
        number = _whole(request.params[0])
        if not self._telemetry.streams(number) or not math.isfinite(request.params[1]):
            self._autopilot.event_queue.add_text(Note.STREAM_UNKNOWN, number=number)
            return CommandAnswer(self._replies.unknown_stream)
        self._telemetry.set_interval(number, request.params[1])
        return CommandAnswer(MavResult.ACCEPTED)

    def _get_interval(self, request: Request, _: float) -> CommandAnswer:
        number = _whole(request.params[0])
        if not self._telemetry.knows(number):
            return CommandAnswer(self._replies.unknown_message)
        fields = {"message_id": number, "interval_us": self._telemetry.interval_us(number)}
        return CommandAnswer(MavResult.ACCEPTED, [Message("MESSAGE_INTERVAL", fields)])

    def _request(self, number: int) -> CommandAnswer:
        if not self._telemetry.knows(number):
            return CommandAnswer(self._replies.unknown_message)
        if not self._telemetry.has_newer(number):
            return CommandAnswer(self._replies.nothing_newer)
        return CommandAnswer(MavResult.ACCEPTED, self._telemetry.build_requested(number))

    def _format(self, message: Message, t_s: float) -> CommandAnswer:
        if self._autopilot.armed or self._task is not None:
            return CommandAnswer(MavResult.FAILED)
        self._task = _Task(message, t_s + _FORMAT_S, t_s + _PROGRESS_PERIOD_S)
        return CommandAnswer(MavResult.IN_PROGRESS)

    def _place(self, request: Request, default: int) -> Array | None:
        """Return the common local NED position of a command; None if it is invalid.

        Missing coordinates are those of the vehicle.
        """
        instruments = self._telemetry.sources.instruments
        origin, now = instruments.origin, self._autopilot.path.piece.at(instruments.t_s)
        frame = default if request.frame is None else request.frame
        amsl_m = request.z
        if frame in (WireFrame.GLOBAL_RELATIVE_ALT, WireFrame.GLOBAL_RELATIVE_ALT_INT):
            amsl_m += self._autopilot.path_generator.home_amsl_m
        elif frame not in (WireFrame.GLOBAL, WireFrame.GLOBAL_INT):
            return None
        if not math.isfinite(amsl_m):
            amsl_m = origin.alt_amsl_m - float(now[0, 2])
        elif abs(amsl_m) > _FARTHEST_M:
            return None
        if not (math.isfinite(request.x) and math.isfinite(request.y)):
            return np.array([now[0, 0], now[0, 1], origin.alt_amsl_m - amsl_m])
        if abs(request.x) > 90.0 or abs(request.y) > 180.0 or (request.x == 0.0 and request.y == 0.0):
            return None
        place = geodetic_to_ned(request.x, request.y, amsl_m, origin)
        return place if np.abs(place).max() <= _FARTHEST_M else None

    @property
    def _estimate(self) -> Array:
        return self._telemetry.sources.instruments.estimate


def _whole(value: float) -> int:
    """Return a whole number from a float field; -1, which is never valid, if it is not finite."""
    return round(value) if math.isfinite(value) else -1


def _request_in(message: Message) -> Request:
    f = message.fields
    params = (f["param1"], f["param2"], f["param3"], f["param4"])
    if message.name == "COMMAND_INT":
        return Request(f["command"], params, from_degE7(f["x"]), from_degE7(f["y"]), f["z"], f["frame"])
    return Request(f["command"], params, f["param5"], f["param6"], f["param7"], None)
