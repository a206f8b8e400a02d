"""Flights of real autopilots, heard again: report, replay, monitor and contingency policy say what happened."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.cli.flights.fly_view import FlightView
from gcs.cli.main import run
from gcs.cli.shared.console import Screen
from gcs.cli.shared.plan_argument import Stopwatch
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.execution.resume import Resume, resume_flight
from gcs.flight.monitoring.preflight_check import NOT_REPORTED
from gcs.flight.monitoring.progress import Event, FlightHooks
from gcs.flight.recording.tlog import Tlog, load_tlog
from gcs.flight.setup.build_loads import PreparedFlight, fleet_autopilots, missions_only
from gcs.flight.setup.preflight import preflight
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.session.status_report import VehicleReport, status_report
from gcs.mavlink import MavCommand
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.mission.waypoints.mission_items import build_missions
from gcs.util.aio import alongside
from tests.real_flights import FLIGHTS, Flight, Recorded, in_virtual_time, unpacked

FULL = [name for name in FLIGHTS if "fence" not in name]
WHOLE = ("arducopter-4.5.6-follow-wind", "px4-1.17dev-stream", "mixed-stream")  # the others with `-m long`
BOTH_AUTOPILOTS, OLD_RALLY, MISSION = "mixed-stream", "px4-1.17dev-return-into-fence", "arducopter-4.5.6-mission"


def fast(*names: str) -> list[object]:
    """All flights; only these while nothing else is asked for."""
    return [pytest.param(name, marks=() if name in names else pytest.mark.slow) for name in FLIGHTS]


# The whole logs tell: root mean square of plan minus estimate, m; delay behind the plan, s; formation error, m. These
# setpoints took the metres of local frames for those of the plan, so the vehicles stopped 2.3 m (PX4: 1.5 m) short.
SEEN = {
    "arducopter-4.5.6-follow-wind": ((1.31, 1.33), (0.23, 0.25), 1.5),
    "arducopter-4.5.6-mission": ((1.59, 2.11), (0.36, 0.51), 0.31),
    "arducopter-4.5.6-stream": ((1.31, 1.34), (0.23, 0.25), 0.37),
    "mixed-stream": ((0.96, 1.33), (0.14, 0.25), 1.9),
    "px4-1.17dev-follow": ((0.94, 1.22), (0.12, 0.15), 2.27),
    "px4-1.17dev-stream": ((0.95, 1.00), (0.14, 0.15), 0.81),
}

# In flight each clock follows GNSS time slowly; a report knows the whole flight.
LINKED_S = 0.02

# Every two seconds while these flights had rally points in frame 6: shown, and no incident.
OLD_RALLY_FRAME = "RTL: unsupported MAV_FRAME"

# More than the largest position error that the lines of progress say in the landing, m: these landed up to 2.3 m short.
# Beside the planned descent it would be 15 m.
LANDING_LINES = {
    "arducopter-4.5.6-follow-wind": 2.6,
    "arducopter-4.5.6-stream": 2.6,
    "mixed-stream": 3.2,
    "px4-1.17dev-follow": 2.9,
    "px4-1.17dev-stream": 2.6,
}


@pytest.mark.parametrize(
    "name", [name if name in WHOLE else pytest.param(name, marks=pytest.mark.slow) for name in FULL]
)
def test_the_report_has_the_figures_that_were_seen(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["report", str(unpacked(name, tmp_path)), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (least_m, most_m), (first_s, last_s), formation_m = SEEN[name]
    assert len(found["vehicles"]) == 6
    for vehicle in found["vehicles"]:
        assert least_m <= vehicle["plan_estimate_m"] <= most_m
        assert first_s <= vehicle["late_s"] <= last_s
    assert formation_m - 0.1 < found["formation_error_max_m"] < formation_m + 0.02


@pytest.mark.parametrize("name", fast(BOTH_AUTOPILOTS, MISSION))
def test_a_replay_names_every_mode_and_every_vehicle(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["replay", str(unpacked(name, tmp_path)), "--speed", "1000"]) == 0
    said = capsys.readouterr()
    assert "6 of 6 vehicles heard" in said.out + said.err
    assert not re.search(r"is in mode \d", said.out + said.err)


def first_arming(folder: Path) -> tuple[Tlog, float]:
    """The log in which vehicles were armed, and when the first one was ordered to."""
    for path in sorted(folder.glob("*.tlog")):
        log = load_tlog(path)
        for frame, unix_s in zip(log.frames, log.unix_s.tolist(), strict=True):
            order = frame.message
            if order is not None and order.fields.get("command") == MavCommand.COMPONENT_ARM_DISARM:
                return log, unix_s
    raise AssertionError(folder)


@pytest.mark.parametrize("name", fast(BOTH_AUTOPILOTS, OLD_RALLY))
def test_pre_flight_lets_go_what_flew(name: str, tmp_path: Path) -> None:
    """Without remote control too, and where PX4 denied requests. Its complaint of the old rally frame is a no-go."""
    folder = unpacked(name, tmp_path)
    plan = Flight(folder).plan
    log, armed_unix_s = first_arming(folder)

    async def ask() -> dict[int, VehicleReport]:
        link = Recorded(log, armed_unix_s - 1.0)
        fleet = LinkedFleet([link])
        await link.open(lambda data, address: fleet._receive(0, data, address))
        sessions = await fleet.vehicles(plan.sysids, 15.0)
        reports = await asyncio.gather(*(status_report(session) for session in sessions.values()))
        link.close()
        return dict(zip(sessions, reports, strict=True))

    checks = [check for check in preflight(plan, in_virtual_time(ask())) if check.name not in ("capacity", "wind")]
    assert {check.sysid for check in checks} == set(plan.sysids)
    assert not [check for check in checks if check.measured == NOT_REPORTED]
    assert {(check.name, check.measured) for check in checks if not check.go} <= {("messages", OLD_RALLY_FRAME)}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in WHOLE else pytest.mark.long)
        for name in FULL
        if "mission" not in name
    ],
)
def test_a_whole_flight_passes_without_an_incident(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded = Flight(unpacked(name, tmp_path))
    events: list[Event] = []

    async def hear() -> FlightSequence:
        plan, options = recorded.plan, FlightOptions(mode=FlightMode.MISSION)
        link = Recorded(recorded.log, recorded.t0_unix_s - 5.0)
        fleet = LinkedFleet([link])
        await link.open(lambda data, address: fleet._receive(0, data, address))
        sessions = await fleet.vehicles(plan.sysids, 15.0)
        sequence = FlightSequence(
            plan,
            sessions,
            options,
            PreparedFlight(
                missions_only(build_missions(plan)),
                build_stream(plan, 5.0),
                plan_returns(plan, fleet_autopilots(plan, {n: s.autopilot for n, s in sessions.items()})),
            ),
            FlightHooks(events.append),
        )
        async with alongside(FlightView(Screen(), Stopwatch(0.0), "").follow(sequence)):
            await resume_flight(sequence, Resume.RESUME, recorded.t0_unix_s)
        link.close()
        return sequence

    heard = in_virtual_time(hear())
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("landing: ")]
    errors_m = [float(m[1]) for line in lines if (m := re.search(r"position error at most ([\d.]+) m", line))]
    assert len(errors_m) >= 5
    assert max(errors_m) < LANDING_LINES[name]
    assert not any("formation error" in line for line in lines[1:])  # the first one is of the last moment before
    assert [event for event in events if OLD_RALLY_FRAME not in event.what] == []
    first_s, last_s = SEEN[name][1]
    late = heard.monitor.late_s
    assert all(first_s - LINKED_S <= late_s <= last_s + LINKED_S for late_s in late.values()), late


@pytest.mark.slow
def test_each_vehicle_of_a_mixed_fleet_gets_what_its_own_autopilot_needs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """1, 3 and 5 are ArduCopters, 2, 4 and 6 PX4s, which were sent everything 0.1 s earlier: both keep time."""
    folder = unpacked("mixed-stream", tmp_path)
    assert run(["report", str(folder), "--json"]) == 0
    reported = {vehicle["sysid"]: vehicle for vehicle in json.loads(capsys.readouterr().out)["vehicles"]}
    recorded = Flight(folder)

    async def hear() -> FlightSequence:
        link = Recorded(recorded.log, recorded.t0_unix_s - 5.0)
        fleet = LinkedFleet([link])
        await link.open(lambda data, address: fleet._receive(0, data, address))
        plan = recorded.plan
        sessions = await fleet.vehicles(plan.sysids, 15.0)
        loads, stream = missions_only(build_missions(plan)), build_stream(plan, 5.0)
        sequence = FlightSequence(plan, sessions, FlightOptions(), PreparedFlight(loads, stream))
        link.close()
        return sequence

    sequence = in_virtual_time(hear())
    each = fleet_autopilots(recorded.plan, {sysid: s.autopilot for sysid, s in sequence.sessions.items()})
    assert each == (Autopilot.ARDUPILOT, Autopilot.PX4) * 3
    for sysid, known in zip(recorded.plan.sysids, each, strict=True):
        least_m, most_m, late_s = (1.31, 1.34, 0.239) if known is Autopilot.ARDUPILOT else (0.95, 0.99, 0.149)
        assert least_m <= reported[sysid]["plan_estimate_m"] <= most_m
        lead_s = 0.0 if known is Autopilot.ARDUPILOT else 0.1
        assert sequence.vehicles[sysid].behaviour.lag_s == lead_s
        assert reported[sysid]["late_s"] == pytest.approx(late_s, abs=0.015)
    returns = plan_returns(recorded.plan, each)
    assert [altitude_m == round(altitude_m) for altitude_m in returns.altitudes_m[::2]] == [True] * 3
