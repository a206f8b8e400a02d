"""Seven flights of real autopilots, thinned, and a ground station that hears them again.

`Recorded` is a link: the vehicles' frames arrive at the times of the recording, in virtual time. Every command that the
ground station sends is acknowledged, a requested message is the newest recorded one, and TIMESYNC is answered. What the
vehicles do stays as recorded.
"""

from __future__ import annotations

import asyncio
import lzma
import shutil
from collections.abc import Coroutine
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar

from gcs.flight.recording.flight_state import FlightState, read_flight_state
from gcs.flight.recording.tlog import Tlog, load_tlog
from gcs.link.endpoints.addresses import Address
from gcs.link.endpoints.base import LinkSpec, Receive, parse_link_spec
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import MavCommand
from gcs.plan.plan_file import load_plan
from gcs.plan.trajectory.plan import Plan
from tests.virtual_clock import VirtualLoop

T = TypeVar("T")
FOLDER = Path(__file__).resolve().parent / "recorded" / "flights"
FLIGHTS = tuple(sorted(folder.name for folder in FOLDER.iterdir()))
WHERE = ("127.0.0.1", 14550)
_ACCEPTED = 0
_LATENCY_S = 0.01
_TURN_S = 1e-3


def unpacked(name: str, to: Path) -> Path:
    """Copy the folder of one flight, its logs unpacked."""
    folder = to / name
    folder.mkdir()
    for path in (FOLDER / name).iterdir():
        if path.suffix == ".xz":
            (folder / path.stem).write_bytes(lzma.decompress(path.read_bytes()))
        else:
            shutil.copyfile(path, folder / path.name)
    return folder


@lru_cache
def plan_of(name: str) -> Plan:
    """The plan of one flight, loaded and verified once."""
    return load_plan(FOLDER / name / "plan.skein")[0]


class Flight:
    """One recorded flight: its plan, its state, and its last log, each read when it is asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def plan(self) -> Plan:
        return plan_of(self.folder.name)

    @cached_property
    def state(self) -> FlightState:
        return read_flight_state(self.folder)

    @cached_property
    def log(self) -> Tlog:
        return load_tlog(sorted(self.folder.glob("*.tlog"))[0])

    @property
    def t0_unix_s(self) -> float:
        """T0 of the plan."""
        assert self.state.t0_unix_s is not None
        return self.state.t0_unix_s


class Recorded:
    """The endpoint of a recorded flight from `begin_unix_s` on."""

    def __init__(self, log: Tlog, begin_unix_s: float) -> None:
        self.sent: list[Message] = []
        self.over = asyncio.Event()
        self._log = log
        self._begin_unix_s = begin_unix_s
        self._codec = Codec(*GROUND)
        self._codecs: dict[int, Codec] = {}
        self._newest: dict[tuple[int, int], bytes] = {}  # by system and message id
        self._playing: asyncio.Future[None] | None = None
        self._receive: Receive | None = None

    @property
    def local_address(self) -> Address:
        return WHERE

    @property
    def spec(self) -> LinkSpec:
        return parse_link_spec(f"udpin:{WHERE[0]}:{WHERE[1]}")

    async def open(self, receive: Receive) -> None:
        self._receive = receive
        self._playing = asyncio.ensure_future(self._play(receive))

    def send(self, data: bytes, address: Address | None = None) -> None:
        message = self._codec.decode_frame(data)
        assert message is not None
        self.sent.append(message)
        if message.name == "COMMAND_LONG":
            sysid, command = message.fields["target_system"], message.fields["command"]
            fields = {"command": command, "result": _ACCEPTED, "target_system": GROUND.sysid}
            self._answer(sysid, Message("COMMAND_ACK", fields))
            newest = self._newest.get((sysid, int(message.fields["param1"])))
            if command == MavCommand.REQUEST_MESSAGE and newest is not None:
                asyncio.get_running_loop().call_later(_LATENCY_S, self._hear, newest, sysid)
        elif message.name == "TIMESYNC" and not message.fields["tc1"]:
            for sysid in {sysid for sysid, _ in self._newest}:
                now_ns = int(1e9 * asyncio.get_running_loop().time())
                self._answer(sysid, Message("TIMESYNC", {"tc1": now_ns, "ts1": message.fields["ts1"]}))

    def close(self) -> None:
        if self._playing is not None:
            self._playing.cancel()

    def _answer(self, sysid: int, message: Message) -> None:
        frame = self._codecs.setdefault(sysid, Codec(sysid, 1)).encode(message)
        asyncio.get_running_loop().call_later(_LATENCY_S, self._hear, frame, sysid)

    def _hear(self, data: bytes, sysid: int) -> None:
        if self._receive is not None:
            self._receive(data, (WHERE[0], 20000 + sysid))

    async def _play(self, receive: Receive) -> None:
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        for frame, unix_s in zip(self._log.frames, self._log.unix_s.tolist(), strict=True):
            if frame.sysid == GROUND.sysid:
                continue
            self._newest[frame.sysid, int.from_bytes(frame.data[7:10], "little")] = frame.data
            if unix_s < self._begin_unix_s:
                continue
            wait_s = began_s + (unix_s - self._begin_unix_s) - loop.time()
            if wait_s > 0.0:
                await asyncio.sleep(wait_s)
            self._hear(frame.data, frame.sysid)
        self.over.set()


def in_virtual_time(work: Coroutine[Any, Any, T]) -> T:
    """Run `work` as `asyncio.run` does; waiting takes no time."""
    with asyncio.Runner(loop_factory=partial(VirtualLoop, _TURN_S)) as runner:
        return runner.run(work)
