"""The socket of a running flight, in its folder: `gcs tell` gives it orders. It is open to the same user alone.

A client sends one line and gets answers line by line: at once whether the order is obeyed, and for one that changes the
plan a second one when it has been planned. The flight never waits for a client.
"""

import asyncio
import json
import os
import socket
import struct
from collections.abc import AsyncIterator, Callable, Collection, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

from gcs.errors import FlightError, GcsError, UsageError
from gcs.flight.contingency.order_words import order_instead, order_of
from gcs.flight.monitoring.progress import AskedOrder, InFlight
from gcs.plan.formation_orders import Hold, PlanOrder
from gcs.plan.trajectory.plan import Plan

NAME = "orders.sock"
_LINE_BYTES, _CLIENTS, _READ_S = 8192, 4, 5.0
_PATH_MAX = 100  # of a socket: longer ones are reached through their open folder
_PEER = struct.Struct("3i")  # pid, uid, gid
_CONNECT_S, _PLANS_S = 5.0, 120.0
_INSTEAD = {AskedOrder.HOLD: "brakes", AskedOrder.LAND: "lands", AskedOrder.RETURN: "returns"}


class Ordered(InFlight, Protocol):
    """A flight that takes orders, with the plan as it is flown."""

    @property
    def plan(self) -> Plan:
        """The plan as it is flown."""
        ...


@dataclass(frozen=True)
class Told:
    """What a client sends: the words of an order, and the vehicles, by system id; none: all."""

    words: tuple[str, ...]
    vehicles: tuple[int, ...] = ()
    in_degrees: bool = False

    @classmethod
    def of(cls, line: bytes) -> "Told":
        """Read a line. Raises UsageError."""
        try:
            found = json.loads(line)
            words, vehicles, in_degrees = found["words"], found["vehicles"], found["in_degrees"]
            if not (
                isinstance(in_degrees, bool)
                and all(isinstance(word, str) for word in words)
                and all(type(sysid) is int for sysid in vehicles)
            ):
                raise TypeError
            return cls(tuple(words), tuple(vehicles), in_degrees)
        except (ValueError, TypeError, KeyError, RecursionError):
            raise UsageError("this is no order", hint="use `gcs tell` of the same version") from None


@asynccontextmanager
async def taking_orders(flight: Ordered, folder: Path, say: Callable[[str], None]) -> AsyncIterator[None]:
    """Take orders for a flight at a socket in its folder; a folder that cannot have one is reported."""
    clients: set[asyncio.Task[None]] = set()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        if len(clients) >= _CLIENTS or not _is_ours(writer):
            writer.close()
            return
        clients.add(task)
        try:
            await _serve(flight, reader, writer)
        except (OSError, TimeoutError, ValueError):  # a client that went, or sends no line
            pass
        except Exception as failure:
            say(f"WARNING: an order failed: {type(failure).__name__}: {failure}")
        finally:
            clients.discard(task)
            writer.close()

    try:
        listening = _listening(folder)
        server = await asyncio.start_unix_server(serve, sock=listening, limit=_LINE_BYTES)
    except (OSError, AttributeError, NotImplementedError) as problem:
        say(f"WARNING: no orders are taken by `gcs tell`: {problem}")
        yield
        return
    try:
        yield
    finally:
        server.close()
        for client in clients:
            client.cancel()
        with suppress(OSError):
            (folder / NAME).unlink()


