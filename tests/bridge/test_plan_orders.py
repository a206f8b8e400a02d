"""The plan of a whole formation changes in flight: round a zone that comes up, or the formation brakes before it."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from gcs.errors import FlightError
from gcs.flight.contingency.choices import OnLoss
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.execution.plan_orders import NEW_PLAN
from gcs.flight.monitoring.progress import FlightPart
from gcs.plan.formation_orders import Avoid, FlyHome, GoOn, GoTo, Hold, PlanOrder, Slower
from gcs.plan.trajectory.plan import Plan
from sim_bridge.sim.world import World
from tests.bridge.flying import fly

pytestmark = pytest.mark.slow


def asked_at(t_s: float, order: PlanOrder) -> Any:
    return all_asked((t_s, order))


def all_asked(*steps: tuple[float, PlanOrder]) -> Any:
    """Each order at its plan time; the next one no sooner than the last one is answered."""
    left = list(steps)

    def during(_: World, flight: FlightSequence) -> None:
        if left and (flight.monitor.plan_time_s or -1.0) > left[0][0]:
            with suppress(FlightError):
                flight.ask(left[0][1], by="the test")
                left.pop(0)

    return during


def test_a_formation_flies_round_a_zone_that_comes_up(hop: Plan) -> None:
    middle = hop.leader_trajectory.state(17.0)[:2]
    zone = Avoid(float(middle[0]), float(middle[1]) + 1.0, 3.0)
    flown = fly(hop, during=asked_at(3.0, zone))
    assert flown.error is None, flown.error
    (change,) = [event for event in flown.events if event.what.startswith(NEW_PLAN)]
    begins_s = change.data["begins_t_s"]
    assert 3.0 < begins_s < 14.0  # planned in real time, and again where that took long
    after = flown.t_s > begins_s
    away_m = np.linalg.norm(flown.places[:, after, :2] - [zone.north_m, zone.east_m], axis=-1).min() - zone.radius_m
    assert away_m > 0.0
    old = hop.zone_distances_m(np.arange(0.0, 30.0, 0.1))
    assert np.isinf(old).all()
    assert flown.flight.plan.zones_since_s == (change.data["asked_t_s"],), "from when it was given"
    inside_s = (flown.t_s > 0.0) & (flown.t_s < 30.0)
    now = flown.flight.plan.states(flown.t_s[inside_s])[..., :3]
    assert np.linalg.norm(now - flown.places[:, inside_s], axis=-1).max() < 0.5
    assert flown.flight.monitor.nearest[FlightPart.FLIGHT].distance_m > 2.0


def test_the_formation_brakes_before_a_zone_that_it_cannot_fly_round(hop: Plan) -> None:
    goal = hop.leader_trajectory.state(29.0)[:2]
    zone = Avoid(float(goal[0]), float(goal[1]), 12.0)
    flown = fly(hop, during=asked_at(3.0, zone), enough=lambda flight: (flight.monitor.plan_time_s or 0.0) > 26.0)
    assert any("not avoid" in event.rule for event in flown.events), flown.events
    assert any("brake together before the zone" in event.rule for event in flown.events), flown.events
    flying = (flown.t_s > 0.0) & (flown.t_s < 26.0)
    away_m = np.linalg.norm(flown.places[:, flying, :2] - [zone.north_m, zone.east_m], axis=-1).min() - zone.radius_m
    assert away_m > 0.0


def test_a_formation_flies_home_together_and_lands_on_its_pads(hop: Plan) -> None:
    flown = fly(hop, during=asked_at(10.0, FlyHome()))
    assert flown.error is None, flown.error
    (change,) = [event for event in flown.events if event.what.startswith(NEW_PLAN)]
    assert "fly home together" in change.rule
    np.testing.assert_allclose(flown.places[:, -1, :2], hop.pads_ned_m[:, :2], atol=0.5)
    flying = (flown.t_s > 0.0) & (flown.t_s < flown.flight.plan.landing_s)
    now = flown.flight.plan.states(flown.t_s[flying])[..., :3]
    assert np.linalg.norm(now - flown.places[:, flying], axis=-1).max() < 0.5
    assert flown.flight.monitor.nearest[FlightPart.FLIGHT].distance_m > 4.0


@pytest.mark.parametrize(
    "steps",
    [
        ((4.0, Slower(0.6)), (16.0, GoOn())),
        ((8.0, Hold()), (30.0, GoOn())),
        ((6.0, GoTo(20.0, 25.0, 12.0)), (45.0, GoOn())),
        ((8.0, Hold()), (25.0, FlyHome())),
    ],
    ids=lambda steps: ", ".join(str(order) for _, order in steps),
)
def test_a_formation_flies_at_another_pace_holds_goes_elsewhere_and_goes_on(
    hop: Plan, steps: tuple[tuple[float, PlanOrder], ...]
) -> None:
    flown = fly(hop, during=all_asked(*steps))
    assert flown.error is None, flown.error
    changes = [event for event in flown.events if event.what.startswith(NEW_PLAN)]
    assert [change.rule.split(", asked by")[0] for change in changes] == [str(order) for _, order in steps]
    assert not flown.orders(1)[:-1], "nobody left the formation"
    plan = flown.flight.plan
    flying = (flown.t_s > 0.0) & (flown.t_s < plan.landing_s)
    off_m = np.linalg.norm(plan.states(flown.t_s[flying])[..., :3] - flown.places[:, flying], axis=-1)
    assert off_m.max() < 0.5
    assert flown.flight.monitor.nearest[FlightPart.FLIGHT].distance_m > 4.0
    ends = hop.pads_ned_m if isinstance(steps[-1][1], FlyHome) else hop.landing_points_ned_m
    np.testing.assert_allclose(flown.places[:, -1, :2], ends[:, :2], atol=0.5)


@pytest.mark.parametrize("dies", [3, 1], ids=["a follower", "the leader"])
def test_ranks_close_when_a_vehicle_dies(hop: Plan, dies: int) -> None:
    """The dead one falls; the zone around its last place and the separation of all are those of the truth."""
    flown = fly(hop, f"{dies}:die@24", on_loss=OnLoss.CLOSE)
    (change,) = [event for event in flown.events if event.what.startswith(NEW_PLAN)]
    assert "fly on with 2 vehicles" in change.rule
    rest = tuple(sysid for sysid in hop.sysids if sysid != dies)
    rows = [hop.sysids.index(sysid) for sysid in rest]
    assert not any(flown.orders(sysid)[:-1] for sysid in rest), flown.events
    np.testing.assert_allclose(flown.places[rows, -1, :2], hop.landing_points_ned_m[rows, :2], atol=0.5)
    flying = (flown.t_s > 0.0) & (flown.t_s < flown.flight.plan.landing_s)
    now = flown.flight.plan.states(flown.t_s[flying])[rows][..., :3]
    assert np.linalg.norm(now - flown.places[rows][:, flying], axis=-1).max() < 0.5
    apart_m = hop.separations_m(flown.t_s[flying], flown.places[:, flying])
    assert apart_m.min() > hop.scenario.judge.separation_min_m
    assert set(flown.flight.plan.zones_since_s) == {change.data["begins_t_s"]}


def test_the_others_land_if_the_ranks_cannot_close(hop: Plan) -> None:
    """Vehicle 3 is not heard when vehicle 2 is given up, so it would not get a new plan for sure."""
    flown = fly(hop, "2:die@24", "3:down.loss=1@29..41", on_loss=OnLoss.CLOSE)
    assert any("close ranks" in event.rule and "vehicle 3 is silent" in event.rule for event in flown.events)
    assert not any(event.what.startswith(NEW_PLAN) for event in flown.events)
    assert flown.orders(1)[0] == "land"
    assert flown.at_s(1, "ordered to land") - flown.at_s(2, "vehicle lost") < 1.0
