"""COMMAND_LONG and COMMAND_INT: what a vehicle is told to do, and what it says to that.

Knows: which command asks what of the autopilot or the telemetry. Does not know: modes' meaning, sockets.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from gcs.frames import from_degE7
from gcs.link.command import CommandMemory, command_ack
from gcs.link.dialect import MavCommand, MavResult, MessageId
from gcs.link.message import Message
from sim_bridge.autopilot import Autopilot
from sim_bridge.personality import Intent
from sim_bridge.telemetry import Telemetry

_FORCE = 21196.0  # MAV_CMD_COMPONENT_ARM_DISARM's param2
_CUSTOM_MODE = 1  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


@dataclass(frozen=True)
class Request:
    """A command in either form; x and y in degrees where they are coordinates."""

    command: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float


class Commands:
    """Carries out the commands of one vehicle."""

    def __init__(self, autopilot: Autopilot, telemetry: Telemetry) -> None:
        self._autopilot = autopilot
        self._telemetry = telemetry
        self._memory = CommandMemory()
        self._handlers: dict[int, Callable[[Request, float], tuple[MavResult, list[Message]]]] = {
            MavCommand.COMPONENT_ARM_DISARM: self._arm,
            MavCommand.NAV_TAKEOFF: lambda r, t: (autopilot.take_off(t, r.z), []),
            MavCommand.NAV_LAND: lambda r, t: (autopilot.pursue(t, Intent.LAND), []),
            MavCommand.NAV_RETURN_TO_LAUNCH: lambda r, t: (autopilot.pursue(t, Intent.RETURN), []),
            MavCommand.DO_SET_MODE: self._set_mode,
            MavCommand.MISSION_START: lambda r, t: (autopilot.start_mission(t, telemetry.instruments.estimate), []),
            MavCommand.DO_SET_MISSION_CURRENT: self._set_current,
            MavCommand.SET_MESSAGE_INTERVAL: self._set_interval,
            MavCommand.GET_MESSAGE_INTERVAL: self._get_interval,
            MavCommand.REQUEST_MESSAGE: lambda r, t: self._request(_whole(r.params[0])),
            MavCommand.REQUEST_AUTOPILOT_CAPABILITIES: lambda r, t: self._request(MessageId.AUTOPILOT_VERSION),
            MavCommand.GET_HOME_POSITION: lambda r, t: self._request(MessageId.HOME_POSITION),
        }

    def receive(self, message: Message, t_s: float, now_s: float) -> list[Message]:
        """Carry out the command; the COMMAND_ACK comes first, then what it brought forth.

        A command that is only repeated, because its COMMAND_ACK was lost, is acknowledged and not obeyed again.
        """
        known = self._memory.repeated(message, now_s)
        if known is not None:
            return [known]
        request = _request_in(message)
        handler = self._handlers.get(request.command)
        result, messages = handler(request, t_s) if handler is not None else (MavResult.UNSUPPORTED, [])
        ack = command_ack(message, result)
        self._memory.answered(message, ack, now_s)
        return [ack, *messages]

    def _arm(self, request: Request, t_s: float) -> tuple[MavResult, list[Message]]:
        arm, force = request.params[0], request.params[1] == _FORCE
        if arm == 1.0:
            return self._autopilot.arm(t_s, self._telemetry.instruments.estimate), []
        if arm == 0.0:
            return self._autopilot.disarm(force=force), []
        return MavResult.UNSUPPORTED, []

    def _set_mode(self, request: Request, t_s: float) -> tuple[MavResult, list[Message]]:
        flags, mode = request.params[:2]
        if not max(_whole(flags), 0) & _CUSTOM_MODE:
            return MavResult.DENIED, []
        return self._autopilot.set_mode(t_s, _whole(mode)), []

    def _set_current(self, request: Request, t_s: float) -> tuple[MavResult, list[Message]]:
        result = self._autopilot.set_current(t_s, _whole(request.params[0]))
        return result, self._request(MessageId.MISSION_CURRENT)[1]

    def _set_interval(self, request: Request, _: float) -> tuple[MavResult, list[Message]]:
        number = _whole(request.params[0])
        if not self._telemetry.knows(number) or not math.isfinite(request.params[1]):
            return MavResult.DENIED, []
        self._telemetry.set_interval(number, request.params[1])
        return MavResult.ACCEPTED, []

    def _get_interval(self, request: Request, _: float) -> tuple[MavResult, list[Message]]:
        number = _whole(request.params[0])
        if not self._telemetry.knows(number):
            return MavResult.FAILED, []
        fields = {"message_id": number, "interval_us": self._telemetry.interval_us(number)}
        return MavResult.ACCEPTED, [Message("MESSAGE_INTERVAL", fields)]

    def _request(self, number: int) -> tuple[MavResult, list[Message]]:
        if not self._telemetry.knows(number):
            return MavResult.FAILED, []
        message = self._telemetry.build(number)
        return MavResult.ACCEPTED, [message] if message is not None else []


def _whole(value: float) -> int:
    """A number out of a float field; -1, which means nothing anywhere, for what is no number."""
    return round(value) if math.isfinite(value) else -1


def _request_in(message: Message) -> Request:
    f = message.fields
    params = (f["param1"], f["param2"], f["param3"], f["param4"])
    if message.name == "COMMAND_INT":
        return Request(f["command"], params, from_degE7(f["x"]), from_degE7(f["y"]), f["z"])
    return Request(f["command"], params, f["param5"], f["param6"], f["param7"])
