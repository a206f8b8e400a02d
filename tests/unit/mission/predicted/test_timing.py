"""The timing of missions against flights worked by hand: straight on to the north, later or earlier by so much."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.frames import ned_to_geodetic, to_degE7
from gcs.mission.model import Altitude, Command, Home, MissionItem, VehicleMission
from gcs.mission.predicted import timing as module
from gcs.mission.predicted.arrival_spread import ArrivalSpread
from gcs.mission.predicted.planned_flight import PredictedFlight
from gcs.mission.predicted.timing import Timing, predicted
from gcs.mission.waypoints.placement import Deviation
from gcs.mission.waypoints.timed_legs import Gate, TimedLegs
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.values.si import local_origin
from tests.bridge.flying import hop_scenario
from tests.unit.plan.verification.constraints.even_flights import even

SPEED_MPS = 2.0
DUE_S = (5.0, 15.0, 30.0)  # at the waypoints; the last is where the plan arrives
LEAVES_S = -1.0
HOVER_S = 7.5  # time of the flight at which a vehicle leaves its hover
SWITCH_S = 0.5  # before it passes a waypoint, an autopilot turns to the next one
NEAR_M = 2.0  # of a stop: the vehicle has arrived
NEAR_S = 0.11  # the plan is near its end at a multiple of 0.1 s
Delays = tuple[float, float, float]


@pytest.fixture(scope="module")
def straight(repo_root: Path) -> Plan:
    """Vehicle 1 leads; 2 and 3 are 4.33 m behind it and 2.5 m to either side."""
    plan = make_plan(hop_scenario(load_scenario(repo_root / "missions" / "field")))
    return even(plan, (0.0, 0.0, -8.0), (SPEED_MPS, 0.0, 0.0))


def flown(
    plan: Plan, row: int, delays_s: Delays, altitude: Altitude = Altitude.RELATIVE, gate_s: float | None = None
) -> tuple[VehicleMission, PredictedFlight]:
    """A mission of three waypoints, and a flight that passes each so much later than the plan."""
    origin = local_origin(plan.scenario)
    start = plan.motion(np.array([0.0]), slice(row, row + 1))[0][0, 0]
    start_ned_m, velocity_mps = start[POSITION], start[VELOCITY]
    home = Home(0.0, 0.0, origin.alt_amsl_m - 3.0)  # its height counts only
    items = [MissionItem(Command.NAV_TAKEOFF, Altitude.RELATIVE.frame, (0.0,) * 4, 0, 0, 8.0)]
    for due_s in DUE_S:
        lat_deg, lon_deg, alt_m = ned_to_geodetic(start_ned_m + due_s * velocity_mps, origin)
        above_m = float(alt_m) - (home.alt_amsl_m if altitude is Altitude.RELATIVE else 0.0)
        place = to_degE7(float(lat_deg)), to_degE7(float(lon_deg)), above_m
        items.append(MissionItem(Command.NAV_WAYPOINT, altitude.frame, (0.0,) * 4, *place))
    arrival_s: list[float | None] = [None, *DUE_S, None]
    if gate_s is not None:
        items.insert(3, MissionItem(Command.NAV_DELAY, 2, (-1.0, 10.0, 30.0, 0.0), 0, 0, 0.0))
        arrival_s.insert(3, None)
    items.append(MissionItem(Command.NAV_LAND, 3, (0.0,) * 4, 0, 0, 0.0))
    index = [n for n, item in enumerate(items) if item.command == Command.NAV_WAYPOINT]
    corners = [(LEAVES_S, 0.0, 1), (max(delays_s[0], LEAVES_S), 0.0, 1)]
    for n, (due_s, delay_s) in enumerate(zip(DUE_S, delays_s, strict=True)):
        corners.append((due_s + delay_s, due_s, index[n]))
        if gate_s is not None and n == 1:
            corners.append((gate_s, due_s, index[n] + 1))
    corners.append((40.0 + delays_s[2], 40.0, len(items) - 1))
    begins_s, along_s, item = (np.array(column) for column in zip(*corners, strict=True))
    t_s = np.union1d(begins_s, np.arange(LEAVES_S, 40.0, 0.1))  # as dense as a model's
    ned_m = start_ned_m + np.outer(np.interp(t_s, begins_s, along_s), velocity_mps)
    brought = item[np.minimum(np.searchsorted(begins_s - SWITCH_S, t_s), len(item) - 1)]
    climb = start_ned_m + np.array([[0.0, 0.0, 8.0], [0.0, 0.0, 0.0]])
    flight = PredictedFlight(
        np.concatenate([[0.0, HOVER_S - 1.5], t_s - LEAVES_S + HOVER_S]),
        np.concatenate([climb, ned_m]),
        np.concatenate([[0, 0], brought]),
        *(HOVER_S - 1.5, 70.0, 80.0),
    )
    gates = () if gate_s is None else ((3, gate_s),)
    return VehicleMission(row + 1, home, tuple(items), tuple(arrival_s), LEAVES_S, gates), flight


def timing_of(
    plan: Plan,
    delays_s: Sequence[Delays],
    known: Sequence[Autopilot] = (Autopilot.ARDUPILOT,) * 3,
    gate_s: float | None = None,
    open_s: tuple[float, float] | None = None,
) -> Timing:
    frames = (Altitude.RELATIVE, Altitude.RELATIVE, Altitude.AMSL)
    made = [flown(plan, row, one, frames[row], gate_s) for row, one in enumerate(delays_s)]
    gates = () if gate_s is None else (Gate(1, gate_s, 5.0),)
    legs = TimedLegs(np.array([0.0, *DUE_S]), Deviation(0.0, 0.0), None, LEAVES_S, gates)
    spreads = []
    if open_s is not None:  # the first vehicle may be so early and so late, everywhere
        ends_s = np.array([1e3])
        spreads = [ArrivalSpread(ends_s, *np.zeros((2, 1))) for _ in made]
        spreads[0] = ArrivalSpread(ends_s, *np.array(open_s)[:, None])
    missions, flights = [one for one, _ in made], [one for _, one in made]
    return predicted(plan, known, dict.fromkeys(known, legs), missions, flights, spreads)


@pytest.mark.parametrize(("open_s", "nearer_m"), [((0.0, 1.0), 2.0), ((-1.0, 0.0), 0.0), ((-0.2, 0.6), 1.2)])
def test_who_may_be_late_is_near_who_follows(straight: Plan, open_s: tuple[float, float], nearer_m: float) -> None:
    """The leader is 4.33 m ahead of both others: late it is nearer to them, early it is farther."""
    timing = timing_of(straight, [(0.0,) * 3] * 3, open_s=open_s)
    assert timing.nearest is not None
    expected_m = np.hypot(4.33 - nearer_m - SPEED_MPS * 0.02, 2.5)
    assert timing.nearest.distance_m == pytest.approx(expected_m, abs=1e-3)
    assert timing.may_differ_s == max(map(abs, open_s))


def test_who_may_be_late_may_miss_a_gate(straight: Plan) -> None:
    sure, late = (timing_of(straight, [(0.0,) * 3] * 3, gate_s=20.0, open_s=open_s) for open_s in (None, (-0.5, 1.5)))
    assert late.gates_early_s[0] == pytest.approx(sure.gates_early_s[0] - 1.5)


def test_every_vehicle_is_as_late_as_it_was_flown(straight: Plan) -> None:
    timing = timing_of(straight, [(0.2, 0.9, 0.4), (1.2, 0.3, 0.3), (-0.7, -0.2, 0.1)])
    assert [one.sysid for one in timing.vehicles] == [1, 2, 3]
    assert [one.late_s for one in timing.vehicles] == pytest.approx([0.9, 1.2, -0.7], abs=0.02)
    assert [one.late_at_s for one in timing.vehicles] == [15.0, 5.0, 5.0]
    assert timing.late_s == pytest.approx(1.2, abs=0.02)
    assert timing.spread_s == pytest.approx(1.9, abs=0.02)
    assert timing.arrival_late_s == pytest.approx(0.4, abs=NEAR_S)
    assert timing.gates_early_s == ()


def test_the_worst_may_be_early(straight: Plan) -> None:
    timing = timing_of(straight, [(0.1, 0.2, 0.3), (0.1, 0.2, -0.8), (-0.9, 0.1, 0.1)])
    assert timing.late_s == pytest.approx(-0.9, abs=0.02)
    assert timing.arrival_late_s == pytest.approx(-0.8, abs=NEAR_S)


def test_a_constant_delay_is_so_many_metres(straight: Plan) -> None:
    """A vehicle that is d late is behind by speed times d. Before, it waits in its hover while the plan moves on."""
    timing = timing_of(straight, [(1.5,) * 3, (1.5,) * 3, (0.3,) * 3])
    first, _, third = timing.vehicles
    assert (first.error_max_m, first.error_at_s) == pytest.approx((SPEED_MPS * 1.5, 1.6), abs=1e-6)
    assert (third.error_max_m, third.error_at_s) == pytest.approx((SPEED_MPS * 1.0, LEAVES_S), abs=1e-6)
    t_s = LEAVES_S + 0.2 * np.arange(175)  # until the landing begins, 34 s
    assert t_s[-1] < 34.0 <= t_s[-1] + 0.2 + 1e-9
    for one, delay_s in ((first, 1.5), (third, 0.3)):
        behind_s = t_s - np.maximum(t_s - delay_s, 0.0)
        assert one.error_rms_m == pytest.approx(SPEED_MPS * np.sqrt(np.mean(behind_s**2)), abs=1e-6)


def test_a_flight_without_error(straight: Plan) -> None:
    timing = timing_of(straight, [(0.0,) * 3] * 3)
    assert timing.late_s == pytest.approx(0.0, abs=NEAR_S)
    assert timing.spread_s == pytest.approx(0.0, abs=0.02)
    data = timing.data()
    assert json.loads(json.dumps(data))["late_s"] == timing.late_s
    assert json.loads(json.dumps(data))["spread_s"] == timing.spread_s
    assert timing.data() | {"spread_s": None} == replace(timing, spread_s=float("nan")).data()


def test_a_gate_opens_so_long_after_the_last_arrival(straight: Plan) -> None:
    """Vehicles stop at 15 s and go on at 20 s. They have arrived 2 m before: 1 s, at the plan's speed."""
    delays_s: list[Delays] = [(0.4,) * 3, (0.7,) * 3, (-0.2,) * 3]
    timing = timing_of(straight, delays_s, gate_s=20.0)
    assert timing.gates_early_s == pytest.approx((20.0 - (15.0 + 0.7 - NEAR_M / SPEED_MPS),), abs=0.02)
    # The last 30 m take 10 s and the delay, so the last 2 m take less than the plan's 1 s.
    late_s = [0.4 + 1.0 - 10.4 / 15.0, 0.7 + 1.0 - 10.7 / 15.0, -0.2]
    assert [one.late_s for one in timing.vehicles] == pytest.approx(late_s, abs=NEAR_S)
    assert [one.late_at_s for one in timing.vehicles] == [30.0, 30.0, 5.0]  # a stop is due at no time of its own
    assert timing.spread_s == pytest.approx(0.9, abs=NEAR_S)


