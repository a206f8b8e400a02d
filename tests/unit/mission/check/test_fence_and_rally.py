"""Fence, rally points, home and mission against each other."""

from __future__ import annotations

import math

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.mission.check.fence_and_rally import check_rally_apart, check_safety
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.flight_limits import Surroundings
from gcs.mission.geofence import NO_FENCE, FenceCircle, FencePolygon, Geofence, RallyPoint
from gcs.mission.predicted.planned_flight import fly
from tests.unit.mission.fleets import FLAT, ORIGIN, mission, out_and_land, place


def square(south: float, north: float, west: float, east: float, *, inclusion: bool = True) -> FencePolygon:
    corners = ((south, west), (south, east), (north, east), (north, west))
    return FencePolygon(tuple(place(n, e) for n, e in corners), inclusion)


FIELD = Geofence((square(-20, 120, -20, 20),))


def findings(
    fence: Geofence,
    rally: tuple[RallyPoint, ...] = (),
    firmware: Autopilot = Autopilot.ARDUPILOT,
    north_m: float = 100.0,
) -> list[Finding]:
    one = mission(out_and_land(north_m), firmware=firmware, geofence=fence, rally=rally)
    return list(check_safety(one, fly(one, FLAT), FLAT))


def test_everything_inside() -> None:
    assert findings(FIELD, (RallyPoint(place(100, 0), 20.0),)) == []
    assert findings(NO_FENCE) == []
    assert findings(Geofence((), (FenceCircle(place(50, 0), 60.0, True),))) == []


@pytest.mark.parametrize(
    ("fence", "rule", "level", "message"),
    [
        (
            Geofence((square(-20, 90, -20, 20),)),
            Rule.FENCE,
            Level.ERROR,
            "leaves the fence, here by 10.0 m, on 2 of 3 legs",
        ),
        (Geofence((), (FenceCircle(place(50, 0), 45.0, True),)), Rule.FENCE, Level.ERROR, "leaves the fence"),
        (
            Geofence((square(-20, 120, -20, 20), square(40, 60, -5, 5, inclusion=False))),
            Rule.FENCE,
            Level.ERROR,
            "leaves the fence",
        ),
        (
            Geofence(FIELD.polygons, (FenceCircle(place(50, 12), 10.0, False),)),
            None,
            None,
            "",
        ),
        (Geofence(FIELD.polygons, (FenceCircle(place(50, 9), 10.0, False),)), Rule.FENCE, Level.ERROR, "here by 1.0 m"),
        (Geofence((square(10, 120, -20, 20),)), Rule.FENCE, Level.ERROR, "home is 10.0 m outside the fence"),
        (
            Geofence((FencePolygon(tuple(place(n, e) for n, e in ((0, 0), (9, 9), (9, 0), (0, 9))), True),)),
            Rule.FENCE,
            Level.ERROR,
            "inclusion 1 of the fence crosses itself",
        ),
        (
            Geofence(tuple([square(-20, 120, -20, 20)] * 18)),
            Rule.FENCE,
            Level.ERROR,
            "fence of 72 points; ArduCopter stores at most 70",
        ),
    ],
)
def test_fence_and_mission(fence: Geofence, rule: Rule | None, level: Level | None, message: str) -> None:
    found = [f for f in findings(fence) if message in f.message and f.rule is not Rule.RETURN]
    assert [(f.rule, f.level) for f in found] == ([] if rule is None else [(rule, level)])


@pytest.mark.parametrize(("radius_m", "leaves"), [(1000.1, False), (999.95, True)])
def test_a_circle_to_stay_in_is_no_larger_than_it_is(radius_m: float, leaves: bool) -> None:
    """The way out ends 1000 m from its centre, where the polygon inside the circle has a corner."""
    fence = Geofence((), (FenceCircle(place(0, 0), radius_m, True),))
    assert any("leaves the fence" in f.message for f in findings(fence, north_m=1000.0)) is leaves


