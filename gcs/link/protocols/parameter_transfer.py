"""ParameterReader and ParameterWriter: the MAVLink parameter protocol (https://mavlink.io/en/services/parameter.html).

Several parameters are read or set by name; each request is repeated until the vehicle answers it.

    state    event                                            next     sends
    IDLE     start                                            RUNNING  requests, 6 at a time
    RUNNING  PARAM_VALUE of a requested name                  RUNNING  the next request
    RUNNING  ... of a name to set, with another value         RUNNING  (it may be an old value; PARAM_SET is repeated)
    RUNNING  the wait of a request passed                     RUNNING  the same request
    RUNNING  the last PARAM_VALUE arrived                     DONE
    any      12 requests without answer                       FAILED

Neither autopilot answers a request for an unknown name. So a reader requests a renamed parameter under every name that
it may have (`gcs.autopilots.parameter_names`). An answer by name may carry any index, and values that were not
requested arrive in between: only names count.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from gcs.autopilots.parameter_names import spellings
from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse, UsageError
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import MachineState
from gcs.link.wire.message import Message, Station
from gcs.mavlink import ParameterType

REAL32 = int(ParameterType.REAL32)
RANGES: dict[int, tuple[int, int]] = {
    ParameterType.UINT8: (0, 255),
    ParameterType.INT8: (-128, 127),
    ParameterType.UINT16: (0, 65_535),
    ParameterType.INT16: (-32_768, 32_767),
    ParameterType.UINT32: (0, 2**32 - 1),
    ParameterType.INT32: (-(2**31), 2**31 - 1),
}
_BYTES: dict[int, str] = {
    ParameterType.UINT8: "<Bxxx",
    ParameterType.INT8: "<bxxx",
    ParameterType.UINT16: "<Hxx",
    ParameterType.INT16: "<hxx",
    ParameterType.UINT32: "<I",
    ParameterType.INT32: "<i",
}
_FLOAT = struct.Struct("<f")


@dataclass(frozen=True)
class Parameter:
    """One parameter of a vehicle. `kind` is its MAV_PARAM_TYPE; `value` is a float for REAL32, else an int."""

    name: str
    value: int | float
    kind: int

    def __str__(self) -> str:
        return f"{self.name} = {self.value:g}" if self.kind == REAL32 else f"{self.name} = {self.value}"

    def same_value(self, other: Parameter) -> bool:
        """Whether both have the same value, to the precision of the wire."""
        return as_kind(self.name, self.value, other.kind) == other.value


def as_kind(name: str, value: int | float, kind: int) -> int | float:
    """Return the value as a parameter of this type stores it.

    Raises `UsageError` for NaN and infinity (PX4 would store them), a fraction for an integer type, or a value out of
    range.
    """
    if not math.isfinite(value):
        raise UsageError(f"{name} cannot be {value}: it must be a finite number.")
    if kind == REAL32:
        try:
            return float(_FLOAT.unpack(_FLOAT.pack(value))[0])
        except OverflowError:
            raise UsageError(f"{name} cannot be {value:g}: it exceeds the range of a 32 bit float.") from None
    low, high = RANGES.get(kind, (0, -1))
    if value != round(value) or not low <= value <= high:
        raise UsageError(f"{name} cannot be {value}: on this vehicle it must be a whole number from {low} to {high}.")
    return round(value)


def encode(parameter: Parameter, *, in_bytes: bool) -> float:
    """Return the float of PARAM_SET that carries the value."""
    if parameter.kind == REAL32 or not in_bytes:
        return float(parameter.value)
    return float(_FLOAT.unpack(struct.pack(_BYTES[parameter.kind], parameter.value))[0])


def decode(message: Message, *, in_bytes: bool) -> Parameter | None:
    """Return the parameter in a PARAM_VALUE; None for the unused 64 bit types."""
    name, value, kind = (message.fields[key] for key in ("param_id", "param_value", "param_type"))
    if kind == REAL32:
        return Parameter(name, float(value), kind)
    if kind not in _BYTES:
        return None
    if in_bytes:
        return Parameter(name, int(struct.unpack(_BYTES[kind], _FLOAT.pack(value))[0]), kind)
    return Parameter(name, round(value), kind) if math.isfinite(value) else None


def set_request(parameter: Parameter, peer: Station, *, in_bytes: bool) -> Message:
    """Return PARAM_SET in the parameter's own type: PX4 ignores any other type without an error."""
    value = encode(parameter, in_bytes=in_bytes)
    return Message(
        "PARAM_SET", {**peer.target, "param_id": parameter.name, "param_value": value, "param_type": parameter.kind}
    )


_WINDOW = 6


