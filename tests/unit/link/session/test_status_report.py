"""The status report from what PX4 really sent: messages that it streams, and requests that it denied."""

from __future__ import annotations

import asyncio
import json
from collections import defaultdict
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot, flight_behaviour
from gcs.cli.flights.vehicles import health
from gcs.errors import PeerTimeout
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.takeoff_landing import FlightVehicle, lacks, until_ready
from gcs.flight.monitoring.monitor import VehicleView
from gcs.link.session.status_report import (
    FRESH_S,
    ReportedWind,
    VehicleReport,
    measure_clock,
    newest_message,
    reported_wind,
    status_report,
)
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MavCommand, MavResult, MessageId
from tests.virtual_clock import VirtualLoop

T = TypeVar("T")
RECORDED = Path(__file__).parents[3] / "recorded" / "px4_requests.jsonl"
DENIED_HERE = {MessageId.SYS_STATUS, MessageId.ESTIMATOR_STATUS, MessageId.GPS_RAW_INT, MessageId.GLOBAL_POSITION_INT}


class RecordedPx4:
    """Streams what the recorded vehicle sent, when it sent it, and answers each request as it answered."""

    def __init__(
        self,
        unstreamed: frozenset[MessageId] = frozenset(),
        intervals_us: Mapping[int, int] | None = None,
        *,
        denies_all: bool = False,
        obeys: bool = True,
    ) -> None:
        self.rows: list[tuple[float, Message]] = []
        self.results: dict[int, list[int]] = defaultdict(list)
        self.last: dict[str, Message] = {}
        self.sent: list[tuple[int, int, float]] = []  # command, message, param2
        self.intervals_us = dict(intervals_us or {})
        self.session: VehicleSession | None = None
        self._denies_all = denies_all
        self._obeys = obeys
        asked: list[int] = []
        vehicle, ground = Codec(255, 190), Codec(9, 9)
        for line in RECORDED.read_text().splitlines():
            row = json.loads(line)
            (message,) = (vehicle if row["dir"] == "veh->gcs" else ground).decode(bytes.fromhex(row["hex"]))
            if message.name == "COMMAND_LONG":
                asked.append(int(message.fields["param1"]))
            elif message.name == "COMMAND_ACK":
                self.results[asked.pop(0)].append(int(message.fields["result"]))
            else:
                self.last.setdefault(message.name, message)
                if message.name not in {number.name for number in unstreamed}:
                    self.rows.append((row["t"], message))

    def run(self, act: Callable[[VehicleSession], Awaitable[T]], from_s: float = 0.0) -> T:
        """The ground station acts when the recording has lasted `from_s`."""

        async def story() -> T:
            loop = asyncio.get_running_loop()
            self.session = VehicleSession(self.last["HEARTBEAT"], self.hear)
            for t_s, message in self.rows:
                if t_s >= from_s - 3.0:
                    loop.call_later(t_s - from_s + 3.0, self.say, message)
            await asyncio.sleep(3.0)
            return await act(self.session)

        with asyncio.Runner(loop_factory=VirtualLoop) as runner:
            return runner.run(story())

    def say(self, message: Message) -> None:
        assert self.session is not None
        self.session.receive(message, asyncio.get_running_loop().time())

    def hear(self, message: Message) -> None:
        if message.name != "COMMAND_LONG":
            return
        fields = message.fields
        command, number = int(fields["command"]), int(fields["param1"])
        self.sent.append((command, number, fields["param2"]))
        answers: list[Message] = []
        result = int(MavResult.ACCEPTED)
        match command:
            case MavCommand.REQUEST_MESSAGE:
                results = self.results[number]
                result = int(MavResult.DENIED) if self._denies_all or not results else results.pop(0)
                if result == MavResult.ACCEPTED:
                    answers.append(self.last[MessageId(number).name])
            case MavCommand.GET_MESSAGE_INTERVAL:
                interval = {"message_id": number, "interval_us": self.intervals_us.get(number, -1)}
                answers.append(Message("MESSAGE_INTERVAL", interval, 1, 1))
            case MavCommand.SET_MESSAGE_INTERVAL if self._obeys:
                self.intervals_us[number] = int(fields["param2"])
                if fields["param2"] > 0:
                    asyncio.get_running_loop().call_later(0.2, self.say, self.last[MessageId(number).name])
            case _:
                result = int(MavResult.DENIED)
        ack = {"command": command, "result": result, "progress": 0, "result_param2": 0}
        target = {"target_system": GROUND.sysid, "target_component": GROUND.compid}
        for answer in (*answers, Message("COMMAND_ACK", ack | target, 1, 1)):
            asyncio.get_running_loop().call_later(0.004, self.say, answer)