@pytest.mark.parametrize("bearing_deg", [0.0, 0.7, 1.4, 11.0, 45.0])
@pytest.mark.parametrize(("off_m", "leaves"), [(999.95, True), (1000.5, False)])
def test_a_circle_to_stay_out_of_is_no_smaller_than_it_is(bearing_deg: float, off_m: float, leaves: bool) -> None:
    """Its centre is so far from where the way out ends, straight on, in any direction."""
    north_m = 100.0 + off_m * math.cos(math.radians(bearing_deg))
    centre = place(north_m, off_m * math.sin(math.radians(bearing_deg)))
    fence = Geofence((square(-50, 3000, -1500, 2000),), (FenceCircle(centre, 1000.0, False),))
    assert any("leaves the fence" in f.message for f in findings(fence)) is leaves


def test_inside_all_inclusions_or_one_of_them() -> None:
    """Two fields side by side: PX4 may be in either, ArduPilot must be in both."""
    two = Geofence((square(-20, 60, -20, 20), square(40, 120, -20, 20)))
    assert findings(two, firmware=Autopilot.PX4) == []
    assert "leaves the fence" in " ".join(f.message for f in findings(two))


def test_a_fence_without_a_place_inside_is_told() -> None:
    closed = Geofence((square(-20, 20, -20, 20), square(40, 120, -20, 20)))
    assert [f.message for f in findings(closed)] == ["the fence leaves no place to fly in"]


def test_rally_points() -> None:
    out = RallyPoint(place(130, 0), 20.0)
    assert [(f.rule, f.message) for f in findings(FIELD, (out,))] == [
        (Rule.RALLY, "rally point 1 is 10.0 m outside the fence")
    ]
    many = tuple(RallyPoint(place(n, 0), 20.0) for n in range(11))
    assert [f.message for f in findings(FIELD, many)] == ["11 rally points; ArduCopter stores at most 10"]
    deep = RallyPoint(place(50, 0), -3.0)
    assert [f.message for f in findings(FIELD, (deep,))] == ["rally point 1 is 3.0 m below the ground"]


def test_the_way_back_past_a_closed_area() -> None:
    """The mission flies around a zone; the straight return track from behind it crosses the zone."""
    from tests.unit.mission.fleets import at, speed

    zone = Geofence(FIELD.polygons, (FenceCircle(place(50, 0), 8.0, False),))
    around = [at(22, 0, 0, 10), speed(5), at(16, 50, 12, 10), at(16, 100, 0, 10), at(21, 100, 0, 0)]
    one = mission(around, geofence=zone)
    found = list(check_safety(one, fly(one, FLAT), FLAT))
    assert [(f.rule, f.level, f.item) for f in found] == [(Rule.RETURN, Level.WARNING, 4)]
    assert "from 2 of 5 points" in found[0].message
    saved = mission(around, geofence=zone, rally=(RallyPoint(place(110, 0), 5.0),))
    assert list(check_safety(saved, fly(saved, FLAT), FLAT)) == []


def test_two_vehicles_must_not_return_to_one_place() -> None:
    fleet = [
        mission(out_and_land(100.0), name=name, rally=(RallyPoint(place(100, east), 20.0),))
        for name, east in (("a.plan", 0.0), ("b.plan", 3.0), ("c.plan", 20.0))
    ]
    found = list(check_rally_apart(fleet, FLAT, 5.0))
    assert [(f.rule, f.source) for f in found] == [(Rule.RALLY, "a.plan")]
    assert "3.00 m from one of b.plan" in found[0].message
    assert list(check_rally_apart(fleet, FLAT, 2.9)) == []
    assert list(check_rally_apart(fleet[:1], FLAT, 2.9)) == []
    own = mission(out_and_land(1.0), rally=(RallyPoint(place(1, 0), 1.0), RallyPoint(place(2, 0), 1.0)))
    assert list(check_rally_apart([own], FLAT, 5.0)) == []


def test_a_rally_point_counts_from_its_own_home() -> None:
    hill = Surroundings(ORIGIN, lambda north, east: 10.0 + 0.0 * north)
    one = mission(out_and_land(10.0), home=(0, 0, 10), geofence=FIELD, rally=(RallyPoint(place(5, 0), 0.0),))
    assert list(check_safety(one, fly(one, hill), hill)) == []
    sunk = mission(out_and_land(10.0), home=(0, 0, 5), geofence=FIELD, rally=(RallyPoint(place(5, 0), 0.0),))
    assert [f.message for f in check_safety(sunk, fly(sunk, hill), hill)] == ["rally point 1 is 5.0 m below the ground"]