async def _serve(flight: Ordered, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    if not (line := await asyncio.wait_for(reader.readline(), _READ_S)):
        return  # it only looked whether a flight is here
    told = Told.of(line)
    try:
        order = order_of(told.words, flight.plan.scenario, in_degrees=told.in_degrees)
        if isinstance(order, Hold) and told.vehicles:
            order = AskedOrder.HOLD
        if told.vehicles and not isinstance(order, AskedOrder):
            raise UsageError(f"{told.words[0]} is for the whole formation", hint="leave --vehicles out")
        try:
            await _obeyed(flight, order, told.vehicles, writer)
        except FlightError as refusal:
            instead = order_instead(told.words, flight.plan.scenario)
            if instead is None or isinstance(order, AskedOrder):
                raise
            _send(writer, f"{refusal.message} Each {_INSTEAD[instead]} by itself.", is_last=False)
            await _obeyed(flight, instead, (), writer)
    except GcsError as refusal:
        _send(writer, refusal.message, hint=refusal.hint, is_refusal=True)
    await writer.drain()


async def _obeyed(
    flight: Ordered, order: AskedOrder | PlanOrder, vehicles: tuple[int, ...], writer: asyncio.StreamWriter
) -> None:
    """Give an order, and send what comes of it. Raises FlightError where it is refused."""
    obey = flight.ask(order, vehicles, by="gcs tell")
    if isinstance(order, AskedOrder):
        _send(writer, f"ordered to {order.value}: {_vehicles(obey)}")
    else:
        _send(writer, f"{_vehicles(obey)}: {order}; a new plan is being made", is_last=False)
        _send(writer, await flight.answer())


def _vehicles(sysids: Collection[int]) -> str:
    return f"vehicle{'s' if len(sysids) > 1 else ''} {', '.join(map(str, sysids))}"


def _send(
    writer: asyncio.StreamWriter, text: str, *, hint: str = "", is_refusal: bool = False, is_last: bool = True
) -> None:
    answer = {"text": text, "hint": hint, "is_refusal": is_refusal, "is_last": is_last}
    writer.write(json.dumps(answer).encode() + b"\n")


def _is_ours(writer: asyncio.StreamWriter) -> bool:
    """Whether a client is of the same user, where the system can tell; the socket's mode says so everywhere."""
    if not hasattr(socket, "SO_PEERCRED"):
        return True
    peer = writer.get_extra_info("socket").getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
    return bool(_PEER.unpack(peer)[1] == os.getuid())


@contextmanager
def _reached(folder: Path) -> Iterator[str]:
    """The path of a folder's socket, short enough for one."""
    path = str(folder / NAME)
    if len(os.fsencode(path)) <= _PATH_MAX:
        yield path
        return
    at = os.open(folder, os.O_RDONLY)
    try:
        yield f"/proc/self/fd/{at}/{NAME}"
    finally:
        os.close(at)


def _listening(folder: Path) -> socket.socket:
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    with _reached(folder) as path:
        if not takes_orders(folder):  # a process that was killed leaves its socket
            Path(path).unlink(missing_ok=True)
        old = os.umask(0o177)
        try:
            listening.bind(path)
        finally:
            os.umask(old)
    listening.setblocking(False)
    return listening


def takes_orders(folder: Path) -> bool:
    """Whether a flight listens at the socket of a folder."""
    with _reached(folder) as path, socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(_CONNECT_S)
        try:
            client.connect(path)
        except OSError:
            return False
        return True


def tell(folder: Path, told: Told) -> Iterator[str]:
    """Give an order to the flight of a folder, and yield its answers. Raises FlightError where it is refused.

    Raises UsageError where no flight takes orders.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(_CONNECT_S)
        try:
            with _reached(folder) as path:
                client.connect(path)
            client.sendall(json.dumps(asdict(told)).encode() + b"\n")
            client.settimeout(_PLANS_S)
            with client.makefile("rb") as answers:
                for line in answers:
                    answer = json.loads(line)
                    if answer["is_refusal"]:
                        raise FlightError(answer["text"], hint=answer["hint"])
                    yield answer["text"]
                    if answer["is_last"]:
                        return
        except TimeoutError:
            raise FlightError(
                "the flight has not answered yet.", hint="events.jsonl in its folder will say what came of the order"
            ) from None
        except OSError as problem:
            raise UsageError(
                f"no flight takes orders in {folder} ({problem.strerror or problem}).",
                hint="`gcs attach` takes up a flight whose `gcs fly` has ended",
            ) from problem
    raise FlightError("the flight ended before it answered.", hint="see events.jsonl in its folder")


def newest_flying(root: Path) -> Path:
    """The folder of the last flight under `root` that takes orders. Raises UsageError."""
    folders = sorted((each.parent for each in root.glob(f"*/{NAME}")), reverse=True)  # they are named by their time
    found = next(filter(takes_orders, folders), None)
    if found is None:
        raise UsageError(
            f"there is no flight under way under {root}.",
            hint="name the folder of flights with --to, or with --link the link of vehicles",
        )
    return found
