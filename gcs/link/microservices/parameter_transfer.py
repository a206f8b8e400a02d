"""ParameterReader and ParameterWriter: some parameters by name, asked for until each has answered.

Knows: PARAM_REQUEST_READ, PARAM_SET, PARAM_VALUE; time as an argument. Does not know: sockets, what parameters mean.

    state   event                                             next      sends
    IDLE    start                                             ASKING    questions, `window` at a time
    ASKING  PARAM_VALUE of one that was asked for             ASKING    the next question
    ASKING  ... that was to be set, and has another value     ASKING    (it may be old news; it is set again in time)
    ASKING  a wait passed                                     ASKING    what is still open, again
    ASKING  the last has answered                             DONE
    any     `tries` questions in vain                         FAILED

Silence is how both autopilots answer what they do not know. An answer by name may carry any index, and unasked ones
come between: only names count.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto

from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.microservices.parameter import Parameter, as_kind, bytewise, decode, read_request, set_request
from gcs.link.microservices.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station

_WINDOW = 6
_TRIES = 12
_LEAST_WAIT_S = 0.15  # autopilots answer from a slow loop


class ParameterState(Enum):
    """See the table above."""

    IDLE = auto()
    ASKING = auto()
    DONE = auto()
    FAILED = auto()


class ParameterMachine:
    """What both have in common. `values` by name once `done` and `error` is None."""

    def __init__(
        self,
        names: Sequence[str],
        peer: Station,
        autopilot: int,
        *,
        me: Station = GROUND,
        round_trip: RttEstimator | None = None,
    ) -> None:
        self.peer = peer
        self.me = me
        self.state = ParameterState.IDLE
        self.error: GcsError | None = None
        self.values: dict[str, Parameter] = {}
        self._in_bytes = bytewise(autopilot)
        self._round_trip = round_trip or RttEstimator()
        self._waiting = list(dict.fromkeys(names))
        self._asked: dict[str, tuple[int, float]] = {}  # times, when next
        self._seen: dict[str, Parameter] = {}

    @property
    def done(self) -> bool:
        """Whether it ended, well (`error` is None) or badly."""
        return self.state in (ParameterState.DONE, ParameterState.FAILED)

    @property
    def deadline_s(self) -> float | None:
        """When `tick` next has something to do."""
        if self.state is not ParameterState.ASKING:
            return None
        return min((next_s for _, next_s in self._asked.values()), default=None)

    def start(self, now_s: float) -> list[Message]:
        """Asks. Raises `ProtocolMisuse` when called twice."""
        if self.state is not ParameterState.IDLE:
            raise ProtocolMisuse("a parameter machine was started twice; make a new one.")
        self.state = ParameterState.ASKING
        return self._go_on(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Takes note of answers to our questions; everything else is ignored."""
        if (
            self.state is not ParameterState.ASKING
            or message.name != "PARAM_VALUE"
            or not message.comes_from(self.peer)
            or message.fields["param_id"] not in self._asked
        ):
            return []
        parameter = decode(message, in_bytes=self._in_bytes)
        if parameter is None:
            return []
        self._seen[parameter.name] = parameter
        if not self._settles(parameter):
            return []
        del self._asked[parameter.name]
        self.values[parameter.name] = parameter
        return self._go_on(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Asks again what is still open."""
        if self.state is not ParameterState.ASKING:
            return []
        messages = []
        for name, (times, next_s) in tuple(self._asked.items()):
            if now_s < next_s:
                continue
            if times >= _TRIES:
                self.error = self._complaint(name)
                self.state = ParameterState.FAILED
                return []
            messages.append(self._ask(name, times, now_s))
        return messages

    def cancel(self) -> list[Message]:
        """Stops asking. There is nothing to tell the vehicle."""
        if not self.done:
            self.error = PeerError(f"the parameters of {self.peer} were not waited for.")
            self.state = ParameterState.FAILED
        return []

    def _go_on(self, now_s: float) -> list[Message]:
        messages = []
        while self._waiting and len(self._asked) < _WINDOW:
            messages.append(self._ask(self._waiting.pop(0), 0, now_s))
        if not self._asked:
            self.state = ParameterState.DONE
        return messages

    def _ask(self, name: str, times: int, now_s: float) -> Message:
        self._asked[name] = (times + 1, now_s + max(self._round_trip.wait_s(times), _LEAST_WAIT_S))
        return self._question(name)

    def _question(self, name: str) -> Message:
        raise NotImplementedError

    def _settles(self, parameter: Parameter) -> bool:
        raise NotImplementedError

    def _complaint(self, name: str) -> GcsError:
        return PeerTimeout(
            f"{self.peer} does not answer for parameter {name}.",
            hint="its firmware may not have it, or call it something else: compare versions with `gcs vehicles`",
        )


class ParameterReader(ParameterMachine):
    """Reads parameters by name."""

    def _question(self, name: str) -> Message:
        return read_request(name, self.peer)

    def _settles(self, parameter: Parameter) -> bool:
        return True


class ParameterWriter(ParameterMachine):
    """Sets parameters, each in the type that the vehicle has it in, until it says that it holds the value.

    Raises `UsageError` for values that the type cannot hold.
    """

    def __init__(
        self,
        parameters: Sequence[Parameter],
        peer: Station,
        autopilot: int,
        *,
        me: Station = GROUND,
        round_trip: RttEstimator | None = None,
    ) -> None:
        super().__init__([p.name for p in parameters], peer, autopilot, me=me, round_trip=round_trip)
        self._wanted = {p.name: Parameter(p.name, as_kind(p.name, p.value, p.kind), p.kind) for p in parameters}

    def _question(self, name: str) -> Message:
        return set_request(self._wanted[name], self.peer, in_bytes=self._in_bytes)

    def _settles(self, parameter: Parameter) -> bool:
        wanted = self._wanted[parameter.name]
        return parameter.kind == wanted.kind and parameter.value == wanted.value

    def _complaint(self, name: str) -> GcsError:
        seen = self._seen.get(name)
        if seen is None:
            return super()._complaint(name)
        return PeerError(f"{self.peer} was told {self._wanted[name]}, and keeps {seen.value}.")
