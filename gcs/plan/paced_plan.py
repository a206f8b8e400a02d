"""Plans that go on more slowly, that stop to hover, there or elsewhere, and that go on from a hover.

Tracks are those of the plan that is flown, at another pace, and straight lines between two hovers. Nothing is
optimised, so a plan takes tenths of a second; the verifier decides whether it may be flown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gcs.errors import Infeasible
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.formation.shape import joined as joined_shapes
from gcs.plan.formation.shape import stretched as moved_shape
from gcs.plan.formation.shape import stretched_polynomials as moved
from gcs.plan.formation.timeline import AUTO, Move
from gcs.plan.planner import leader_to_ground, shape_to_ground
from gcs.plan.replanning.formation_rest import rest_of
from gcs.plan.replanning.pace import STEEPEST, PlanPace, pace, paced, paced_shape
from gcs.plan.replanning.parametric_nlp import with_zones
from gcs.plan.replanning.remaining_plan import shape_part, trajectory_part, with_times_of_changes
from gcs.plan.trajectory.flown_motion import MotionJets, flown
from gcs.plan.trajectory.ground_phases import vertical
from gcs.plan.trajectory.leg_lines import NO_LIMITS
from gcs.plan.trajectory.phases import Phase, PhaseKind, phases_of
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory, joined
from gcs.scenario.schema.scenario import Boundary, Scenario
from gcs.scenario.values.si import NED_FROM_UP
from gcs.types import Array

PUSHES_MPS2 = 2.0, 1.0, 0.5  # along the track, at most: what is tried first, and where that violates a limit
_SHORTEST_S = 2.0  # of a change of pace
_AHEAD_S = 8.0  # of the track whose speeds decide how long a formation brakes
_CRUISE = 0.7  # share of the speed limits
_THERE_M, _SAME_M = 1e-3, 1e-6
_JUST = 1e-9  # s before an instant at which polynomials join


@dataclass(frozen=True)
class Left:
    """A plan that brakes from `from_s` on, waits at its instant `at_s` from `rest_s` on, and can be continued."""

    plan: Plan
    at_s: float
    from_s: float
    rest_s: float
    before_zone: bool = False  # because of a new zone


@dataclass(frozen=True)
class _Stand:
    """A formation at rest."""

    t_s: float
    place_ned_m: Array  # (3,) of the leader
    yaw_rad: float
    offsets_ned_m: Array  # (V, 3)


@dataclass(frozen=True)
class _Part:
    """The leader and the shape over the same span."""

    leader: Trajectory
    shape: Shape

    @property
    def end(self) -> _Stand:
        t_s = self.leader.end_s
        state = self.leader.state(t_s - _JUST)
        return _Stand(t_s, np.asarray(state[POSITION]), float(state[8]), self.shape.at(t_s - _JUST))


def slowed(plan: Plan, at_s: float, factor: float, push_mps2: float) -> Plan:
    """The rest of a plan from `at_s` on, at `factor` times its speeds. Raises Infeasible near the mission's end."""
    mission = plan.phase(PhaseKind.MISSION)
    changing_s = _changing_s(plan, at_s, 1.0 - factor, push_mps2)
    waits = _until_reshaped(plan, at_s)
    left_s = mission.end_s - at_s - sum(span[0] for span in waits) - 0.5 * (1.0 + factor) * changing_s
    if left_s <= 0.0:
        raise Infeasible(f"the plan arrives at t = {mission.end_s:.1f} s, before its pace could change")
    return _at_pace(plan, pace(at_s, at_s, [*waits, (changing_s, 1.0, factor), (left_s / factor, factor, factor)]))


