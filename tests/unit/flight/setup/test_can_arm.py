"""Whether a vehicle can be armed, by its own word: recorded of a real autopilot that said no, and texts that count."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from gcs.flight.setup.preflight import preflight, preflight_report
from gcs.link.session.status_report import REPEATED_S, VehicleReport
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message
from gcs.plan.trajectory.plan import Plan
from tests.virtual_clock import VirtualLoop

RECORDED = Path(__file__).parents[3] / "recorded" / "prearm_go.jsonl"
SAID = "PreArm: Battery 1 below minimum arming voltage"
CURED = "PreArm: Mode requires mission"
READY_S, ARMS_S = 32.0, 34.7  # in the recording: its estimate is good enough; Skein orders it to arm


def recorded() -> list[tuple[float, Message]]:
    """ArduCopter 4.5.6 with BATT_ARM_VOLT above its voltage: time and message; the first is a HEARTBEAT."""
    codec, rows = Codec(255, 190), []
    for line in RECORDED.read_text().splitlines():
        row = json.loads(line)
        rows += [(row["t"], message) for message in codec.decode(bytes.fromhex(row["hex"]), None)]
    rows = [row for row in rows if row[0] < ARMS_S]
    status = next(message for _, message in reversed(rows) if message.name == "SYS_STATUS")
    return rows + [(ARMS_S + i, status) for i in range(60)]


def text(words: str) -> Message:
    return Message("STATUSTEXT", {"severity": 2, "text": words, "id": 0, "chunk_seq": 0}, 1, 1)


def reported(rows: list[tuple[float, Message]], at_s: float) -> tuple[VehicleReport, list[str]]:
    """The report for pre-flight that begins at this time of a recording, and what was said meanwhile."""
    said: list[str] = []

    async def story() -> VehicleReport:
        loop = asyncio.get_running_loop()

        def deny(message: Message) -> None:
            if message.name == "COMMAND_LONG":
                ack = {"command": message.fields["command"], "result": 2, "progress": 0, "result_param2": 0}
                target = {"target_system": GROUND.sysid, "target_component": GROUND.compid}
                loop.call_later(0.01, lambda: session.receive(Message("COMMAND_ACK", ack | target, 1, 1), loop.time()))

        session = VehicleSession(rows[0][1], deny)
        for t_s, message in rows:
            loop.call_later(t_s, lambda message=message: session.receive(message, loop.time()))
        await asyncio.sleep(at_s)
        return await preflight_report(session, said.append)

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(story()), said


def can_arm(plan: Plan, report: VehicleReport) -> tuple[str, bool]:
    checks = preflight(plan, {plan.sysids[0]: report})
    return next((check.measured, check.ok) for check in checks if check.name == "can arm")


def test_a_real_autopilot_that_said_no_is_a_no_go_in_its_own_words(simulation1_plan: Plan) -> None:
    report, said = reported(recorded(), READY_S)
    assert can_arm(simulation1_plan, report) == (SAID, False)
    assert said == []


def test_one_that_gives_no_reason_has_half_a_minute_to_tell_it(simulation1_plan: Plan) -> None:
    rows = [row for row in recorded() if row[1].name != "STATUSTEXT"]
    report, said = reported([*rows, (READY_S + 25.0, text("PreArm: Compass not calibrated"))], READY_S)
    assert can_arm(simulation1_plan, report) == ("PreArm: Compass not calibrated", False)
    assert said == [f"vehicle 1 reports that it cannot be armed; waiting {REPEATED_S:g} s for its reason"]
    silent, _ = reported(rows, READY_S)
    assert can_arm(simulation1_plan, silent) == ("no, reason not told", False)


@pytest.mark.parametrize(
    ("heard", "expected"),
    [
        ([(READY_S - 1.0, CURED)], ("yes", True)),  # the flight brings mode and mission
        ([(READY_S - 1.0, CURED), (READY_S - 1.0, SAID)], (SAID, False)),
    ],
)
def test_what_the_flight_itself_cures_is_no_reason(
    simulation1_plan: Plan, heard: list[tuple[float, str]], expected: tuple[str, bool]
) -> None:
    rows = [row for row in recorded() if row[1].name != "STATUSTEXT"]
    report, _ = reported([*rows, *((t_s, text(words)) for t_s, words in heard)], READY_S)
    assert can_arm(simulation1_plan, report) == expected
    assert CURED not in report.critical_texts