@pytest.mark.parametrize("north_mps", [SPEED_MPS, -SPEED_MPS], ids=["leader in front", "leader behind"])
@pytest.mark.parametrize("all_pairs", [20, 2])
@pytest.mark.parametrize(
    ("known", "apart_s", "pair"),
    [
        ((Autopilot.ARDUPILOT,) * 3, 0.02, (1, 2)),
        ((Autopilot.PX4,) * 3, 2.2, (1, 2)),
        ((Autopilot.ARDUPILOT, Autopilot.ARDUPILOT, Autopilot.PX4), 2.2, (1, 3)),
    ],
)
def test_the_nearest_two_are_those_of_which_one_is_behind(
    straight: Plan,
    known: Sequence[Autopilot],
    apart_s: float,
    pair: tuple[int, int],
    all_pairs: int,
    north_mps: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Who is 4.33 m behind and `apart_s` early is 2 m/s times that nearer. Two abreast stay 5 m apart."""
    monkeypatch.setattr(module, "_ALL_PAIRS", all_pairs)
    plan = even(straight, (0.0, 0.0, -8.0), (north_mps, 0.0, 0.0))
    nearest = timing_of(plan, [(0.0,) * 3] * 3, known).nearest
    assert nearest is not None
    assert nearest.distance_m == pytest.approx(np.hypot(4.33 - SPEED_MPS * apart_s, 2.5), abs=1e-3)
    assert (nearest.sysids, nearest.apart_s) == (pair, apart_s)


def test_vehicles_of_two_autopilots_have_waypoints_of_their_own(straight: Plan) -> None:
    """The spread is taken among vehicles of one autopilot."""
    known = (Autopilot.ARDUPILOT, Autopilot.PX4, Autopilot.PX4)
    timing = timing_of(straight, [(1.5,) * 3, (0.2,) * 3, (0.6,) * 3], known)
    assert timing.spread_s == pytest.approx(0.4, abs=0.02)
