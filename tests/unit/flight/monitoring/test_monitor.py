"""What the monitor says of the ground phases: separations from the take-off on, and the error in a landing.

The error in a landing counts beside the descent of the vehicle's own autopilot, to the ground.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from gcs.autopilots.columns import LandingProfile
from gcs.autopilots.local_frame import local_frame
from gcs.autopilots.traits import Autopilot
from gcs.flight.monitoring.completion import Completion
from gcs.flight.monitoring.monitor import Monitor, VehicleView
from gcs.flight.monitoring.progress import FlightPart
from gcs.link.protocols.clock import VehicleClock
from gcs.link.wire.message import Message
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin
from gcs.types import Array

T0_UNIX_S = 1.7e9
SLOW = LandingProfile((0.0,), (0.1,), 1.0)  # the landing lasts far longer than that of the plan
EARLY_S = 20.0


class Heard:
    """A monitor that hears where vehicles are."""

    def __init__(self, plan: Plan, landings: dict[int, LandingProfile]) -> None:
        self.plan = plan
        self.monitor = Monitor(plan, landings)
        self.monitor.set_t0(T0_UNIX_S)
        self.clock = VehicleClock()

    def at(self, t_s: float, off_ned_m: tuple[float, float, float]) -> None:
        """All vehicles report a place that is so far from the expected one."""
        boot_ms = round(1000.0 * t_s) + 1_000_000
        unix_usec = round(1e6 * (T0_UNIX_S + t_s))
        self.clock.receive(Message("SYSTEM_TIME", {"time_boot_ms": boot_ms, "time_unix_usec": unix_usec}), t_s)
        for row in range(len(self.plan.sysids)):
            place = self.expected(row, t_s) + np.array(off_ned_m) - self.plan.pads_ned_m[row]
            fields = dict(zip("xyz", place.tolist(), strict=True)) | dict.fromkeys(("vx", "vy", "vz"), 0.0)
            self.monitor.receive(row, Message("LOCAL_POSITION_NED", {"time_boot_ms": boot_ms, **fields}), self.clock)

    def from_pad(self, t_s: float, moved_ned_m: Mapping[int, tuple[float, float, float]]) -> None:
        """Each vehicle named reports that it is so far from its pad."""
        boot_ms = round(1000.0 * t_s) + 1_000_000
        unix_usec = round(1e6 * (T0_UNIX_S + t_s))
        self.clock.receive(Message("SYSTEM_TIME", {"time_boot_ms": boot_ms, "time_unix_usec": unix_usec}), t_s)
        for sysid, place in moved_ned_m.items():
            fields = dict(zip("xyz", place, strict=True)) | dict.fromkeys(("vx", "vy", "vz"), 0.0)
            row = self.plan.sysids.index(sysid)
            self.monitor.receive(row, Message("LOCAL_POSITION_NED", {"time_boot_ms": boot_ms, **fields}), self.clock)

    def expected(self, row: int, t_s: float) -> Array:
        """In closed form: above the landing point, 0.1 m/s down from 1 s after the order on."""
        landing_s = self.plan.phase("landing").start_s
        if t_s <= landing_s or self.plan.sysids[row] not in self.monitor.expected.profiles:
            return np.array(self.plan.states(np.array([min(t_s, self.plan.t_end_s - 1e-6)]))[row, 0, :3])
        place = np.array(self.plan.states(np.array([landing_s]))[row, 0, :3])
        sunk_m = 0.1 * max(t_s - landing_s - 1.0, 0.0)
        place[2] = min(place[2] + sunk_m, self.plan.landing_points_ned_m[row, 2])
        return place


def test_a_landing_is_compared_with_the_descent_of_the_autopilot_to_its_end(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    heard = Heard(plan, dict.fromkeys(plan.sysids, SLOW))
    for t_s in (plan.flight_s, plan.phase("landing").start_s + 5.0, plan.t_end_s + 3.0, plan.t_end_s + 100.0):
        heard.at(t_s, (0.3, 0.0, 0.4))
        assert heard.monitor.plan_time_s == pytest.approx(t_s, abs=0.01)
        assert list(heard.monitor.errors_m.values()) == pytest.approx([0.5] * len(plan.sysids), abs=0.01)


def test_a_report_counts_metres_as_its_autopilot_does(simulation1_plan: Plan) -> None:
    plan, sysid = simulation1_plan, simulation1_plan.sysids[1]
    autopilots = dict.fromkeys(plan.sysids, int(Autopilot.ARDUPILOT))
    heard = Heard(plan, {})
    heard.monitor = Monitor(plan, autopilots=autopilots)
    heard.from_pad(1.0, {sysid: (1000.0, 0.0, -20.0)})
    frame = local_frame(Autopilot.ARDUPILOT, local_origin(plan.scenario), plan.pads_ned_m[1])
    view = heard.monitor.views[sysid]
    assert view.position_ned_m.tolist() == frame.common_ned_m(np.array([1000.0, 0.0, -20.0])).tolist()
    assert abs(view.position_ned_m[0] - plan.pads_ned_m[1, 0] - 1000.0) > 0.5


@pytest.mark.parametrize("name", ["x", "z", "vy"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -3e38])
def test_a_report_that_is_no_number_changes_nothing(simulation1_plan: Plan, name: str, value: float) -> None:
    heard = Heard(simulation1_plan, {})
    heard.at(1.0, (0.0, 0.0, 0.0))
    heard.monitor.watch_separation(simulation1_plan.sysids)
    before = heard.monitor.nearest_now()
    fields = {"time_boot_ms": 1_001_100, **dict.fromkeys(("x", "y", "z", "vx", "vy", "vz"), 0.0), name: value}
    heard.monitor.receive(2, Message("LOCAL_POSITION_NED", fields), heard.clock)
    assert before is not None
    assert heard.monitor.nearest_now() == before


def test_without_a_profile_nothing_is_expected_after_the_plan(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    heard = Heard(plan, {plan.sysids[0]: SLOW})
    heard.at(plan.t_end_s - 0.1, (0.0, 0.5, 0.0))
    assert list(heard.monitor.errors_m.values()) == pytest.approx([0.5] * len(plan.sysids), abs=0.01)
    heard.at(plan.t_end_s + 3.0, (0.0, 0.5, 0.0))
    first, *others = heard.monitor.errors_m.values()
    assert first == pytest.approx(0.5, abs=0.01)
    assert all(map(math.isnan, others))


def test_a_vehicle_that_left_the_plan_has_no_error_beside_it(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    heard = Heard(plan, dict.fromkeys(plan.sysids, SLOW))
    heard.at(10.0, (0.0, 0.0, 20.0))
    heard.monitor.watch_formation(plan.sysids[1:])
    errors_m = heard.monitor.errors_m
    assert math.isnan(errors_m[plan.sysids[0]])
    assert errors_m[plan.sysids[1]] == pytest.approx(20.0, abs=0.01)
    assert heard.monitor.views[plan.sysids[0]].error_m == pytest.approx(20.0, abs=0.01)


def test_the_formation_error_ends_with_the_formation(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    heard = Heard(plan, dict.fromkeys(plan.sysids, SLOW))
    heard.at(plan.phase("landing").start_s - 0.5, (0.0, 0.0, 0.0))
    assert heard.monitor.formation_error_m() == pytest.approx(0.0, abs=0.02)
    heard.at(plan.phase("landing").start_s + 10.0, (0.0, 0.0, 0.0))
    assert math.isnan(heard.monitor.formation_error_m())
    heard.monitor.watch_separation(plan.sysids)
    assert (nearest := heard.monitor.nearest_now()) is not None
    assert nearest.distance_m > 0.3


def starting(plan: Plan, errors_ned_m: dict[int, tuple[float, float, float]]) -> Heard:
    """A monitor of vehicles that stand on their pads, armed, and report them with these errors."""
    heard = Heard(plan, {})
    heard.monitor.t0_unix_s = None
    heard.from_pad(-30.0, errors_ned_m)
    for row, sysid in enumerate(plan.sysids):
        heard.monitor.views[sysid].stands_on(plan.pads_ned_m[row])
    return heard


def test_before_the_take_off_there_is_no_separation(simulation1_plan: Plan) -> None:
    heard = starting(simulation1_plan, dict.fromkeys(simulation1_plan.sysids, (0.0, 0.0, 0.0)))
    assert heard.monitor.nearest_now() is None
    assert heard.monitor.nearest == {}


def test_at_the_take_off_separation_counts_from_the_pads_whatever_receivers_report(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    errors = {sysid: (1.5 * (-1) ** sysid, -0.9 * sysid, 2.0) for sysid in plan.sysids}
    heard = starting(plan, errors)
    heard.monitor.watch_separation(plan.sysids)
    assert (nearest := heard.monitor.nearest_now()) is not None
    assert nearest.distance_m == pytest.approx(pdist(plan.pads_ned_m).min(), abs=1e-9)
    second = plan.pads_ned_m[1] - plan.pads_ned_m[4]  # vehicle 5 moves half of the way to vehicle 2
    half = tuple((np.array(errors[5]) + second / 2).tolist())
    heard.from_pad(-25.0, {**errors, 5: half})
    heard.monitor.watch_separation(plan.sysids)
    (nearest,) = heard.monitor.nearest.values()
    assert nearest.part is FlightPart.TAKEOFF
    assert nearest.pair == (2, 5)
    assert nearest.distance_m == pytest.approx(np.linalg.norm(second) / 2, abs=1e-9)
    assert nearest.unix_s == pytest.approx(T0_UNIX_S - 25.0)


def test_each_part_of_a_flight_has_its_least_separation(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    heard = Heard(plan, {})
    for t_s in (-3.0, 50.0, plan.phase("landing").start_s + 2.0):
        heard.at(t_s, (0.0, 0.0, 0.0))
        heard.monitor.watch_separation(plan.sysids)
    assert list(heard.monitor.nearest) == list(FlightPart)
    for one, t_s in zip(heard.monitor.nearest.values(), (-3.0, 50.0, plan.phase("landing").start_s + 2.0), strict=True):
        assert one.distance_m == pytest.approx(pdist(plan.states(np.array([t_s]))[:, 0, :3]).min(), abs=0.02)


def test_a_vehicle_that_is_not_heard_has_no_separation(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    heard = starting(plan, dict.fromkeys(plan.sysids, (0.0, 0.0, 0.0)))
    others = {sysid: (0.0, 0.0, 0.0) for sysid in plan.sysids if sysid != 5}
    heard.from_pad(-20.0, others)
    heard.monitor.watch_separation(plan.sysids)
    (nearest,) = heard.monitor.nearest.values()
    assert 5 not in nearest.pair


def flown(plan: Plan, *, missing_s: float = 0.0, reboot: bool = False, disarmed_after_s: float = 1e9) -> Completion:
    """All vehicles report ten times a second from T0 to the landing; the last one as told."""
    found = Completion(plan)
    found.begins(0.0)
    landing_s = plan.phase("landing").start_s
    for sysid in plan.sysids:
        last = sysid == plan.sysids[-1]
        for tick in range(int(10.0 * (landing_s - (missing_s if last else 0.0)))):
            boot_s = 50.0 + tick / 10.0
            if reboot and last and boot_s > 60.0:
                boot_s -= 55.0
            found.receive(sysid, int(1e3 * boot_s), armed=not last or tick / 10.0 < disarmed_after_s)
    found.lands(plan.sysids)
    return found


def test_a_plan_that_was_flown_misses_nothing(simulation1_plan: Plan) -> None:
    assert flown(simulation1_plan).missing({}) == []


def test_a_reboot_is_no_flight_that_ended_early(simulation1_plan: Plan) -> None:
    assert flown(simulation1_plan, reboot=True).missing({}) == []


@pytest.mark.parametrize("how", [{"missing_s": EARLY_S}, {"disarmed_after_s": 16.0}])
def test_a_vehicle_that_flew_too_short_is_named(simulation1_plan: Plan, how: dict[str, float]) -> None:
    (words,) = flown(simulation1_plan, **how).missing({})  # type: ignore[arg-type]
    landing_s = simulation1_plan.phase("landing").start_s
    flown_s = how.get("disarmed_after_s", landing_s - EARLY_S)
    assert words.startswith(f"vehicle {simulation1_plan.sysids[-1]} flew {flown_s:.0f} s of {landing_s:.0f} s")


def test_a_boot_clock_that_jumps_is_not_flown_time(simulation1_plan: Plan) -> None:
    found = Completion(simulation1_plan)
    found.begins(0.0)
    for boot_ms in (1000, 1100, 3_601_100):
        found.receive(1, boot_ms, armed=True)
    found.lands([1])
    assert "vehicle 1 flew 0 s" in found.missing({})[0]


def test_a_vehicle_that_came_down_elsewhere_is_named(simulation1_plan: Plan) -> None:
    found = flown(simulation1_plan)
    place = simulation1_plan.landing_points_ned_m[0]
    near = {1: VehicleView(1, place + np.array([1.0, 0.0, 0.0]))}
    far = {1: VehicleView(1, place + np.array([0.0, 41.0, 0.0]))}
    assert found.missing(near) == []
    assert found.missing(far) == ["vehicle 1 came down 41.0 m from its landing point (limit 5 m)"]


def test_a_flight_that_all_vehicles_broke_off_is_not_flown(simulation1_plan: Plan) -> None:
    found = flown(simulation1_plan)
    found.lands((), broke_off=True)
    assert found.missing({}) == ["no vehicle flew it to its landing"]
