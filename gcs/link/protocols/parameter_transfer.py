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

from collections.abc import Sequence
from enum import Enum, auto

from gcs.autopilots.parameter_names import spellings
from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.parameter import Parameter, as_kind, decode, read_request, set_request
from gcs.link.wire.message import Message

_WINDOW = 6


class ParameterState(Enum):
    """See the table above."""

    IDLE = auto()
    RUNNING = auto()
    DONE = auto()
    FAILED = auto()


class ParameterMachine:
    """The common part of reader and writer. `values` is complete, by name, once `done` and `error` is None."""

    def __init__(
        self,
        names: Sequence[str],
        exchange: Exchange,
        *,
        version: int | None = None,
    ) -> None:
        self.peer = exchange.peer
        self.state = ParameterState.IDLE
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
        return self.state in (ParameterState.DONE, ParameterState.FAILED)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.state is not ParameterState.RUNNING:
            return None
        return min((next_s for _, next_s in self._requested.values()), default=None)

    def start(self, now_s: float) -> list[Message]:
        """Return the first requests. Raises `ProtocolMisuse` if called twice."""
        if self.state is not ParameterState.IDLE:
            raise ProtocolMisuse("a parameter machine was started twice: create a new one.")
        self.state = ParameterState.RUNNING
        return self._next_requests(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Process answers to these requests; ignore all other messages."""
        if (
            self.state is not ParameterState.RUNNING
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
        if self.state is not ParameterState.RUNNING:
            return []
        messages = []
        for name, (sent, next_s) in tuple(self._requested.items()):
            if now_s < next_s:
                continue
            if sent >= self._timers.attempts:
                self.error = self._timeout_error(name)
                self.state = ParameterState.FAILED
                return []
            messages += self._send(name, sent, now_s)
        return messages

    def cancel(self) -> list[Message]:
        """Stop the requests. No message is sent."""
        if not self.done:
            self.error = PeerError(f"the transfer of parameters of {self.peer} was cancelled.")
            self.state = ParameterState.FAILED
        return []

    def _next_requests(self, now_s: float) -> list[Message]:
        messages = []
        while self._waiting and len(self._requested) < _WINDOW:
            messages += self._send(self._waiting.pop(0), 0, now_s)
        if not self._requested:
            self.state = ParameterState.DONE
        return messages

    def _send(self, name: str, sent: int, now_s: float) -> list[Message]:
        self._requested[name] = (sent + 1, now_s + max(self._round_trip.wait_s(sent), self._timers.reply_min_s))
        names = self._spellings(name)
        self._asked |= dict.fromkeys(names, name)
        return [self._request(one) for one in names]

    def _spellings(self, name: str) -> tuple[str, ...]:
        """The names under which a parameter is requested."""
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
        return read_request(name, self.peer)

    def _settles(self, parameter: Parameter) -> bool:
        return True


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