def lacking(report: VehicleReport) -> set[str]:
    names = ("version", "uid", "prearm_ok", "estimate_ok", "ailing", "home", "position", "origin", "satellites",
             "fix_type", "battery_share", "battery_V", "working")  # fmt: skip
    return {name for name in names if getattr(report, name) is None}


def test_the_recorded_vehicle_denied_most_requests() -> None:
    results = RecordedPx4().results
    assert {n for n, found in results.items() if MavResult.DENIED in found} == {*map(int, DENIED_HERE)}
    assert results[MessageId.GPS_RAW_INT].count(MavResult.ACCEPTED) == 1


@pytest.mark.parametrize("from_s", [3.0, 3.7, 4.1, 4.6])
def test_what_is_on_the_wire_is_reported(from_s: float) -> None:
    px4 = RecordedPx4()
    report = px4.run(status_report, from_s)
    assert lacking(report) == set()
    assert report.estimate_ok and report.prearm_ok
    assert report.ailing == ("radio control",)
    assert health(report) == "ready, radio control not healthy"
    assert {command for command, *_ in px4.sent} == {MavCommand.REQUEST_MESSAGE}, "nothing was changed"
    assert not {number for _, number, _ in px4.sent} & {*map(int, DENIED_HERE)}, "what is fresh is not requested"


@pytest.mark.parametrize("before_us", [-1, 1_000_000])
def test_what_is_not_streamed_and_denied_is_streamed_for_a_moment(before_us: int) -> None:
    gps = MessageId.GPS_RAW_INT
    px4 = RecordedPx4(frozenset({gps}), {gps: before_us}, denies_all=True)
    report = px4.run(status_report, 3.0)
    assert report.fix_type == 3
    assert px4.intervals_us[gps] == before_us
    ours = [one for one in px4.sent if one[1] == gps]
    assert [command for command, *_ in ours] == [
        MavCommand.REQUEST_MESSAGE,
        MavCommand.GET_MESSAGE_INTERVAL,
        MavCommand.SET_MESSAGE_INTERVAL,
        MavCommand.SET_MESSAGE_INTERVAL,
    ]
    assert ours[-1][2] == before_us


@pytest.mark.parametrize(("lost", "known"), [(0, True), (12, True), (1000, False)])
def test_a_radio_that_loses_the_first_answers_leaves_the_clock_known(lost: int, known: bool) -> None:
    class Vehicle:
        station, asked, hear = Station(1, 1), 0, staticmethod(lambda message: None)

        def subscribe(self, receive: Callable[[Message], None]) -> Callable[[], None]:
            self.hear = receive  # type: ignore[assignment]
            return lambda: None

        def send(self, message: Message) -> None:
            self.asked += 1
            if self.asked > lost:
                answer = Message("TIMESYNC", {**message.fields, "tc1": 7}, 1, 1)
                asyncio.get_running_loop().call_later(0.8, self.hear, answer)

    vehicle: Any = Vehicle()
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        found = runner.run(measure_clock(vehicle))
    assert (found is not None) is known
    if found is not None:
        assert found.round_trip_s == pytest.approx(0.8, abs=0.05)


def test_what_a_vehicle_does_not_send_is_not_reported() -> None:
    gps = MessageId.GPS_RAW_INT
    report = RecordedPx4(frozenset({gps}), denies_all=True, obeys=False).run(status_report, 3.0)
    assert {"fix_type", "satellites"} <= lacking(report) <= {"fix_type", "satellites", "version", "uid", "origin"}


