"""The way of a formation back to its plan after a standstill of the ground station."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from gcs.flight.contingency import common_rejoin as common_rejoin_module
from gcs.flight.contingency.common_rejoin import FADE_S, Rejoin, Stranded, _checked, common_rejoin, quintic
from gcs.flight.contingency.manoeuvres import RejoinReference
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array

AT_S = 60.0


@pytest.fixture(scope="module")
def field(plan_of: Callable[[str], Plan]) -> tuple[Plan, ReturnRoutes]:
    plan = plan_of("field/scenario.toml")
    return plan, ReturnRoutes(plan)


def place(plan: Plan, t_s: float) -> tuple[Array, Array]:
    states = plan.states(np.array([t_s]))[:, 0]
    return states[:, POSITION], states[:, VELOCITY]


def standing(plan: Plan, t_s: float, *, moved_m: Array | float = 0.0) -> Stranded:
    where, speed = place(plan, t_s)
    return Stranded(tuple(range(len(where))), where + moved_m, np.zeros_like(speed))


def test_vehicles_near_the_plan_fade_to_it_and_keep_t0(field: tuple[Plan, ReturnRoutes]) -> None:
    plan, routes = field
    where, speed = place(plan, AT_S)
    found = common_rejoin(
        plan, routes, Stranded(tuple(range(6)), where + np.array([1.0, -1.5, 0.5]), speed), AT_S, AT_S - 2.0
    )
    assert isinstance(found, Rejoin)
    assert (found.t_s, found.fade_s) == (AT_S, FADE_S)
    assert found.separation_m > 4.9


@pytest.mark.parametrize("long_s", [6.0, 15.0, 60.0])
def test_the_plan_waits_for_vehicles_that_stand(field: tuple[Plan, ReturnRoutes], long_s: float) -> None:
    plan, routes = field
    stopped_s = AT_S + 2.0
    found = common_rejoin(plan, routes, standing(plan, stopped_s), AT_S + long_s, AT_S)
    assert isinstance(found, Rejoin)
    assert stopped_s - found.fade_s / 2 - 0.2 <= found.t_s <= stopped_s + 0.2
    where, speed = place(plan, found.t_s)
    s = np.linspace(0.0, 1.0, 81)
    states = plan.states(found.t_s + s * found.fade_s)
    moved, rate, _ = quintic(standing(plan, stopped_s).position_ned_m - where, -speed, s, found.fade_s)
    flown = states[..., POSITION] + moved
    assert np.abs(states[..., VELOCITY] + rate).max() < 5.5, "nobody catches up"
    gaps = np.linalg.norm(flown[:, None] - flown[None], axis=-1)[np.triu_indices(6, 1)]
    assert gaps.min() == pytest.approx(found.separation_m, abs=0.2)


def test_vehicles_short_of_their_landing_points_get_there_before_the_plan_lands(
    field: tuple[Plan, ReturnRoutes],
) -> None:
    plan, routes = field
    over_s = plan.phase("landing").start_s
    where, speed = place(plan, over_s)
    found = common_rejoin(
        plan, routes, Stranded(tuple(range(6)), where + np.array([2.0, 2.0, 0.0]), speed), over_s + 9.0, AT_S
    )
    assert isinstance(found, Rejoin)
    assert found.t_s + found.fade_s <= over_s


def test_vehicles_of_two_kinds_stop_at_different_places(field: tuple[Plan, ReturnRoutes]) -> None:
    """Those of PX4 stop 1 s earlier, and sink."""
    plan, routes = field
    late, early = standing(plan, AT_S + 3.0), standing(plan, AT_S + 2.0, moved_m=np.array([0.0, 0.0, 2.0]))
    mixed = np.where(np.arange(6)[:, None] % 2, early.position_ned_m, late.position_ned_m)
    found = common_rejoin(plan, routes, Stranded(late.rows, mixed, np.zeros((6, 3))), AT_S + 15.0, AT_S)
    assert isinstance(found, Rejoin)
    assert found.separation_m > 3.0, "they stand 3.6 m apart"


def test_vehicles_far_from_the_plan_have_no_way_back(field: tuple[Plan, ReturnRoutes]) -> None:
    plan, routes = field
    found = common_rejoin(plan, routes, standing(plan, AT_S, moved_m=np.array([0.0, 0.0, -20.0])), AT_S + 6.0, AT_S)
    assert found == "a vehicle is 20.0 m from the plan at its nearest instant (limit 15 m)"


def test_two_vehicles_that_would_meet_have_no_way_back(field: tuple[Plan, ReturnRoutes]) -> None:
    plan, routes = field
    here = standing(plan, AT_S)
    swapped = here.position_ned_m.copy()
    swapped[[1, 2]] = swapped[[2, 1]]
    found = common_rejoin(plan, routes, Stranded(here.rows, swapped, here.velocity_ned_mps), AT_S + 6.0, AT_S)
    assert isinstance(found, str)
    assert "separation" in found or "limit 15 m" in found


def test_the_checked_motion_is_the_one_that_is_streamed() -> None:
    class Still:
        def at(self, k: int, t_s: float) -> tuple[float, ...]:
            return (0.0,) * 10

    off, rate = np.array([3.0, -2.0, 1.0]), np.array([0.5, 1.0, -0.2])
    streamed = RejoinReference(Still(), off, rate, 100.0, 6.0)
    for s in (0.0, 0.2, 0.5, 0.9):
        parts = quintic(off[None], rate[None], np.array([s]), 6.0)
        assert np.concatenate([part[0, 0] for part in parts]) == pytest.approx(streamed.at(0, 100.0 + 6.0 * s)[:9])


class Fence:
    """Ways within a fence along a parallel of latitude, which is all that a rejoin asks of them."""

    def __init__(self, east_m: float) -> None:
        self.east_m = east_m

    def outside_fence_m(self, places: Array) -> Array:
        return np.maximum(places[..., 1] - self.east_m, 0.0)


NO_FENCE = cast(ReturnRoutes, Fence(np.inf))
T_S = 12.0


def checked(
    plan: Plan, off_m: tuple[float, ...], off_mps: tuple[float, ...], fade_s: float, routes: ReturnRoutes = NO_FENCE
) -> object:
    """The verdict over a fade of all vehicles from the same deviation; T is 12 s, where the plan flies evenly."""
    where, speed = place(plan, T_S)
    here = Stranded((0, 1, 2), where + np.array(off_m), speed + np.array(off_mps))
    found = _checked(plan, routes, here, T_S, fade_s, 2.0)
    return found if isinstance(found, str) else ""


def overshoot_m(mps: float, fade_s: float) -> float:
    """How far a vehicle with this deviation of its velocity gets: the greatest value of s (1 - s)^3 (1 + 3 s)."""
    s = np.linspace(0.0, 1.0, 1001)
    return mps * fade_s * float((s * (1 - s) ** 3 * (1 + 3 * s)).max())


def test_the_push_of_a_way_back_is_limited(hop: Plan) -> None:
    """A quintic from rest to rest needs 10 / sqrt(3) times way / time^2; the limit is 3 m/s^2."""
    at_most_m = 3.0 * 4.0**2 * 3**0.5 / 10.0
    assert checked(hop, (0.0, -0.98 * at_most_m, 0.0), (0.0, 0.0, 0.0), 4.0) == ""
    refused = checked(hop, (0.0, -1.03 * at_most_m, 0.0), (0.0, 0.0, 0.0), 4.0)
    assert refused == "the way back needs 3.1 m/s^2 more than the plan (limit 3 m/s^2)"


def test_the_speed_of_a_way_back_is_limited(hop: Plan) -> None:
    """It moves at up to 15 / 8 of way / time. Downwards 1.5 m/s are allowed in the plan, and 0.5 m/s more here."""
    at_most_m = 2.0 * 8.0 * 8.0 / 15.0
    assert checked(hop, (0.0, 0.0, -0.97 * at_most_m), (0.0, 0.0, 0.0), 8.0) == ""
    refused = checked(hop, (0.0, 0.0, -1.03 * at_most_m), (0.0, 0.0, 0.0), 8.0)
    assert str(refused).startswith("the way back needs ")
    assert str(refused).endswith(" m/s, beyond the limits of speed")


def test_a_way_back_keeps_the_clearance_to_half_a_metre(hop: Plan) -> None:
    """The plan flies at 8.2 m, and 3 m of clearance are required."""
    sinks_mps = (8.2 - 2.5) / overshoot_m(1.0, 16.0)
    assert checked(hop, (0.0, 0.0, 0.0), (0.0, 0.0, 0.96 * sinks_mps), 16.0) == ""
    assert "the way back violates the limit of " in str(
        checked(hop, (0.0, 0.0, 0.0), (0.0, 0.0, 1.04 * sinks_mps), 16.0)
    )


@pytest.mark.parametrize(("into_m", "passes"), [(0.8, True), (1.3, False)])
def test_a_way_back_cuts_a_no_fly_zone_by_less_than_a_metre(hop: Plan, into_m: float, passes: bool) -> None:
    """The zone lies as far to the east as the eastern vehicle gets, less `into_m`."""
    s = np.linspace(0.0, 1.0, 1001)
    planned_m = hop.states(T_S + 8.0 * s)[2, :, 1]
    reach_m = float((planned_m + 2.0 * 8.0 * s * (1 - s) ** 3 * (1 + 3 * s)).max())
    east_m = reach_m - into_m
    zone = NoFlyZone(polygon_m=((-200.0, east_m), (300.0, east_m), (300.0, east_m + 200.0), (-200.0, east_m + 200.0)))
    zoned = replace(hop, scenario=hop.scenario.model_copy(update={"no_fly": (zone,)}))
    found = checked(zoned, (0.0, 0.0, 0.0), (0.0, 2.0, 0.0), 8.0)
    assert (found == "") is passes
    assert passes or str(found).startswith(f"the way back leads {into_m:.1f} m into ")


def test_a_way_back_does_not_leave_the_fence(hop: Plan) -> None:
    s = np.linspace(0.0, 1.0, 1001)
    reach_m = float((hop.states(T_S + 8.0 * s)[2, :, 1] + 2.0 * 8.0 * s * (1 - s) ** 3 * (1 + 3 * s)).max())
    inside, outside = (cast(ReturnRoutes, Fence(reach_m + by_m)) for by_m in (0.1, -1.0))
    assert checked(hop, (0.0, 0.0, 0.0), (0.0, 2.0, 0.0), 8.0, inside) == ""
    assert checked(hop, (0.0, 0.0, 0.0), (0.0, 2.0, 0.0), 8.0, outside) == "the way back leads 1.0 m outside the fence"


@pytest.mark.parametrize(("off_m", "stays"), [(2.9, True), (3.1, False)])
def test_t0_stays_for_vehicles_within_3_m_of_the_plan(hop: Plan, off_m: float, stays: bool) -> None:
    where, speed = place(hop, T_S)
    found = common_rejoin(hop, NO_FENCE, Stranded((0, 1, 2), where - [off_m, 0.0, 0.0], speed), T_S, T_S - 2.0)
    assert isinstance(found, Rejoin)
    assert (found.t_s == T_S) is stays


@pytest.mark.parametrize(("up_m", "words"), [(14.8, ""), (15.2, "a vehicle is 15.2 m from the plan at its nearest")])
def test_no_vehicle_rejoins_from_further_than_15_m(hop: Plan, up_m: float, words: str) -> None:
    found = common_rejoin(hop, NO_FENCE, standing(hop, T_S, moved_m=np.array([0.0, 0.0, -up_m])), T_S + 5.0, T_S)
    assert ("m from the plan" in str(found)) is bool(words)
    assert str(found).startswith(words)


def test_with_moving_no_fly_zones_the_plan_does_not_wait(hop: Plan) -> None:
    zones = tuple(
        NoFlyZone(north_m=900.0 + n, east_m=900.0, radius_m=5.0, moves=moves)
        for n, moves in enumerate([(), ((0.0, 0.0, 0.0), (9.0, 1.0, 0.0))])
    )
    zoned = replace(hop, scenario=hop.scenario.model_copy(update={"no_fly": zones}))
    found = common_rejoin(zoned, NO_FENCE, standing(hop, T_S), T_S + 6.0, T_S)
    assert found == "no-fly zones move, so the plan cannot wait"


def test_after_the_plan_there_is_no_way_back_to_it(hop: Plan) -> None:
    found = common_rejoin(hop, NO_FENCE, standing(hop, 33.0, moved_m=5.0), 40.0, 37.0)
    assert found == "the plan is over"


def test_a_rejoin_in_words() -> None:
    words = "they continue at t = 12.3 s, are on the plan 6 s later, and keep 5.0 m apart"
    assert str(Rejoin(12.34, 6.0, 4.96)) == words


@pytest.mark.parametrize(
    ("now_s", "off_m", "stays"),
    [(25.9, 2.9, True), (26.1, 2.9, False), (26.1, 0.55, False), (26.1, 0.45, True), (60.0, 0.45, True)],
)
def test_t0_stays_near_the_end_only_for_vehicles_that_are_all_but_there(
    hop: Plan, now_s: float, off_m: float, stays: bool
) -> None:
    """The landing begins at 34 s, and a fade that keeps T0 takes 8 s. After its end the plan stands on the ground."""
    assert hop.phase("landing").start_s == 34.0
    where, speed = place(hop, min(now_s, hop.t_end_s))
    found = common_rejoin(hop, NO_FENCE, Stranded((0, 1, 2), where - [0.0, off_m, 0.0], speed), now_s, 20.0)
    assert (isinstance(found, Rejoin) and (found.t_s, found.fade_s) == (now_s, 8.0)) is stays


def test_t0_stays_for_vehicles_that_still_wait_in_their_hover(hop: Plan) -> None:
    """6.5 s before the plan's take-off is over it is 4.6 m below the hover in which they are."""
    now_s = hop.airborne_s - 6.5
    found = common_rejoin(hop, NO_FENCE, standing(hop, hop.airborne_s), now_s, now_s - 5.0)
    assert isinstance(found, Rejoin), found
    assert (found.t_s, found.fade_s) == (now_s, FADE_S)


