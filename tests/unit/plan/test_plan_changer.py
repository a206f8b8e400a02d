"""A plan that changes in flight: round new zones one after another, in another shape, and as one plan of its pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.errors import Infeasible, PlanningError, UsageError
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation_orders import Avoid, CloseRanks, FlyHome, GoOn, GoTo, Hold, Reshape, Scale, Slower
from gcs.plan.plan_changer import PlanChanger, Proposal
from gcs.plan.plan_file import load_plan, save_plan
from gcs.plan.planner import make_plan
from gcs.plan.replanning.plan_pieces import continued, in_pieces, jump_between
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.verify import verify
from gcs.scenario.environment.no_fly import nearest_zone_m
from gcs.scenario.schema.formation_table import ShapeTable


def ahead(plan: Plan, t_s: float, radius_m: float = 3.0) -> Avoid:
    north_m, east_m, _ = plan.leader_trajectory.state(t_s)[:3].tolist()
    return Avoid(north_m, east_m + 1.0, radius_m)


def test_zones_that_come_up_one_after_another_are_flown_round(hop: Plan) -> None:
    ours, pieces = PlanChanger(hop), []
    for at_s, meets_s in ((3.0, 17.0), (8.0, 22.0)):
        zone = ahead(ours.flown, meets_s)
        made = ours.change(zone, at_s)
        assert made.report.ok
        assert made.plan.t_start_s == at_s
        jump = jump_between(ours.flown, made.plan)
        assert jump.allowed, jump
        ours.adopt(made)
        pieces.append(made.plan)
    assert ours.flown.zones_since_s == (3.0, 8.0)
    assert verify(pieces[-1]).ok
    t_s = np.arange(8.0, hop.landing_s, 0.05)
    places = ours.flown.states(t_s)[..., POSITION]
    assert nearest_zone_m(ours.flown.scenario.no_fly, t_s, places[..., 0], places[..., 1]).min() > -1e-3
    before_s = np.arange(hop.t_start_s, 3.0, 0.1)
    assert np.array_equal(ours.flown.states(before_s)[..., POSITION], hop.states(before_s)[..., POSITION])
    assert in_pieces(hop, pieces).hash == ours.flown.hash


def test_a_zone_counts_from_the_plan_on_that_avoids_it(hop: Plan) -> None:
    """One that comes up behind the formation was flown through before."""
    behind = ahead(hop, 2.0)
    ours = PlanChanger(hop)
    ours.adopt(ours.change(behind, 15.0))
    flown = ours.flown
    assert np.isinf(flown.zone_distances_m(np.array([2.0, 14.9]))).all()
    assert flown.zone_distances_m(np.array([2.0, 16.0]))[:, 1].min() > 0.0
    assert flown.zone_distances_m(np.array([16.0]), np.full((3, 1, 3), [behind.north_m, behind.east_m, -8.0])).max() < 0


def test_a_shape_grows_on_the_same_track_and_lands_so(hop: Plan) -> None:
    ours = PlanChanger(hop)
    made = ours.change(Scale(1.4), 6.0)
    assert made.report.ok
    assert jump_between(hop, made.plan).allowed
    end_s = hop.landing_s - 0.1
    np.testing.assert_allclose(made.plan.shape.at(end_s), 1.4 * hop.shape.at(end_s), atol=1e-6)
    np.testing.assert_allclose(made.plan.leader_trajectory.state(20.0), hop.leader_trajectory.state(20.0), atol=1e-9)
    ours.adopt(made)
    assert len(ours.flown.scheduled_moves) == 1
    again = ours.change(ahead(ours.flown, 22.0, 2.0), 14.0)
    assert again.report.ok, "re-planned in the new shape"


def test_a_formation_flies_home_from_the_plan_that_it_flies_by_now(hop: Plan) -> None:
    ours = PlanChanger(hop)
    ours.adopt(ours.change(ahead(hop, 17.0), 3.0))
    for at_s in (9.0, 10.5):  # the second from near the first, which came too late
        made = ours.change(FlyHome(), at_s)
        assert made.report.ok
        assert jump_between(ours.flown, made.plan).allowed
    ours.adopt(made)
    assert ours.flown.zones_since_s == (3.0,)
    end_s = np.array([ours.flown.t_end_s - 1e-6])
    np.testing.assert_allclose(ours.flown.states(end_s)[:, 0, POSITION], hop.pads_ned_m, atol=1e-3)
    t_s = np.arange(10.5, ours.flown.landing_s, 0.05)
    assert ours.flown.zone_distances_m(t_s).min() > -1e-3, "the zone that came up still counts"


def test_a_changed_plan_is_kept_in_a_file_like_any_other(hop: Plan, tmp_path: object) -> None:
    path = str(tmp_path) + "/plan-2.skein"
    for order in (ahead(hop, 18.0), Scale(1.2), FlyHome()):
        made = PlanChanger(hop).change(order, 4.0)
        save_plan(made.plan, made.report, path)
        read, report = load_plan(path)
        assert report.ok
        assert read.hash == made.plan.hash


@pytest.mark.parametrize("order", [Scale(0.5), Reshape("heart")])
def test_a_shape_that_vehicles_cannot_take_is_refused(hop: Plan, order: Scale | Reshape) -> None:
    with pytest.raises((Infeasible, PlanningError, ValueError)):
        PlanChanger(hop).change(order, 6.0)


def test_a_zone_over_the_goal_is_refused_with_a_reason(hop: Plan) -> None:
    with pytest.raises(PlanningError, match="no plan"):
        PlanChanger(hop).change(ahead(hop, 29.5, 10.0), 4.0)


def test_plans_that_do_not_meet_are_not_joined(hop: Plan) -> None:
    made = PlanChanger(hop).change(ahead(hop, 18.0), 4.0).plan
    leader = made.leader_trajectory
    moved = leader.state.c.copy()
    moved[-1, :, 0] += 0.5
    off = replace(made, leader_trajectory=Trajectory(type(leader.state)(moved, leader.state.x), leader.control))
    with pytest.raises(PlanningError, match=r"is 0\.500 m"):
        continued(hop, off)


@pytest.mark.parametrize("gone", [1, 2], ids=["the leader", "a follower"])
def test_the_rest_flies_round_where_a_lost_vehicle_may_be(hop: Plan, gone: int) -> None:
    """The next one leads, and further orders are for those that remain."""
    rest = tuple(sysid for sysid in hop.sysids if sysid != gone)
    rows = [hop.sysids.index(sysid) for sysid in rest]
    place = hop.states(np.array([22.0]))[rows, 0, :2].mean(axis=0)
    zone = Avoid(float(place[0]), float(place[1]) + 1.0, 3.0).zone
    ours = PlanChanger(hop)
    made = ours.change(CloseRanks(rest, (zone,)), 10.0)
    assert made.report.ok
    assert made.plan.sysids == rest
    assert made.plan.sysids[made.plan.leader] == (2 if gone == 1 else 1)
    t_s = np.arange(10.0, hop.landing_s, 0.05)
    places = made.plan.states(t_s)[..., POSITION]
    assert nearest_zone_m((zone,), t_s, places[..., 0], places[..., 1]).min() > -1e-3
    flown = continued(hop, made.plan)
    np.testing.assert_allclose(flown.states(t_s)[rows][..., POSITION], places, atol=1e-9)
    empty = flown.states(t_s)[hop.sysids.index(gone), :, POSITION] - places[0]
    np.testing.assert_allclose(empty, empty[:1].repeat(len(t_s), axis=0), atol=1e-9)
    np.testing.assert_allclose(flown.landing_points_ned_m[rows], hop.landing_points_ned_m[rows], atol=1e-3)
    ours.adopt(made)
    assert ours.change(Scale(1.3), 14.0).plan.sysids == rest


def test_the_next_leads_a_formation_at_several_heights_to_its_landing(hop: Plan) -> None:
    """Vehicles that come down from other heights move against each other in the landing."""
    above = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -3.0], [0.0, 0.0, -1.5]])  # (V, 3)
    higher = hop.scenario.formation.model_copy(
        update={
            "vehicle": tuple(
                one.model_copy(update={"position_m": (*one.position_m[:2], one.position_m[2] - float(dz))})
                for one, dz in zip(hop.scenario.formation.vehicle, above[:, 2], strict=True)
            )
        }
    )
    old = make_plan(hop.scenario.model_copy(update={"formation": higher}))
    made = PlanChanger(old).change(CloseRanks((2, 3), ()), 10.0)
    assert made.report.ok
    assert made.plan.sysids[made.plan.leader] == 2
    t_s = np.arange(10.0, old.t_end_s, 0.05)
    np.testing.assert_allclose(made.plan.states(t_s)[..., POSITION], old.states(t_s)[1:, :, POSITION], atol=1e-6)


@pytest.mark.parametrize("rest", [(1, 3), (2, 3)])
def test_a_named_shape_closes_the_gap(hop: Plan, rest: tuple[int, ...]) -> None:
    line = ShapeTable(name="line", generator="line", spacing_m=4.0)
    formation = hop.scenario.formation.model_copy(update={"shape": (line,)})
    ours = PlanChanger(replace(hop, scenario=hop.scenario.model_copy(update={"formation": formation})))
    ours.adopt(ours.change(CloseRanks(rest, ()), 8.0))
    made = ours.change(Reshape("line"), 11.0)
    assert made.report.ok
    assert made.plan.sysids == rest
    first, second = made.plan.states(np.array([28.0]))[:, 0, POSITION]
    np.testing.assert_allclose(second - first, [0.0, 4.0, 0.0], atol=1e-6)


def test_those_that_remain_keep_their_track_if_the_lost_one_is_behind(hop: Plan) -> None:
    made = PlanChanger(hop).change(CloseRanks((2, 3), (ahead(hop, 2.0).zone,)), 15.0)
    t_s = np.arange(15.0, hop.t_end_s, 0.1)
    np.testing.assert_allclose(made.plan.states(t_s)[..., POSITION], hop.states(t_s)[1:, :, POSITION], atol=1e-9)


def test_ranks_that_cannot_close_say_why(hop: Plan) -> None:
    with pytest.raises(PlanningError, match="no-fly zone"):
        PlanChanger(hop).change(CloseRanks((2, 3), (ahead(hop, 10.0, 6.0).zone,)), 10.0)


def ordered(ours: PlanChanger, order: object, at_s: float) -> Proposal:
    """The order carried out, verified, without a step of place, velocity or acceleration."""
    made = ours.change(order, at_s)  # type: ignore[arg-type]
    assert made.report.ok
    jump = jump_between(ours.flown, made.plan)
    assert jump.position_m < 1e-6
    assert jump.velocity_mps < 1e-6
    assert jump.acceleration_mps2 < (0.5 if made.plan.scenario.no_fly else 0.01)  # the optimiser's first thrust is free
    edge_s = np.array([at_s - 1e-6, at_s + 1e-6])
    ours.adopt(made)
    np.testing.assert_allclose(np.diff(ours.flown.offsets(edge_s, 1), axis=1), 0.0, atol=1e-5)
    return made


def speeds(plan: Plan, t_s: np.ndarray) -> np.ndarray:
    return np.linalg.norm(plan.states(t_s)[..., VELOCITY], axis=2).max(axis=0)


def test_a_slower_plan_flies_the_same_track_and_resume_brings_its_speed_back(hop: Plan) -> None:
    ours = PlanChanger(hop)
    ordered(ours, Slower(0.5), 6.0)
    later_s = ours.flown.landing_s - hop.landing_s
    assert later_s > 8.0
    t_s = np.linspace(11.0, 13.0, 5)
    track = hop.leader_trajectory.state(np.linspace(6.0, 30.0, 4000))[:, :3]
    for state in ours.flown.leader_trajectory.state(t_s):
        away_m = np.linalg.norm(track - state[POSITION], axis=1)
        assert away_m.min() < 0.02
        fast = hop.leader_trajectory.state(6.0 + 24.0 / 3999 * int(away_m.argmin()))
        assert np.linalg.norm(state[VELOCITY]) == pytest.approx(0.5 * np.linalg.norm(fast[VELOCITY]), rel=0.01)
    ordered(ours, GoOn(), 14.0)
    assert ours.flown.landing_s - hop.landing_s < 0.7 * later_s
    with pytest.raises(UsageError, match="flies its plan"):
        ours.change(GoOn(), 20.0)
    after = ours.change(ahead(ours.flown, 26.0, 2.0), 20.0)
    assert after.plan.landing_s == ours.flown.landing_s, "a zone after it is avoided in the new time"


def test_a_formation_holds_and_goes_on_with_its_plan(hop: Plan) -> None:
    ours = PlanChanger(hop)
    ordered(ours, Hold(), 8.0)
    standing_s = np.linspace(14.0, 250.0, 50)
    assert speeds(ours.flown, standing_s).max() < 1e-6
    np.testing.assert_allclose(ours.flown.shape.at(100.0), hop.shape.at(8.0), atol=1e-9)
    ordered(ours, GoOn(), 40.0)
    later_s = ours.flown.landing_s - hop.landing_s
    assert 30.0 < later_s < 36.0
    for t_s in (48.0, 60.0):
        np.testing.assert_allclose(
            ours.flown.leader_trajectory.state(t_s), hop.leader_trajectory.state(t_s - later_s), atol=1e-6
        )
    ordered(ours, Hold(), 50.0)


def test_a_formation_that_still_brakes_goes_on_once_it_stands(hop: Plan) -> None:
    ours = PlanChanger(hop)
    ordered(ours, Hold(), 8.0)
    ordered(ours, GoOn(), 9.0)
    assert 0.0 < ours.flown.landing_s - hop.landing_s < 8.0


def test_a_formation_goes_elsewhere_and_comes_back_to_its_plan(hop: Plan) -> None:
    ours, place = PlanChanger(hop), np.array([10.0, 30.0, -12.0])
    ordered(ours, GoTo(10.0, 30.0, 12.0), 8.0)
    t_s = ours.flown.landing_s - 10.0
    np.testing.assert_allclose(ours.flown.leader_trajectory.state(t_s)[:3], place, atol=1e-3)
    assert speeds(ours.flown, np.array([t_s])).max() < 1e-6
    ordered(ours, GoTo(20.0, 30.0, 12.0), 60.0)
    ordered(ours, GoOn(), 120.0)
    end_s = ours.flown.landing_s - 0.1
    np.testing.assert_allclose(
        ours.flown.states(np.array([end_s]))[:, 0, POSITION], hop.states(np.array([30.0]))[:, 0, POSITION], atol=1e-3
    )


def test_from_a_hold_the_formation_flies_home_changes_shape_and_closes_ranks(hop: Plan) -> None:
    ours = PlanChanger(hop)
    ordered(ours, Hold(), 8.0)
    ordered(ours, Scale(1.3), 20.0)
    ordered(ours, CloseRanks((1, 3), ()), 60.0)
    ordered(ours, GoOn(), 70.0)
    places = ours.flown.states(np.array([ours.flown.landing_s - 0.1]))[:, 0, POSITION]
    wanted = 1.3 * (hop.shape.at(20.0)[2] - hop.shape.at(20.0)[0])
    np.testing.assert_allclose(places[1] - places[0], wanted, atol=1e-3)
    ours = PlanChanger(hop)
    ordered(ours, Hold(), 8.0)
    ordered(ours, FlyHome(), 20.0)
    end_s = np.array([ours.flown.t_end_s - 1e-6])
    np.testing.assert_allclose(ours.flown.states(end_s)[:, 0, POSITION], hop.pads_ned_m, atol=1e-3)


def test_a_formation_that_braked_before_a_zone_goes_on_round_it(hop: Plan) -> None:
    ours, zone = PlanChanger(hop), ahead(hop, 20.0)
    ordered(ours, Hold((zone.zone,)), 8.0)
    made = ordered(ours, GoOn(), 30.0)
    t_s = np.arange(30.0, made.plan.landing_s, 0.05)
    assert made.plan.zone_distances_m(t_s).min() > -1e-3
    assert made.plan.scenario.end == hop.scenario.end
    braked = PlanChanger(hop)
    ordered(braked, Hold((zone.zone,)), 8.0)
    assert braked.change(zone, 30.0).plan.landing_s < 100.0, "the zone is avoided, so the formation goes on"


def test_a_zone_beside_a_formation_that_was_told_to_hold_leaves_it_there(hop: Plan) -> None:
    ours, zone = PlanChanger(hop), ahead(hop, 20.0)
    ordered(ours, Hold(), 8.0)
    ordered(ours, zone, 20.0)
    assert speeds(ours.flown, np.linspace(21.0, 250.0, 20)).max() < 1e-6
    ordered(ours, GoOn(), 40.0)
    assert ours.flown.zone_distances_m(np.arange(40.0, ours.flown.landing_s, 0.05)).min() > -1e-3
    with pytest.raises(PlanningError, match=r"^the new plan failed verification: no-fly zone"):
        here = ours.flown.leader_trajectory.state(45.0)[:2].tolist()
        PlanChanger(hop).change(Hold((Avoid(*here, 60.0).zone,)), 8.0)


@pytest.mark.parametrize(
    ("order", "at_s", "told"),
    [(GoTo(10.0, 30.0, 900.0), 8.0, "height"), (Hold(), 29.8, "before the formation could stand")],
)
def test_what_cannot_be_flown_is_refused_with_the_reason(hop: Plan, order: GoTo | Hold, at_s: float, told: str) -> None:
    with pytest.raises(PlanningError, match=told):
        PlanChanger(hop).change(order, at_s)


@pytest.mark.parametrize("order", [Slower(0.6), Hold(), GoTo(10.0, 30.0, 12.0)])
def test_plans_at_another_pace_are_kept_in_files(hop: Plan, order: object, tmp_path: object) -> None:
    path = f"{tmp_path}/plan-2.skein"
    made = PlanChanger(hop).change(order, 6.0)  # type: ignore[arg-type]
    save_plan(made.plan, made.report, path)
    read, report = load_plan(path)
    assert report.ok
    assert read.hash == made.plan.hash
