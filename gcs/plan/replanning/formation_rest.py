"""The plan of some vehicles of a formation: without those that left it, whose places stay empty."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import Infeasible
from gcs.physics.states import ATTITUDE, POSITION
from gcs.plan.formation.shape import Shape
from gcs.plan.replanning.remaining_plan import shape_part, trajectory_part, with_times_of_changes
from gcs.plan.trajectory.energy import used_until
from gcs.plan.trajectory.ground_phases import landing_step, straight_down
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory, joined
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import NED_FROM_UP, offsets_ned_m
from gcs.types import Array

_EVERY_S, _STILL_M = 0.1, 1e-6


def rest_of(plan: Plan, at_s: float) -> Plan:
    """The plan from an instant of its mission on, as one that begins in the air."""
    route_s = tuple(t_s for t_s in plan.route_s if t_s > at_s)
    return replace(
        plan,
        scenario=with_times_of_changes(plan.scenario, plan),
        leader_trajectory=trajectory_part(plan.leader_trajectory, at_s, plan.t_end_s),
        shape=shape_part(plan.shape, at_s, plan.t_end_s),
        phases=tuple(replace(p, start_s=max(p.start_s, at_s)) for p in plan.phases if p.end_s > at_s),
        begin_state=tuple(plan.leader_trajectory.state(at_s).tolist()),
        route_s=route_s,
        leg_limits=plan.leg_limits[len(plan.leg_limits) - len(route_s) - 1 :] if plan.leg_limits else (),
        zones_since_s=(),
        used_before=used_until(plan, at_s),
    )


def plan_of(plan: Plan, sysids: tuple[int, ...], at_s: float) -> Plan:
    """The plan of these vehicles alone from `at_s` on: each keeps its place. Without their leader the first one leads.

    Raises Infeasible where the leader would change in a formation that cannot pass it on.
    """
    rest, rows = rest_of(plan, at_s), [plan.sysids.index(sysid) for sysid in sysids]
    leads = plan.leader if plan.leader in rows else rows[0]
    to_leader = _constant_offset(rest, leads)
    leader = rest.leader_trajectory if leads == rest.leader else _led_by(rest, leads, to_leader)
    table = rest.shape.basis_ned_m
    return replace(
        rest,
        scenario=_scenario_of(rest.scenario, rows, leads, to_leader),
        leader_trajectory=leader,
        shape=Shape(rest.shape.functions, table[:, rows] - table[:, [leads]]),
        begin_state=tuple(leader.state(at_s).tolist()),
        used_before=tuple(rest.used_before[row] for row in rows) if rest.used_before else (),
    )


def with_empty_places(old: Plan, new: Plan) -> Plan:
    """A plan of some vehicles of the `old` one as a plan of all: the others keep their places, which nobody flies."""
    if new.sysids == old.sysids:
        return new
    begin = old.shape.at(new.t_start_s)
    rows = [old.sysids.index(sysid) for sysid in new.sysids]
    to_leader = begin[rows[new.leader]]
    table = np.zeros((len(new.shape.basis_ned_m) + 1, len(old.sysids), 3))
    table[:-1, rows] = new.shape.basis_ned_m
    table[-1] = begin
    table[-1, rows] = to_leader
    functions = new.shape.functions
    ones = np.zeros((*functions.c.shape[:2], 1))
    ones[-1] = 1.0
    used = np.zeros(len(old.sysids))
    used[rows] = new.used_before or 0.0
    leader = _moved(new.leader_trajectory, -to_leader)
    formation = old.scenario.formation.model_copy(update={"change": new.scenario.formation.change})
    update = {"formation": formation, **_ends_moved(new.scenario, -to_leader)}
    return replace(
        new,
        scenario=new.scenario.model_copy(update=update),
        leader_trajectory=leader,
        shape=Shape(PPoly(np.concatenate([functions.c, ones], axis=2), functions.x), table),
        begin_state=tuple(leader.state(new.t_start_s).tolist()),
        used_before=tuple(used.tolist()) if new.used_before else (),
    )


def _constant_offset(rest: Plan, leads: int) -> Array:
    """Where the new leader is beside the old one (3,). Raises Infeasible where that changes, or a route is flown."""
    if leads == rest.leader:
        return np.zeros(3)
    if rest.scenario.route or rest.scenario.formation.frame == "course":
        raise Infeasible("the leader of a route, or of a formation that turns with its course, has no successor")
    lands_s = rest.phase(PhaseKind.LANDING).start_s
    times = np.append(np.arange(rest.t_start_s, lands_s, _EVERY_S), lands_s)
    places = rest.shape.offsets(times, rows=np.array([leads]))[0]
    if np.ptp(places, axis=0).max() > _STILL_M:
        raise Infeasible("the leader of a formation whose shape still changes has no successor")
    return np.asarray(places[0])


def _led_by(rest: Plan, leads: int, to_leader: Array) -> Trajectory:
    """The track of another leader: beside the old one, and in the landing down to its own ground."""
    landing = rest.phase(PhaseKind.LANDING)
    flown = _moved(trajectory_part(rest.leader_trajectory, rest.t_start_s, landing.start_s), to_leader)
    state = flown.state(landing.start_s)
    ground_m = float(rest.landing_points_ned_m[leads, 2])
    down_m = landing_step(landing.start_s, landing.end_s, float(state[2]), ground_m, rest.scenario)
    yaw_ned_rad = float(state[ATTITUDE][2])
    return joined([flown, straight_down(down_m, state[POSITION], yaw_ned_rad, rest.quadrotor)])


def _moved(trajectory: Trajectory, by_ned_m: Array) -> Trajectory:
    if not by_ned_m.any():
        return trajectory
    coefficients = np.array(trajectory.state.c)
    coefficients[-1, :, POSITION] += by_ned_m
    return Trajectory(PPoly(coefficients, trajectory.state.x), trajectory.control)


def _scenario_of(scenario: Scenario, rows: list[int], leads: int, to_leader: Array) -> Scenario:
    """The scenario with these vehicles alone, in their places at t = 0."""
    formation, every = scenario.formation, scenario.formation.vehicle
    if formation.count is not None:
        places = _start_places(scenario) * NED_FROM_UP
        vehicles = [{"sysid": formation.sysids[row], "position_m": places[row].tolist()} for row in rows]
    else:
        vehicles = [every[row].model_dump() for row in rows]
    shapes = [
        {**shape.model_dump(), "offsets_m": tuple(shape.offsets_m[row] for row in rows if shape.offsets_m)}
        for shape in formation.shape
    ]
    data = scenario.model_copy(update=_ends_moved(scenario, to_leader)).model_dump()
    data["formation"] |= {"vehicle": vehicles, "count": None, "start_shape": None, "shape": shapes}
    data["formation"]["leader"] = formation.sysids[leads]
    return Scenario.model_validate(data)


def _start_places(scenario: Scenario) -> Array:
    """Places (V, 3) at t = 0, NED."""
    return np.asarray(np.array(scenario.start.position_m) * NED_FROM_UP + offsets_ned_m(scenario))


def _ends_moved(scenario: Scenario, by_ned_m: Array) -> dict[str, object]:
    """Start and end of a leader beside the present one."""
    if not by_ned_m.any():
        return {}
    by_m = by_ned_m * NED_FROM_UP
    ends = {"start": scenario.start, "end": scenario.end}
    return {
        name: end.model_copy(update={"position_m": tuple((np.array(end.position_m) + by_m).tolist())})
        for name, end in ends.items()
    }
