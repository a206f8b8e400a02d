"""Carries messages between endpoints and vehicles, over links that may be impaired.

Commands for the emulator (`fault_commands`) are handled here. On an impaired link a frame travels in simulated time.
It departs when it arrives here. A setpoint that carries its time departs `LEAD_S` before that time, however much
earlier the ground station sent it. So the same setpoints are equally late in every run, and a delay above that shows.
"""

import math
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from gcs.link.protocols.command import command_ack
from gcs.link.protocols.ftp.payload import NAME as FTP
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from sim_bridge.autopilot.guidance.stream import StreamTiming
from sim_bridge.faults.fault_commands import is_fault_command, read_order
from sim_bridge.faults.injector import FaultInjector
from sim_bridge.missions.ftp_files import items_in
from sim_bridge.protocol.conversation import Conversation
from sim_bridge.protocol.position_targets import is_stamp
from sim_bridge.protocol.switchboard import Switchboard

LEAD_S = 0.1
_SETPOINT = "SET_POSITION_TARGET_LOCAL_NED"
_ITEMS = ("MISSION_ITEM_INT", "MISSION_ITEM")
PERIOD_S = 0.1  # of simulated time
BEHIND_S = 0.5
UNANSWERED_PERIOD_S = 1.0


@dataclass(slots=True)
class Departure:
    """The newest setpoint that left for an impaired link: its stamp, and when the vehicles wait for the next one."""

    stamp_s: float = -math.inf
    awaited_s: float = math.inf
    timing: StreamTiming = field(default_factory=StreamTiming)

    def arrived(self, stamp_s: float, t_s: float) -> None:
        """A setpoint for `stamp_s` came at `t_s`."""
        self.timing.arrived(stamp_s, t_s)
        self.stamp_s = max(self.stamp_s, stamp_s)
        spare_s = self.timing.spare_s(self.stamp_s)
        self.awaited_s = self.stamp_s + (spare_s if spare_s > 0.0 else -LEAD_S)


