"""What is checked is what is written: files that differ from the plan do not leave the exporter."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import VerificationError
from gcs.mission.export.atomic_folder import INDEX
from gcs.mission.export.export import export
from gcs.mission.export.mission_files import verify_box
from gcs.mission.flight_limits import limits_of
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.registry import Format, select_formats
from gcs.mission.geofence import NO_FENCE
from gcs.mission.model import Altitude
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.trajectory.plan import Plan

Tamper = Callable[[MissionFile], MissionFile]


def tampered(name: str, change: Tamper) -> Format:
    """A format whose writer writes another mission."""
    (row,) = select_formats([name])
    return replace(row, writer=lambda file: row.write(change(file)))


def moved(file: MissionFile, index: int, **changes: object) -> MissionFile:
    items = list(file.items)
    items[index] = replace(items[index], **changes)  # type: ignore[arg-type]
    return replace(file, items=tuple(items))


def sunk(file: MissionFile) -> MissionFile:
    return moved(file, 5, alt_m=file.items[5].alt_m - 30.0)


def strayed(file: MissionFile) -> MissionFile:
    return moved(file, 5, lat_degE7=file.items[5].lat_degE7 + 100_000)


def raced(file: MissionFile) -> MissionFile:
    speeds = [n for n, item in enumerate(file.items) if item.command == 178]
    return moved(file, speeds[1], params=(1.0, 9.0, -1.0, 0.0))


def gathered(file: MissionFile) -> MissionFile:
    """The first waypoint of all vehicles in one place."""
    return moved(file, 3, lat_degE7=-353632572, lon_degE7=1491652390)


def unknown(file: MissionFile) -> MissionFile:
    return moved(file, 1, command=9999)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (sunk, r"\[terrain\] item 6: flies into the ground"),
        (strayed, r"\[fence\] item \d+: leaves the fence"),
        (raced, r"\[speed\] .* m/s"),
        (gathered, r"\[separation\] .* m from the vehicle of uav\d.plan; at least 2 m"),
        (unknown, r"\[command\] item 2: ArduCopter does not execute command 9999"),
    ],
)
def test_a_file_that_does_not_hold_is_not_written(hop: Plan, tmp_path: Path, change: Tamper, reason: str) -> None:
    export(hop, tmp_path / "out", formats=["plan"], timed=False)
    before = (tmp_path / "out" / "uav1.plan").read_bytes()
    with pytest.raises(VerificationError, match=reason) as caught:
        export(hop, tmp_path / "out", formats=[tampered("plan", change)], timed=False)
    assert "setpoint stream" in caught.value.hint
    assert (tmp_path / "out" / "uav1.plan").read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_two_formats_must_hold_one_mission(hop: Plan, tmp_path: Path) -> None:
    def other(file: MissionFile) -> MissionFile:
        return moved(file, 0, autocontinue=False)

    formats = ["plan", tampered("waypoints", other)]
    with pytest.raises(VerificationError, match=r"uav1\.plan and uav1\.waypoints hold different missions"):
        export(hop, tmp_path / "out", formats=formats)


def test_a_plan_file_without_its_fence_is_not_the_mission(hop: Plan, tmp_path: Path) -> None:
    def unfenced(file: MissionFile) -> MissionFile:
        return replace(file, geofence=NO_FENCE, rally=())

    with pytest.raises(VerificationError, match=r"hold different missions"):
        export(hop, tmp_path / "out", formats=[tampered("plan", unfenced), "waypoints"])


@pytest.mark.parametrize("firmware", list(Autopilot))
@pytest.mark.parametrize("altitude", [Altitude.RELATIVE, Altitude.AMSL])
def test_what_is_written_holds_for_both_autopilots(
    hop: Plan, tmp_path: Path, firmware: Autopilot, altitude: Altitude
) -> None:
    formats = ["plan", "waypoints"]
    index = export(hop, tmp_path, formats=formats, firmware=firmware, altitude=altitude, timed=False)
    report = index.report
    assert report is not None
    assert {f.level.value for f in report.findings} <= {"note"}
    assert report.closest is not None
    assert report.closest.distance_m >= hop.scenario.judge.separation_min_m
    verified = json.loads((tmp_path / INDEX).read_text())["verified"]
    assert verified["separation_min_m"] == pytest.approx(report.closest.distance_m, abs=1e-5)
    assert verified["clearance_min_m"] == pytest.approx(report.clearance_min_m, abs=1e-5)
    # Proved values are rounded down: what the file says still holds.
    assert report.closest.proved_m - 1e-5 <= verified["separation_proved_m"] <= report.closest.proved_m
    assert report.clearance_proved_m is not None
    assert report.clearance_proved_m - 1e-5 <= verified["clearance_proved_m"] <= report.clearance_proved_m
    assert verified["clearance_proved_m"] >= limits_of(hop.scenario).clearance_m - 0.01


def test_a_flight_along_the_ground_is_not_the_planned_one(simulation1_plan: Plan, tmp_path: Path) -> None:
    """Between waypoints a vehicle that keeps its height above ground rises and falls with every ripple."""
    with pytest.raises(VerificationError, match="vertically"):
        export(simulation1_plan, tmp_path, formats=["plan"], altitude=Altitude.TERRAIN)


def test_waypoints_outside_the_box(hop: Plan) -> None:
    missions = build_missions(hop)
    verify_box(hop, missions, Altitude.RELATIVE)
    limits = hop.scenario.limits.model_copy(update={"north_m": (-20.0, 30.0)})
    narrow = replace(hop, scenario=hop.scenario.model_copy(update={"limits": limits}))
    with pytest.raises(VerificationError, match=r"waypoint \d+ of vehicle 1 is .* m outside the north limits"):
        verify_box(narrow, missions, Altitude.RELATIVE)


def test_streams_alone_need_no_mission(hop: Plan, tmp_path: Path) -> None:
    index = export(hop, tmp_path, formats=["setpoints"], setpoint_rate_hz=2)
    assert index.report is None
    assert json.loads((tmp_path / INDEX).read_text())["verified"] is None
