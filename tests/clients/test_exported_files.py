"""Independent readers load every exported file: MAVSDK's importers and pymavlink's, item by item."""

from __future__ import annotations

import math
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mavsdk
import numpy as np
import pytest
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw

from gcs.autopilots.parameter_names import with_new_names
from gcs.autopilots.traits import Autopilot
from gcs.link.protocols.mission.item_messages import home_item
from gcs.mission.export.export import export
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.qgc_plan import read_mission, write_mission
from gcs.mission.geofence import FenceCircle, FencePolygon, Geofence, GeoPoint, fence_items, rally_items
from gcs.mission.model import Altitude, Home, MissionItem, VehicleMission
from gcs.mission.returns.fence_rally import Safety
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.sources.load import load_scenario
from tests.bridge.flying import hop_scenario

FORMATS = ["plan", "waypoints", "fence", "rally", "param"]
MISSION, FENCE, RALLY = 0, 1, 2  # MAV_MISSION_TYPE


@contextmanager
def importer(firmware: Autopilot) -> Iterator[MissionRaw]:
    """MAVSDK's plug-in, which wants to know an autopilot before it reads files for it: heartbeats suffice."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    enough = threading.Event()

    def beat() -> None:
        link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            while not enough.wait(0.05):
                vehicle.sendto(link.heartbeat_encode(2, int(firmware), 81, 0, 3).pack(link), ("127.0.0.1", port))

    heart = threading.Thread(target=beat)
    try:
        assert sdk.add_any_connection(f"udpin://127.0.0.1:{port}") == mavsdk.ConnectionResult.SUCCESS
        heart.start()
        for _ in range(400):
            systems = [s for s in sdk.get_systems() if s.is_connected() and s.has_autopilot()]
            if systems:
                break
            enough.wait(0.05)
        assert systems, "MAVSDK found no vehicle"
        yield MissionRaw(systems[0])
    finally:
        enough.set()
        heart.join()
        sdk.destroy()


def single(value: float) -> float:
    return float(np.float32(value))


def assert_raw(raw: RawItem, item: MissionItem, seq: int, kind: int) -> None:
    """One item as MAVSDK would send it."""
    assert (raw.seq, raw.command, raw.mission_type) == (seq, item.command, kind)
    assert raw.frame == item.frame
    assert (raw.x, raw.y) == (item.lat_degE7, item.lon_degE7)
    assert raw.z == single(item.alt_m)
    for ours, theirs in zip(item.params, (raw.param1, raw.param2, raw.param3, raw.param4), strict=True):
        assert theirs == single(ours) or (math.isnan(ours) and math.isnan(theirs))
    if kind == MISSION:
        assert bool(raw.autocontinue) == item.autocontinue


@pytest.fixture(scope="module")
def hop(repo_root: Path) -> Plan:
    """Three vehicles, half a minute."""
    return make_plan(hop_scenario(load_scenario(repo_root / "missions" / "field")))


@pytest.fixture(scope="module", params=[(f, a) for f in Autopilot for a in (Altitude.RELATIVE, Altitude.AMSL)], ids=str)
def exported(
    request: pytest.FixtureRequest, hop: Plan, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Autopilot, tuple[VehicleMission, ...], Safety]:
    firmware, altitude = request.param
    folder = tmp_path_factory.mktemp("exported") / "out"
    timed = firmware is Autopilot.ARDUPILOT and altitude is Altitude.RELATIVE
    index = export(hop, folder, formats=FORMATS, firmware=firmware, altitude=altitude, timed=timed)
    return folder, firmware, index.missions, index.safety


Exported = tuple[Path, Autopilot, tuple[VehicleMission, ...], Safety]


def test_mavsdk_reads_the_plans(exported: Exported) -> None:
    folder, firmware, missions, safety = exported
    with importer(firmware) as reader:
        for row, mission in enumerate(missions):
            data = reader.import_qgroundcontrol_mission(str(folder / f"uav{mission.sysid}.plan"))
            items = data.mission_items
            if firmware.home_is_item_0:
                home = home_item(mission.home)
                assert (items[0].x, items[0].y, items[0].z) == (home.lat_degE7, home.lon_degE7, single(home.alt_m))
                items = items[1:]
            assert len(items) == len(mission.items)
            for raw, item in zip(items, mission.items, strict=True):
                assert_raw(raw, item, raw.seq, MISSION)
            assert [raw.seq for raw in data.mission_items] == list(range(len(data.mission_items)))
            assert [raw.current for raw in data.mission_items].count(1) == 1
            fence, rally = fence_items(safety.fence.geofence), rally_items(safety.rally[row])
            for found, wanted, kind in ((data.geofence_items, fence, FENCE), (data.rally_items, rally, RALLY)):
                assert len(found) == len(wanted)
                for seq, (raw, item) in enumerate(zip(found, wanted, strict=True)):
                    assert_raw(raw, item, seq, kind)


def test_mavsdk_reads_circles_and_exclusions() -> None:
    corners = (GeoPoint(473970000, 85450000), GeoPoint(473980000, 85450000), GeoPoint(473980000, 85460000))
    fence = Geofence(
        (FencePolygon(corners, True), FencePolygon(corners[::-1], False)),
        (FenceCircle(corners[0], 138.25, False), FenceCircle(corners[1], 1e3, True)),
    )
    up = MissionItem(22, 3, (0.0, 0.0, 0.0, math.nan), 473970000, 85450000, 10.0)
    text = write_mission(MissionFile("x", Autopilot.PX4, Home(47.4, 8.5, 500.0), (up,), fence, speed_mps=5.0))
    with importer(Autopilot.PX4) as reader:
        data = reader.import_qgroundcontrol_mission_from_string(text)
    assert_raw(data.mission_items[0], up, 0, MISSION)
    wanted = fence_items(fence)
    assert len(data.geofence_items) == len(wanted)
    for seq, (raw, item) in enumerate(zip(data.geofence_items, wanted, strict=True)):
        assert_raw(raw, item, seq, FENCE)


def test_mavsdk_reads_the_tables(exported: Exported) -> None:
    """For ArduPilot MAVSDK puts a home of its own before the one in the table."""
    folder, firmware, missions, _ = exported
    with importer(firmware) as reader:
        for mission in missions:
            items = reader.import_mission_planner_mission(str(folder / f"uav{mission.sysid}.waypoints")).mission_items
            wanted = mission.items
            if firmware.home_is_item_0:
                home = home_item(mission.home)
                assert all((i.x, i.y, i.z) == (home.lat_degE7, home.lon_degE7, single(home.alt_m)) for i in items[:2])
                items = items[2:]
            assert len(items) == len(wanted)
            for raw, item in zip(items, wanted, strict=True):
                assert_raw(raw, item, raw.seq, MISSION)


def test_pymavlink_reads_the_tables(exported: Exported, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAVLINK20", "1")
    from pymavlink import mavutil, mavwp

    mavutil.set_dialect("ardupilotmega")
    folder, firmware, missions, safety = exported
    for row, mission in enumerate(missions):
        wanted = mission.items
        if firmware.home_is_item_0:
            wanted = (home_item(mission.home), *wanted)
        for suffix, loader, items in (
            ("waypoints", mavwp.MAVWPLoader(), wanted),
            ("fence", mavwp.MissionItemProtocol_Fence(), fence_items(safety.fence.geofence)),
            ("rally", mavwp.MissionItemProtocol_Rally(), rally_items(safety.rally[row])),
        ):
            assert loader.load(str(folder / f"uav{mission.sysid}.{suffix}")) == len(items)
            for seq, item in enumerate(items):
                read = loader.item(seq)
                assert (read.seq, read.command, read.frame) == (seq, item.command, item.frame)
                assert (read.param1, read.param2, read.param3, read.param4) == item.params
                scale = 1 if item.frame == 2 else 1e7
                assert (round(read.x * scale), round(read.y * scale)) == (item.lat_degE7, item.lon_degE7)
                assert read.z == item.alt_m
                assert bool(read.autocontinue) == item.autocontinue


def test_pymavlink_reads_the_parameters(exported: Exported) -> None:
    from pymavlink import mavparm

    folder, firmware, missions, safety = exported
    for row, mission in enumerate(missions):
        if firmware is Autopilot.ARDUPILOT:
            loaded = mavparm.MAVParmDict()
            assert loaded.load(str(folder / f"uav{mission.sysid}.param"))
            assert dict(loaded) == dict(with_new_names(firmware, safety.parameters[row]))
        else:
            rows = (folder / f"uav{mission.sysid}.params").read_text().splitlines()
            table = [line.split("\t") for line in rows if not line.startswith("#")]
            assert {name: float(value) for _, _, name, value, _ in table} == dict(safety.parameters[row])
            assert {kind for *_, kind in table} == {"6", "9"}


def test_the_plan_says_everything_again(exported: Exported) -> None:
    folder, firmware, missions, safety = exported
    for row, mission in enumerate(missions):
        file = read_mission((folder / f"uav{mission.sysid}.plan").read_bytes(), "x")
        wanted = (firmware, mission.home, mission.items, safety.fence.geofence, safety.rally[row])
        assert (file.firmware, file.home, file.items, file.geofence, file.rally) == wanted