def stopped(
    plan: Plan, at_s: float, left: Left | None, place_ned_m: Array | None, hover_s: float, push_mps2: float
) -> tuple[Plan, Left]:
    """The plan that brakes from `at_s` on, flies straight to a place of its leader (3,), if any, hovers, and lands.

    `left`: what an earlier such plan left; this one's is returned too. A change of shape under way is completed first.
    Raises Infeasible where the mission ends before the formation stands.
    """
    rest = rest_of(plan, at_s)
    parts, scenario, moves = _until_rest(plan, at_s, left), rest.scenario, plan.moves
    if left is None:
        kept = _to_a_stop(plan, at_s, push_mps2)
        parts = [_Part(paced(plan.leader_trajectory, kept, plan.quadrotor), paced_shape(plan.shape, kept))]
        left = Left(plan, _old_end_s(kept), at_s, kept.end_s)
        moves = _moves(plan, lambda s: _new_s(kept, s))
        moves = tuple(move for move in moves if move.start_s <= kept.end_s)
        scenario = _with_changes_at(scenario, moves)
    stand = parts[-1].end if parts else _stand_at(plan, at_s)
    if place_ned_m is not None and _length(place_ned_m - stand.place_ned_m) > _THERE_M:
        parts.append(_leg(plan, stand, place_ned_m, push_mps2))
        stand = parts[-1].end
    end_s = round(stand.t_s + hover_s, 3)
    q, here = plan.quadrotor, stand.place_ned_m
    hover = vertical(stand.t_s, end_s, here, float(here[2]), stand.yaw_rad, q)
    flight = _joined([*parts, _Part(hover, rigid(stand.offsets_ned_m, stand.t_s, end_s))])
    scenario = _ending_at(scenario, stand, end_s)
    stopped_plan = replace(
        rest,
        scenario=scenario,
        leader_trajectory=joined([flight.leader, *leader_to_ground(scenario)]),
        shape=joined_shapes([flight.shape, *shape_to_ground(scenario, stand.offsets_ned_m)]),
        phases=(Phase(PhaseKind.MISSION, at_s, end_s), *(p for p in phases_of(scenario) if p.start_s >= end_s)),
        moves=moves,
        route_s=(),
        leg_limits=(),
    )
    return stopped_plan, replace(left, rest_s=stand.t_s)


def gone_on(plan: Plan, at_s: float, left: Left, push_mps2: float, rate: float = 1.0) -> Plan:
    """The plan that flies back to where another one was left, and on as that one did, in the shape of now.

    It keeps the zones of the flown one. `rate`: its speeds over those of the plan that was left. Raises Infeasible
    where the formation has another shape now, and that plan changes its shape later.
    """
    parts = _until_rest(plan, at_s, left)
    stand = parts[-1].end if parts else _stand_at(plan, at_s)
    back_ned_m = np.asarray(left.plan.leader_trajectory.state(left.at_s)[POSITION])
    if _length(back_ned_m - stand.place_ned_m) > _THERE_M:
        parts.append(_leg(plan, stand, back_ned_m, push_mps2))
        stand = parts[-1].end
    to_fly_s = left.plan.phase(PhaseKind.MISSION).end_s - left.at_s
    changing_s = _changing_s(left.plan, left.at_s, 1.0, push_mps2)
    rate = min(to_fly_s / changing_s, rate)
    speeds = [(changing_s, 0.0, rate)]
    if rate < 1.0:
        speeds.append(((to_fly_s / rate - 0.5 * changing_s), rate, rate))
    old = _in_shape(left, stand.offsets_ned_m, plan)
    rest = _at_pace(old, pace(stand.t_s, left.at_s, speeds))
    flight = _joined([*parts, _Part(rest.leader_trajectory, rest.shape)])
    mission, *after = rest.phases
    if parts and rest.leg_limits:  # the way back lies on no leg
        rest = replace(rest, leg_limits=(NO_LIMITS, *rest.leg_limits[1:]))
    moves = (*plan.moves, *rest.moves[len(plan.moves) :])  # those until now as they were flown
    return replace(
        rest,
        scenario=with_zones(_with_changes_at(rest.scenario, moves), plan.scenario.no_fly),
        moves=moves,
        leader_trajectory=flight.leader,
        shape=flight.shape,
        phases=(replace(mission, start_s=at_s), *after),
        begin_state=tuple(plan.leader_trajectory.state(at_s).tolist()),
        used_before=rest_of(plan, at_s).used_before,
    )


def _to_a_stop(plan: Plan, at_s: float, push_mps2: float) -> PlanPace:
    """The pace from the plan's to none: as soon as it may, outside a scheduled change of shape."""
    braking_s, mission = _changing_s(plan, at_s, 1.0, push_mps2), plan.phase(PhaseKind.MISSION)
    stop_s = at_s + sum(span[0] for span in _until_reshaped(plan, at_s)) + 0.5 * braking_s
    for move in plan.scheduled_moves:
        if move.start_s < stop_s < move.end_s:
            stop_s = move.end_s
    if stop_s >= mission.end_s:
        raise Infeasible(f"the plan arrives at t = {mission.end_s:.1f} s, before the formation could stand")
    waits_s = stop_s - at_s - 0.5 * braking_s
    return pace(at_s, at_s, [*([(waits_s, 1.0, 1.0)] if waits_s > 0.0 else []), (braking_s, 1.0, 0.0)])