class ParameterMachine:
    """The common part of reader and writer. `values` is complete, by name, once `done` and `error` is None."""

    def __init__(self, names: Sequence[str], exchange: Exchange, *, version: int | None = None) -> None:
        self.peer = exchange.peer
        self.state = MachineState.IDLE
        self.error: GcsError | None = None
        self.values: dict[str, Parameter] = {}
        self._autopilot, self._version = exchange.autopilot, version
        self._in_bytes = exchange.link.integers_in_bytes
        self._timers = exchange.timers.parameter
        self._round_trip = exchange.round_trip
        self._waiting = list(dict.fromkeys(names))
        self._requested: dict[str, tuple[int, float]] = {}  # number of requests, time of the next
        self._seen: dict[str, Parameter] = {}
        self._asked: dict[str, str] = {}  # the requested name, by each name that the vehicle may have for it

    @property
    def done(self) -> bool:
        """Whether it has ended: with success if `error` is None."""
        return self.state in (MachineState.DONE, MachineState.FAILED)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.state is not MachineState.RUNNING:
            return None
        return min((next_s for _, next_s in self._requested.values()), default=None)

    def start(self, now_s: float) -> list[Message]:
        """Return the first requests. Raises `ProtocolMisuse` if called twice."""
        if self.state is not MachineState.IDLE:
            raise ProtocolMisuse("a parameter machine was started twice: create a new one.")
        self.state = MachineState.RUNNING
        return self._next_requests(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Process answers to these requests; ignore all other messages."""
        if (
            self.state is not MachineState.RUNNING
            or message.name != "PARAM_VALUE"
            or not message.comes_from(self.peer)
            or (name := self._asked.get(message.fields["param_id"], "")) not in self._requested
        ):
            return []
        parameter = decode(message, in_bytes=self._in_bytes)
        if parameter is None:
            return []
        self._seen[name] = parameter
        if not self._settles(parameter):
            return []
        del self._requested[name]
        self.values[name] = parameter
        return self._next_requests(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Repeat the requests whose wait has passed."""
        if self.state is not MachineState.RUNNING:
            return []
        messages = []
        for name, (sent, next_s) in tuple(self._requested.items()):
            if now_s < next_s:
                continue
            if sent >= self._timers.attempts:
                self.error = self._timeout_error(name)
                self.state = MachineState.FAILED
                return []
            messages += self._send(name, sent, now_s)
        return messages

    def cancel(self) -> list[Message]:
        """Stop the requests. No message is sent."""
        if not self.done:
            self.error = PeerError(f"the transfer of parameters of {self.peer} was cancelled.")
            self.state = MachineState.FAILED
        return []

    def _next_requests(self, now_s: float) -> list[Message]:
        messages = []
        while self._waiting and len(self._requested) < _WINDOW:
            messages += self._send(self._waiting.pop(0), 0, now_s)
        if not self._requested:
            self.state = MachineState.DONE
        return messages

    def _send(self, name: str, sent: int, now_s: float) -> list[Message]:
        self._requested[name] = (sent + 1, now_s + max(self._round_trip.wait_s(sent), self._timers.reply_min_s))
        names = self._spellings(name)
        self._asked |= dict.fromkeys(names, name)
        return [self._request(one) for one in names]

    def _spellings(self, name: str) -> tuple[str, ...]:
        return (name,)

    def _request(self, name: str) -> Message:
        raise NotImplementedError

    def _settles(self, parameter: Parameter) -> bool:
        raise NotImplementedError

    def _timeout_error(self, name: str) -> GcsError:
        names = " or ".join(self._spellings(name))
        return PeerTimeout(
            f"{self.peer} does not answer for parameter {names}, requested {self._timers.attempts} times.",
            hint="its firmware may not have this parameter, or use another name: check its version with `gcs vehicles`",
        )


class ParameterReader(ParameterMachine):
    """Reads parameters by name, or by the other name that this version of the autopilot has for them.

    `values` has them by the requested name; `Parameter.name` is the vehicle's own name, and the value is in its unit.
    `version` is AUTOPILOT_VERSION.flight_sw_version, if it is known.
    """

    def _spellings(self, name: str) -> tuple[str, ...]:
        return spellings(self._autopilot, name, self._version)

    def _request(self, name: str) -> Message:
        return Message("PARAM_REQUEST_READ", {**self.peer.target, "param_id": name, "param_index": -1})

    def _settles(self, parameter: Parameter) -> bool:
        return math.isfinite(parameter.value)

    def _timeout_error(self, name: str) -> GcsError:
        seen = self._seen.get(name)
        return super()._timeout_error(name) if seen is None else PeerError(f"{self.peer} reports {seen}: not a number.")


class ParameterWriter(ParameterMachine):
    """Sets parameters, each in the type that the vehicle uses, until the vehicle reports the new value.

    Raises `UsageError` for values that the type cannot store.
    """

    def __init__(self, parameters: Sequence[Parameter], exchange: Exchange) -> None:
        super().__init__([p.name for p in parameters], exchange)
        self._wanted = {p.name: Parameter(p.name, as_kind(p.name, p.value, p.kind), p.kind) for p in parameters}

    def _request(self, name: str) -> Message:
        return set_request(self._wanted[name], self.peer, in_bytes=self._in_bytes)

    def _settles(self, parameter: Parameter) -> bool:
        wanted = self._wanted[parameter.name]
        return parameter.kind == wanted.kind and parameter.value == wanted.value

    def _timeout_error(self, name: str) -> GcsError:
        seen = self._seen.get(name)
        if seen is None:
            return super()._timeout_error(name)
        return PeerError(f"{self.peer} did not set {self._wanted[name]}: it reports {seen.value}.")