class Traffic:
    """Carries messages between a switchboard and vehicles, whose members may be replaced."""

    def __init__(
        self,
        board: Switchboard,
        vehicles: Sequence[Conversation],
        injector: FaultInjector,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._board = board
        self._vehicles = vehicles
        self._injector = injector
        self._clock = clock
        self._row_of = {vehicle.station.sysid: row for row, vehicle in enumerate(vehicles)}
        self._encoders = [Codec(*vehicle.station) for vehicle in vehicles]
        self._decoders = [Codec(0, 0) for _ in board.rows]
        self._after: dict[int, Codec] = {}  # decoders behind impaired links
        self._departures: dict[int, Departure] = {}  # newest setpoint that arrived here, lost afterwards or not
        self._echo = GroundEcho()
        self._asked = 0  # the row of the vehicle that asked last
        self._watched = -1
        self.sent = 0  # messages

    def watch(self, file: int) -> None:
        """Make `listen` report when this file descriptor ends."""
        self._watched = file
        self._board.watch(file)

    def listen(self, timeout_s: float, t_s: float) -> bool:
        """Pass on what has arrived, waiting at most `timeout_s` for it; return False when the watched file ended."""
        goes_on = True
        for line, data, source in self._board.receive(timeout_s, self._clock()):
            if line < 0:
                goes_on = bool(os.read(self._watched, 4096))
                continue
            messages = self._decoders[line].decode(data, source)
            if messages:
                now_s = self._clock()
                self._board.heard(line, source, now_s)
                for message in messages:
                    for row in self._addressed(line, message):
                        self._hand_on(row, message, t_s, now_s)
        self._board.flush(self._clock())
        return goes_on

    def send(self, row: int, messages: Sequence[Message], t_s: float) -> None:
        """Send messages of a vehicle to the ground; they leave with `carry`, or with the next `listen`."""
        encode, signature = self._encoders[row].encode, self._vehicles[row].signature
        now_s = self._clock()
        frames = [encode(message, signature(now_s)) for message in messages]
        self.sent += len(frames)
        radio = self._injector.radios.get(row)
        if radio is None:
            self._board.put(row, frames)
            return
        for frame in frames:
            radio.down.put(frame, t_s)

    def carry(self, t_s: float, now_s: float) -> None:
        """Deliver frames that are due on impaired links, and send what is queued."""
        for row, radio in self._injector.radios.items():
            for frame in radio.up.take(t_s):
                decoder = self._after.setdefault(row, Codec(0, 0))
                for message in decoder.decode(frame):
                    self._deliver(row, message, t_s, now_s)
            self._board.put(row, list(radio.down.take(t_s)))
        self._board.flush(now_s)

    def restarted(self, row: int) -> None:
        """Restart the frame sequence numbers of this row at 0."""
        self._encoders[row] = Codec(*self._vehicles[row].station)

    def remind(self, t_s: float) -> None:
        """Send PING again, to a station that may have begun only now, or have lost it."""
        for row in self._unimpaired():
            for message in self._vehicles[row].reminders():
                self._put(row, message)
        self._ask(self._echo.again(t_s))
        self._board.flush(self._clock())

    def unread_after_s(self, t_s: float) -> float | None:
        """Return the time up to which the ground station has read, if it is too far behind; None to go on."""
        request = self._echo.due(t_s)
        if request is not None:
            self._ask(request)
        return self._echo.awaits_after_s(t_s)

    def _ask(self, request: Message) -> None:
        """Have the next vehicle send PING. They take turns: each may have a socket of its own in the station."""
        rows = self._unimpaired()
        if rows:
            self._asked = next((row for row in rows if row > self._asked), rows[0])
            self._put(self._asked, request)

    def _unimpaired(self) -> list[int]:
        """The rows that may send more than a real vehicle does: on impaired links it would change what is lost."""
        return [row for row, v in enumerate(self._vehicles) if v.speaks and row not in self._injector.radios]

    def _put(self, row: int, message: Message) -> None:
        self._board.put(row, [self._encoders[row].encode(message, self._vehicles[row].signature(self._clock()))])

    def departure(self, row: int, t_s: float) -> Departure | None:
        """Return the newest setpoint that arrived for an impaired link; None if there is none."""
        departure = self._departures.get(row)
        if departure is None or row not in self._injector.radios or not is_stamp(departure.stamp_s, t_s):
            return None
        return departure

    def _addressed(self, line: int, message: Message) -> Iterable[int]:
        sysid = message.fields.get("target_system", 0)
        rows = self._board.rows[line]
        if sysid == 0:
            return rows
        row = self._row_of.get(sysid, -1)
        return (row,) if row in rows else ()

    def _hand_on(self, row: int, message: Message, t_s: float, now_s: float) -> None:
        if message.name == "PING":
            self._echo.receive(message)
            return
        if is_fault_command(message):
            order = read_order(message)
            self._injector.end(row, order.ends, t_s)
            for fault in order.begins:
                self._injector.add(row, fault, t_s)
            self._board.put(row, [self._encoders[row].encode(command_ack(message, order.result))])
            return
        radio = self._injector.radios.get(row)
        if radio is None:
            self._deliver(row, message, t_s, now_s)
        else:
            radio.up.put(message.raw, self._leaves_s(row, message, t_s))

    def _leaves_s(self, row: int, message: Message, t_s: float) -> float:
        if message.name != _SETPOINT:
            return t_s
        stamp_s = self._vehicles[row].instruments.simulated_s(message.fields["time_boot_ms"])
        if not is_stamp(stamp_s, t_s):
            return t_s
        self._departures.setdefault(row, Departure()).arrived(stamp_s, t_s)
        return max(stamp_s - LEAD_S, t_s)

    def _deliver(self, row: int, message: Message, t_s: float, now_s: float) -> None:
        if message.name in _ITEMS:
            self._injector.uploaded(row, message.fields["seq"], t_s)
        elif message.name == FTP:
            for item in items_in(message):
                self._injector.uploaded(row, item, t_s)
        answers = self._vehicles[row].receive(message, now_s)
        if answers:
            self.send(row, answers, t_s)


class GroundEcho:
    """How far the ground station has read: it answers a PING after everything that was sent before it.

    A ground station reads what its processor allows, and a socket that is full loses messages without a word. Vehicles
    that run faster than real time therefore send PING, and time goes on by at most `BEHIND_S` beyond one that is not
    answered. A station that answers none is not waited for. https://mavlink.io/en/services/ping.html

    `BEHIND_S` is long enough that a station which keeps up is never waited for: it measures how fast the vehicles' time
    is, and one that sends setpoints just in time would take every wait for a slower time. All times are simulated.
    """

    def __init__(self) -> None:
        self._sent: dict[int, float] = {}  # by number; the unanswered ones
        self._number = 0
        self._next_s = 0.0
        self._read_s = 0.0  # all that was sent until then was read
        self._answers = False

    def due(self, t_s: float) -> Message | None:
        """Return the request that is due, to be sent after all other messages."""
        return self.again(t_s) if t_s >= self._next_s else None

    def again(self, t_s: float) -> Message:
        """Return a request, because the one before may have been lost."""
        self._next_s = t_s + (UNANSWERED_PERIOD_S if self._sent else PERIOD_S)
        self._number += 1
        if not self._answers:
            self._sent.clear()
        self._sent[self._number] = t_s
        target = {"target_system": 0, "target_component": 0}
        return Message("PING", {"time_usec": round(t_s * 1e6), "seq": self._number} | target)

    def receive(self, message: Message) -> None:
        """Take an answer to a PING: the station has read everything that was sent before that PING."""
        number = message.fields["seq"]
        if number in self._sent:
            self._answers = True
            self._read_s = self._sent[number]
            self._sent = {n: sent_s for n, sent_s in self._sent.items() if n > number}
            self._next_s = min(self._next_s, self._read_s + PERIOD_S)

    def awaits_after_s(self, t_s: float) -> float | None:
        """Return the time up to which the station has read, if it is too far behind; None to go on."""
        oldest_s = next(iter(self._sent.values()), t_s)
        return self._read_s if self._answers and t_s - oldest_s >= BEHIND_S else None