def _until_reshaped(plan: Plan, at_s: float) -> list[tuple[float, float, float]]:
    """The pace of the plan while vehicles fly to other places: the law of such a change knows no other."""
    ends = [m.end_s for m in plan.scheduled_moves if m.kind == "reshape" and m.start_s < at_s < m.end_s]
    return [(end_s - at_s, 1.0, 1.0) for end_s in ends]


def _changing_s(plan: Plan, at_s: float, by: float, push_mps2: float) -> float:
    """How long the rate takes to change by a share of the speeds ahead."""
    t_s = np.linspace(at_s, min(at_s + _AHEAD_S, plan.phase(PhaseKind.MISSION).end_s), 17)
    fastest_mps = float(np.linalg.norm(plan.states(t_s)[..., VELOCITY], axis=2).max())
    return max(fastest_mps * abs(by) * STEEPEST / push_mps2, _SHORTEST_S)


def _old_end_s(kept: PlanPace) -> float:
    return float(kept.old_s(kept.end_s)[0])


def _new_s(kept: PlanPace, old_s: float) -> float:
    """When the new plan is where the old one was, also before and after the span of the pace."""
    first_s, last_s = float(kept.old_s(kept.start_s)[0]), _old_end_s(kept)
    if old_s <= first_s:
        return kept.start_s - (first_s - old_s)
    return kept.end_s + (old_s - last_s) if old_s >= last_s else float(kept.new_s(np.array([old_s]))[0])


def _moves(plan: Plan, new_s: Callable[[float], float]) -> tuple[Move, ...]:
    return tuple(replace(m, start_s=new_s(m.start_s), end_s=new_s(m.end_s)) for m in plan.moves)


def _with_changes_at(scenario: Scenario, moves: Sequence[Move]) -> Scenario:
    """The scenario with the changes of these moves alone, at their times, and those that need none."""
    starts = iter(move.start_s for move in moves if move.trigger != AUTO)
    changes = []
    for change in scenario.formation.change:
        if change.auto:
            changes.append(change)
        elif (at_s := next(starts, None)) is not None:
            update = {"gate_m": None, "at_point": None, "done_at_s": None, "at_s": at_s}
            changes.append(change.model_copy(update=update))
    formation = scenario.formation.model_copy(update={"change": tuple(changes)})
    return scenario.model_copy(update={"formation": formation})


def _at_pace(plan: Plan, kept: PlanPace) -> Plan:
    """The rest of a plan, at a pace while that lasts, then at its own. Times and speeds of its points do not count."""
    old_s, last_s = float(kept.old_s(kept.start_s)[0]), _old_end_s(kept)
    rest, end_s = rest_of(plan, old_s), plan.phase(PhaseKind.MISSION).end_s
    last_s = end_s if abs(end_s - last_s) < _JUST * max(end_s, 1.0) else last_s
    later_s = kept.end_s - last_s

    def new_s(t_s: float) -> float:
        return t_s + later_s if t_s >= last_s else _new_s(kept, t_s)

    moves = _moves(plan, new_s)
    arrives_s = new_s(end_s)
    points = tuple(
        point.model_copy(update={"at_s": None, "after_s": None, "by_s": None, "speed_mps": None})
        for point in rest.scenario.route
    )
    timing = rest.scenario.time.model_copy(update={"flight_s": arrives_s, "free": False})
    scenario = _with_changes_at(with_times_of_changes(rest.scenario, plan), moves)
    after = trajectory_part(plan.leader_trajectory, last_s, plan.t_end_s)
    ends = kept.end_s, new_s(plan.t_end_s)
    part = _joined(
        [
            _Part(paced(plan.leader_trajectory, kept, plan.quadrotor), paced_shape(plan.shape, kept)),
            _Part(
                Trajectory(moved(after.state, *ends), moved(after.control, *ends)),
                moved_shape(shape_part(plan.shape, last_s, plan.t_end_s), *ends),
            ),
        ]
    )
    phases = tuple(replace(p, start_s=new_s(p.start_s), end_s=new_s(p.end_s)) for p in rest.phases)
    return replace(
        rest,
        scenario=scenario.model_copy(update={"time": timing, "route": points}),
        leader_trajectory=part.leader,
        shape=part.shape,
        phases=(replace(phases[0], start_s=kept.start_s), *phases[1:]),
        moves=moves,
        route_s=tuple(map(new_s, rest.route_s)),
    )