def tried(hop: Plan, here: Stranded, monkeypatch: pytest.MonkeyPatch, since_s: float) -> list[tuple[float, ...]]:
    """Where in the plan a rejoin is tried, how long it takes, and what separation it keeps: 30 s after `since_s`."""
    found: list[tuple[float, ...]] = []
    monkeypatch.setattr(common_rejoin_module, "_checked", lambda *asked: found.append(asked[3:]) or "it cannot")
    assert common_rejoin(hop, NO_FENCE, here, since_s + 30.0, since_s) == "it cannot"
    return found


@pytest.mark.parametrize("stood_s", [T_S - 1.9, T_S, T_S + 5.0, 33.9])
def test_the_plan_is_taken_up_at_most_half_a_fade_before_the_vehicles_place_in_it(
    hop: Plan, monkeypatch: pytest.MonkeyPatch, stood_s: float
) -> None:
    """A place up to 2 s before the last setpoint counts. All are on the plan when its landing begins at 34 s."""
    since_s = T_S if stood_s < 30.0 else 28.0
    found = tried(hop, standing(hop, stood_s), monkeypatch, since_s)
    nearest_s = found[0][0] if stood_s < 30.0 else 30.0
    assert nearest_s == pytest.approx(min(stood_s, 30.0), abs=0.06)
    shares = (0.0, 0.125, 0.25, 0.375, 0.5)
    expected = [(fade_s, nearest_s - share * fade_s) for fade_s in (4.0, 6.0, 8.0, 12.0, 16.0) for share in shares]
    expected = [(fade_s, min(t_s, 34.0 - fade_s)) for fade_s, t_s in expected if t_s >= hop.airborne_s]
    np.testing.assert_allclose([(fade_s, t_s) for t_s, fade_s, _ in found], expected, atol=0.06)


@pytest.mark.parametrize(
    ("apart_m", "judged_m", "least_m"),
    [
        (5.0, 1.0, 0.8 * 3.0 - 0.3),  # of the limit of 3 m in the plan, and noise
        (1.8, 1.0, 1.8 - 0.3),  # as near as they are
        (1.1, 1.0, 1.0),  # what the flight is judged by
        (5.0, 2.5, 2.5),
    ],
)
def test_a_way_back_keeps_most_of_the_planned_separation_or_what_there_is(
    hop: Plan, monkeypatch: pytest.MonkeyPatch, apart_m: float, judged_m: float, least_m: float
) -> None:
    assert hop.scenario.limits.separation_min_m == 3.0
    judge = hop.scenario.judge.model_copy(update={"separation_min_m": judged_m})
    judged = replace(hop, scenario=hop.scenario.model_copy(update={"judge": judge}))
    here = standing(hop, T_S)
    places = here.position_ned_m.copy()
    places[2] = places[1] + [0.0, apart_m, 0.0]
    found = tried(judged, replace(here, position_ned_m=places), monkeypatch, T_S)
    assert [least for _, _, least in found] == pytest.approx([least_m] * len(found))