@pytest.mark.parametrize(("age_s", "counts"), [(FRESH_S - 0.1, True), (FRESH_S + 0.1, False)])
def test_a_streamed_message_counts_while_it_is_fresh(age_s: float, counts: bool) -> None:
    px4 = RecordedPx4(frozenset(MessageId), denies_all=True, obeys=False)

    async def ask(session: VehicleSession) -> Message | None:
        px4.say(px4.last["GPS_RAW_INT"])
        await asyncio.sleep(age_s)
        return await newest_message(session, MessageId.GPS_RAW_INT)

    assert (px4.run(ask) is not None) == counts
    assert bool(px4.sent) != counts


@settings(max_examples=60, deadline=None)
@given(flags=st.integers(0, 2047) | st.sampled_from([0x33F, 0xA7, 1023, 229]), autopilot=st.sampled_from(Autopilot))
def test_waiting_and_reporting_have_one_definition_of_ready(flags: int, autopilot: Autopilot) -> None:
    """A vehicle that pre-flight finds not healthy is waited for, and one that was waited for is healthy."""

    async def story() -> tuple[bool | None, bool]:
        loop = asyncio.get_running_loop()
        fields: dict[str, Any] = {"type": 2, "base_mode": 1, "custom_mode": 0, "system_status": 3}
        session = VehicleSession(Message("HEARTBEAT", fields | {"autopilot": int(autopilot)}, 1, 1), lambda _: None)
        estimator = autopilot.traits.link.estimator
        session.receive(Message(estimator.message.name, {"flags": flags}, 1, 1), loop.time())
        now = {"time_unix_usec": 1_795_331_000_000_000, "time_boot_ms": 5000}
        session.receive(Message("SYSTEM_TIME", now, 1, 1), loop.time())
        report = await newest_message(session, estimator.message)
        assert report is not None
        options = FlightOptions(ready_timeout_s=1.0, find_timeout_s=1.0)
        behaviour = flight_behaviour(1, int(autopilot), fields["type"])
        crew = FlightVehicle(session, behaviour, None, 0, VehicleView(1), options)  # type: ignore[arg-type]
        try:
            await until_ready(crew)
        except PeerTimeout as late:
            assert "a position estimate" in late.message
            assert lacks(session) == "no position estimate"
            return (await status_report(session)).estimate_ok, False
        assert lacks(session) == ""
        return (await status_report(session)).estimate_ok, True

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        found, waited = runner.run(story())
    assert waited == (found if found is not None else waited)
    assert waited == autopilot.traits.link.estimator.is_ready(
        autopilot.traits.link.estimator.message.name, {"flags": flags}
    )


@pytest.mark.parametrize(
    ("name", "fields", "age_s", "expected"),
    [
        ("WIND", {"direction": -120.0, "speed": 5.0, "speed_z": 0.0}, 0.0, ReportedWind(5.0, 240.0)),
        ("WIND_COV", {"wind_x": 3.0, "wind_y": 4.0, "wind_z": 0.0}, 0.0, ReportedWind(5.0, 233.130102)),
        ("WIND_COV", {"wind_x": -6.0, "wind_y": 0.0, "wind_z": 0.0}, 0.0, ReportedWind(6.0, 0.0)),
        ("WIND_COV", {"wind_x": float("nan"), "wind_y": 4.0, "wind_z": 0.0}, 0.0, None),
        ("WIND", {"direction": 90.0, "speed": 5.0, "speed_z": 0.0}, FRESH_S + 1.0, None),
    ],
)
def test_wind_is_where_it_comes_from_in_either_message(
    name: str, fields: dict[str, Any], age_s: float, expected: ReportedWind | None
) -> None:
    async def story() -> ReportedWind | None:
        heartbeat = {"type": 2, "base_mode": 1, "custom_mode": 0, "system_status": 3, "autopilot": 3}
        session = VehicleSession(Message("HEARTBEAT", heartbeat, 1, 1), lambda _: None)
        session.receive(Message(name, fields, 1, 1), asyncio.get_running_loop().time())
        await asyncio.sleep(age_s)
        return reported_wind(session)

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        found = runner.run(story())
    assert found == (None if expected is None else pytest.approx(expected))
