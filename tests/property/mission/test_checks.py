"""Whatever a file holds, it is refused in words or checked to the end: no traceback, no hang, no half-read mission."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.frames import Origin
from gcs.mission.check.findings import Rule
from gcs.mission.check.fleet_check import check_fleet
from gcs.mission.flight_limits import FlightLimits, Surroundings
from gcs.mission.formats.any_mission import read_mission
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.geofence import FenceCircle, FencePolygon, Geofence, GeoPoint, RallyPoint
from gcs.mission.model import Home, MissionItem
from gcs.mission.predicted.autopilot_flight import AutopilotFlight
from gcs.mission.predicted.planned_flight import surroundings

FOREIGN = Path(__file__).resolve().parents[2] / "unit" / "mission" / "foreign"
WHOLE = {p.name: p.read_bytes() for p in sorted(FOREIGN.iterdir())}
COMMANDS = (16, 17, 18, 19, 20, 21, 22, 31, 82, 93, 115, 177, 178, 179, 9999)

shards = st.one_of(
    st.binary(max_size=4),
    st.sampled_from(
        [b"nan", b"inf", b"-", b"1e999", b"9" * 400, b"\t", b",", b"\n", b"\r", b"\0", b"[", b"null", b'"']
    ),
)
slow = settings(deadline=None, max_examples=20, suppress_health_check=[HealthCheck.too_slow])


@pytest.mark.parametrize("name", [n for n in WHOLE if not n.startswith(("cut", "older", "with_remarks"))])
@slow
@given(data=st.data())
def test_damaged_files(name: str, data: st.DataObject) -> None:
    damaged = WHOLE[name]
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(damaged)))
        end = data.draw(st.integers(start, min(start + 12, len(damaged))))
        damaged = damaged[:start] + data.draw(shards) + damaged[end:]
    try:
        mission = read_mission(damaged, name)
    except FileFormatError as error:
        assert error.message.startswith(f"{name}")
        return
    if name.endswith(".waypoints"):
        lines = damaged.decode("utf-8-sig").splitlines()
        _, *rows = (line for line in lines if re.split("#|//", line, maxsplit=1)[0].strip())
        assert len(mission.items) + (mission.home is not None) == len(rows)
    else:
        document = json.loads(damaged)
        assert len(mission.items) == len(document.get("mission", document)["items"])
    report = check_fleet([mission, mission], surroundings([mission]), FlightLimits())
    assert all(str(f) and f.data() for f in report.findings)


wild = st.one_of(st.floats(width=32), st.sampled_from([0.0, 1.0, -1.0, 2.0, 5.0, math.nan, math.inf]))
near = st.integers(-20_000, 20_000)
items = st.builds(
    MissionItem,
    command=st.sampled_from(COMMANDS),
    frame=st.sampled_from([0, 2, 3, 5, 6, 10, 11, 77]),
    params=st.tuples(wild, wild, wild, wild),
    lat_degE7=st.one_of(near.map(lambda d: 474_000_000 + d), st.integers(-(2**31), 2**31 - 1), st.just(0)),
    lon_degE7=st.one_of(near.map(lambda d: 85_000_000 + d), st.integers(-(2**31), 2**31 - 1), st.just(0)),
    alt_m=wild,
    autocontinue=st.booleans(),
)
spots = st.builds(GeoPoint, near.map(lambda d: 474_000_000 + d), near.map(lambda d: 85_000_000 + d))
fences = st.builds(
    Geofence,
    st.lists(
        st.builds(FencePolygon, st.lists(spots, min_size=3, max_size=5).map(tuple), st.booleans()), max_size=2
    ).map(tuple),
    st.lists(st.builds(FenceCircle, spots, st.floats(0.1, 1e6), st.booleans()), max_size=2).map(tuple),
)
rallies = st.lists(st.builds(RallyPoint, spots, st.floats(-1e6, 1e6)), max_size=2).map(tuple)
missions = st.builds(
    MissionFile,
    st.sampled_from(["a.plan", "b.plan"]),
    st.sampled_from(Autopilot),
    st.sampled_from([None, Home(47.4, 8.5, 500.0), Home(-90.0, 180.0, -1e6)]),
    st.lists(items, max_size=6).map(tuple),
    fences,
    rallies,
)


@slow
@given(st.lists(missions, min_size=1, max_size=3), st.booleans())
def test_any_items_are_checked_to_the_end(fleet: list[MissionFile], with_map: bool) -> None:
    around = (
        Surroundings(Origin(47.4, 8.5, 500.0), lambda north, east: 0.0 * north) if with_map else surroundings(fleet)
    )
    limits = FlightLimits(clearance_m=1.0, height_max_m=50.0, speed_ned_mps=(5.0, 5.0, 2.0))
    report = check_fleet(fleet, around, limits)
    assert math.isfinite(report.duration_s)
    for mission in fleet:
        if any(i.command == 9999 for i in mission.items):
            assert any(f.rule is Rule.COMMAND for f in report.findings)


nearby = st.builds(
    MissionItem,
    command=st.sampled_from(COMMANDS),
    frame=st.sampled_from([0, 3, 10]),
    params=st.tuples(
        st.sampled_from([0.0, 1.0, 2.0, 3.0, math.nan, math.inf]), st.sampled_from([-1.0, 0.5, 3.0, 20.0]), wild, wild
    ),
    lat_degE7=near.map(lambda d: 474_000_000 + d // 20),
    lon_degE7=near.map(lambda d: 85_000_000 + d // 20),
    alt_m=st.one_of(st.floats(-10, 60, width=32), wild),
)


def hop_m(alt_m: float) -> MissionItem:
    return MissionItem(16, 3, (0.0, -1.0, 0.0, 0.0), 474_000_000, 85_000_000, alt_m)


@settings(slow, max_examples=8)
@example(Autopilot.PX4, (hop_m(2.0), hop_m(1.0)))  # its last step is one of whole tenths of a second
@given(st.sampled_from(Autopilot), st.lists(nearby, min_size=1, max_size=6).map(tuple))
def test_any_items_are_flown_by_the_model_to_the_end(firmware: Autopilot, some: tuple[MissionItem, ...]) -> None:
    one = MissionFile("a.plan", firmware, Home(47.4, 8.5, 500.0), some)
    report = check_fleet([one], Surroundings(Origin(47.4, 8.5, 500.0)), FlightLimits(), AutopilotFlight())
    assert math.isfinite(report.duration_s)