def _until_rest(plan: Plan, at_s: float, left: Left | None) -> list[_Part]:
    """What is flown from `at_s` until the plan stands, where it has been stopped."""
    if left is None or left.rest_s <= at_s:
        return []
    span = at_s, left.rest_s
    return [_Part(trajectory_part(plan.leader_trajectory, *span), shape_part(plan.shape, *span))]


def _stand_at(plan: Plan, at_s: float) -> _Stand:
    state = plan.leader_trajectory.state(at_s)
    return _Stand(at_s, np.asarray(state[POSITION]), float(state[8]), plan.shape.at(at_s))


def _leg(plan: Plan, stand: _Stand, place_ned_m: Array, push_mps2: float) -> _Part:
    """The straight flight of a standing formation to another place of its leader."""
    way = place_ned_m - stand.place_ned_m
    length_m = _length(way)
    ahead, limits = way / length_m, np.array(plan.scenario.limits.speed_ned_mps)
    speed_mps = _CRUISE * float(np.min(limits / np.maximum(np.abs(ahead), 1e-9)))
    speed_mps = min(speed_mps, float(np.sqrt(0.9 * length_m * push_mps2 / STEEPEST)))
    changing_s = max(speed_mps * STEEPEST / push_mps2, _SHORTEST_S)
    speed_mps = min(speed_mps, 0.9 * length_m / changing_s)
    cruise_s = length_m / speed_mps - changing_s
    along = pace(stand.t_s, 0.0, [(changing_s, 0.0, 1.0), (cruise_s, 1.0, 1.0), (changing_s, 1.0, 0.0)])
    end_s = along.end_s

    def motion(t_s: Array) -> MotionJets:
        gone = [along.old_s(t_s.ravel(), nu=order).reshape(t_s.shape) * speed_mps for order in range(5)]
        jets = [ahead[:, None, None] * one for one in gone]
        jets[0] = jets[0] + stand.place_ned_m[:, None, None]
        none = np.zeros(t_s.shape)
        return MotionJets((jets[0], jets[1], jets[2], jets[3], jets[4]), jets[2][2], (stand.yaw_rad + none, none, none))

    spans = [np.linspace(a, b, int(np.ceil(b - a)), endpoint=False) for a, b in pairwise(along.old_s.x.tolist())]
    joints = np.concatenate([*spans, [end_s]])
    return _Part(flown(joints, motion, plan.quadrotor), rigid(stand.offsets_ned_m, stand.t_s, end_s))


def _ending_at(scenario: Scenario, stand: _Stand, end_s: float) -> Scenario:
    """The scenario of a flight that ends at this place."""
    place = tuple((stand.place_ned_m * NED_FROM_UP).tolist())
    end = Boundary(position_m=place, roll_pitch_yaw_deg=(0.0, 0.0, float(np.degrees(stand.yaw_rad))))
    time_table = scenario.time.model_copy(update={"flight_s": end_s, "free": False})
    return scenario.model_copy(update={"end": end, "time": time_table, "route": (), "loops": 1, "survey": None})


def _in_shape(left: Left, offsets_ned_m: Array, plan: Plan) -> Plan:
    """The plan that was left; where the formation has another shape now, in that to its end, as `plan` has it.

    Raises Infeasible where it changes its shape later: those changes are from another one.
    """
    old = left.plan
    if np.abs(old.shape.at(left.at_s) - offsets_ned_m).max() < _SAME_M:
        return old
    if any(end_s > left.at_s for _, end_s in old.shape.moving_s if end_s <= old.landing_s):
        raise Infeasible("the plan changes its shape later, from another one than the formation has now")
    end_s = old.landing_s
    kept = rigid(offsets_ned_m, old.t_start_s, end_s)
    ground = shape_to_ground(old.scenario, offsets_ned_m)[-1:]
    scenario = old.scenario.model_copy(update={"formation": plan.scenario.formation})
    return replace(old, scenario=scenario, shape=joined_shapes([kept, *ground]), moves=plan.moves)


def _joined(parts: Sequence[_Part]) -> _Part:
    return _Part(joined([part.leader for part in parts]), joined_shapes([part.shape for part in parts]))


def _length(way: Array) -> float:
    return float(np.linalg.norm(way))
