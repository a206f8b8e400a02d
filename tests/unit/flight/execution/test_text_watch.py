"""Critical STATUSTEXTs: told with vehicle and time, once per half minute, and nothing is armed after one."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FlightError
from gcs.flight.execution.text_watch import REPEAT_S, TextWatch
from gcs.flight.monitoring.progress import Event
from gcs.flight.recording.flight_folder import read_events
from gcs.flight.recording.flight_record import FlightRecord
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mavlink import Severity
from tests.virtual_clock import VirtualLoop

RTL = "RTL: unsupported MAV_FRAME\t"
EPOCH_S = 1_795_331_000.0


def heartbeat(sysid: int, autopilot: Autopilot) -> Message:
    fields = {"type": 2, "autopilot": int(autopilot), "base_mode": 1, "custom_mode": 0, "system_status": 3}
    return Message("HEARTBEAT", fields, sysid, 1)


def text(words: str, severity: int = Severity.CRITICAL, number: int = 0, chunk: int = 0) -> Message:
    return Message("STATUSTEXT", {"severity": int(severity), "text": words, "id": number, "chunk_seq": chunk}, 1, 1)


class Scene:
    """Two vehicles of one autopilot that say things, and what comes of it."""

    def __init__(self, autopilot: Autopilot) -> None:
        self.loop = asyncio.get_running_loop()
        self.estimator = autopilot.traits.link.estimator
        self.sessions = {n: VehicleSession(heartbeat(n, autopilot), lambda _: None) for n in (1, 2)}
        self.monitor: Any = SimpleNamespace(t0_unix_s=None)
        self.events: list[Event] = []
        self.watch = TextWatch(self.sessions, self.monitor, self.events.append)
        self.clock()

    def clock(self) -> None:
        for session in self.sessions.values():
            boot_ms = round(self.loop.time() * 1e3)
            fields = {"time_unix_usec": round((EPOCH_S + self.loop.time()) * 1e6), "time_boot_ms": boot_ms}
            session.receive(Message("SYSTEM_TIME", fields, 1, 1), self.loop.time())

    def ready(self, sysid: int) -> None:
        flags = {"flags": self.estimator.required}
        self.sessions[sysid].receive(Message(self.estimator.message.name, flags, 1, 1), self.loop.time())

    def say(self, message: Message, sysid: int = 1) -> None:
        self.sessions[sysid].receive(message, self.loop.time())

    def armable(self, sysid: int | None = None) -> bool:
        try:
            self.watch.refuse(sysid)
        except FlightError as refused:
            assert "before it is armed" in refused.message
            return False
        return True


def play(story: Callable[[Scene], Any], autopilot: Autopilot = Autopilot.PX4) -> None:
    async def whole() -> None:
        scene = Scene(autopilot)
        stop = scene.watch.start()
        await story(scene)
        stop()
        scene.say(text("after the end"))
        assert "after the end" not in str(scene.events)

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(whole())


def test_a_text_caused_by_the_upload_is_told_and_keeps_everybody_on_the_ground() -> None:
    async def story(scene: Scene) -> None:
        assert scene.armable()
        await asyncio.sleep(2.0)
        scene.clock()
        scene.say(text(RTL), 2)
        (event,) = scene.events
        assert (event.sysid, event.what) == (2, "reports: CRITICAL: RTL: unsupported MAV_FRAME")
        assert event.unix_s == pytest.approx(EPOCH_S + scene.loop.time(), abs=0.05)
        assert math.isnan(event.t_s)
        assert str(event).startswith("before T0: vehicle 2 reports: CRITICAL")
        assert not scene.armable()
        assert scene.armable(1)
        assert not scene.armable(2)

    play(story)


def test_warnings_and_known_alarms_are_told_and_are_no_reason_not_to_arm() -> None:
    async def story(scene: Scene) -> None:
        for words, severity in (
            ("Something that no table knows", Severity.WARNING),
            ("Low battery level", Severity.INFO),
            ("EKF3 IMU0 is using GPS", Severity.NOTICE),
        ):
            scene.say(text(words, severity))
        assert scene.armable()
        assert [(event.what, event.rule, event.alarm) for event in scene.events] == [
            ("reports: WARNING: Something that no table knows", "", True),
            ("reports: INFO: Low battery level", "Alarm: battery low", True),
        ]

    play(story)


def test_a_text_in_chunks_is_one_text() -> None:
    async def story(scene: Scene) -> None:
        scene.say(text("x" * 50, number=9))
        assert scene.armable()
        scene.say(text("yz", number=9, chunk=1))
        assert [event.what for event in scene.events] == ["reports: CRITICAL: " + "x" * 50 + "yz"]
        assert not scene.armable()

    play(story)


@pytest.mark.parametrize(
    ("autopilot", "words"),
    [
        (Autopilot.ARDUPILOT, "PreArm: Need Position Estimate"),
        (Autopilot.ARDUPILOT, "Arm: Gyros not healthy"),
        (Autopilot.PX4, "Arming denied: Resolve system health failures first\t"),
    ],
)
def test_texts_of_the_start_up_count_once_the_vehicle_is_ready(autopilot: Autopilot, words: str) -> None:
    async def story(scene: Scene) -> None:
        scene.say(text(words))
        assert scene.armable()
        await asyncio.sleep(1.0)
        scene.ready(1)
        assert scene.armable()
        assert len(scene.events) == 1, "it is told all the same"
        await asyncio.sleep(1.0)
        scene.ready(1)
        scene.say(text(words))
        assert not scene.armable()

    play(story, autopilot)


def test_a_text_that_is_repeated_is_told_every_half_minute() -> None:
    async def story(scene: Scene) -> None:
        scene.monitor.t0_unix_s = EPOCH_S + scene.loop.time()
        for _ in range(31):  # PX4 says it every 2 s
            scene.clock()
            scene.say(text(RTL))
            await asyncio.sleep(2.0)
        whats = [event.what for event in scene.events]
        assert len(whats) == 1 + int(61.0 // REPEAT_S)
        assert "times since" in whats[1]
        assert [round(event.t_s) for event in scene.events] == pytest.approx([0, 30, 60], abs=2)

    play(story)


def test_a_text_is_told_after_the_vehicles_clock_was_set_back() -> None:
    async def story(scene: Scene) -> None:
        scene.say(text(RTL))
        boot_ms = round(scene.loop.time() * 1e3)
        fields = {"time_unix_usec": round((EPOCH_S - 1e8) * 1e6), "time_boot_ms": boot_ms + 100}
        scene.sessions[1].receive(Message("SYSTEM_TIME", fields, 1, 1), scene.loop.time())
        scene.say(text(RTL))
        assert len(scene.events) == 2

    play(story)


def test_events_before_t0_are_kept(tmp_path: Path) -> None:
    events = (Event(math.nan, math.nan, 1, "a"), Event(5.0, math.nan, 2, "b"), Event(6.0, 1.0, 3, "c", "rule"))
    with FlightRecord(tmp_path, pytest.fail, lambda: None) as record:
        for event in events:
            record.write_event(event)
    lines = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    assert [line["t_s"] for line in lines] == [None, None, 1.0]
    assert "NaN" not in (tmp_path / "events.jsonl").read_text()
    assert repr(read_events(tmp_path / "events.jsonl")) == repr(events)
