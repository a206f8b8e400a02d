"""A plan that changed in flight: the pieces in which it was flown, as one plan; what must be continuous between two."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs.errors import PlanningError
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation.shape import joined as joined_shapes
from gcs.plan.replanning.formation_rest import with_empty_places
from gcs.plan.replanning.remaining_plan import shape_part, trajectory_part
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import joined
from gcs.scenario.environment.no_fly import zones

# Of a vehicle that changes from one plan to the next. Attitude is continuous, so that only its thrust may step: the
# optimiser is free to choose it from the first instant on.
POSITION_M, VELOCITY_MPS, ACCELERATION_MPS2 = 0.01, 0.01, 1.0


@dataclass(frozen=True)
class Jump:
    """The largest difference between two plans at one instant, of any vehicle: m, m/s, m/s^2."""

    position_m: float
    velocity_mps: float
    acceleration_mps2: float

    @property
    def allowed(self) -> bool:
        """Whether vehicles may change from one plan to the other at this instant."""
        return (
            self.position_m <= POSITION_M
            and self.velocity_mps <= VELOCITY_MPS
            and self.acceleration_mps2 <= ACCELERATION_MPS2
        )

    def __str__(self) -> str:
        return f"{self.position_m:.3f} m, {self.velocity_mps:.3f} m/s, {self.acceleration_mps2:.2f} m/s²"


def jump_between(old: Plan, new: Plan) -> Jump:
    """What jumps where `new` begins, of its vehicles; the place of each includes the shape."""
    at_s, rows = np.array([new.t_start_s]), [old.sysids.index(sysid) for sysid in new.sysids]
    before, after = old.states(at_s)[rows, 0], new.states(at_s)[:, 0]
    position, velocity = (np.linalg.norm((after - before)[:, part], axis=1).max() for part in (POSITION, VELOCITY))
    pushes = old.accelerations(at_s - 1e-6)[rows, 0], new.accelerations(at_s)[:, 0]
    return Jump(float(position), float(velocity), float(np.linalg.norm(pushes[1] - pushes[0], axis=1).max()))


def continued(old: Plan, new: Plan) -> Plan:
    """The plan as flown: the old one until the new one begins, which is its rest. It begins where the old one did.

    The zones that only the new one has count from its begin on (`Plan.zones_since_s`), or from when they were given,
    where it says so. Vehicles that only the old one has left the formation: their places stay empty. Raises
    PlanningError where the new one has other vehicles, or the formation would jump.
    """
    at_s = new.t_start_s
    if not set(new.sysids) <= set(old.sysids) or not old.t_start_s < at_s < old.landing_s:
        raise PlanningError(
            f"the plan of vehicles {new.sysids} from t = {at_s:g} s does not continue that of vehicles {old.sysids}",
            hint="a plan is replaced between its take-off and its landing, by one of its vehicles",
        )
    if not (jump := jump_between(old, new)).allowed:
        raise PlanningError(
            f"at t = {at_s:g} s the new plan is {jump} from the old one",
            hint="plan it from the state that the old plan has then",
        )
    new = with_empty_places(old, new)
    before = [phase for phase in old.phases if phase.start_s < at_s and phase.name != PhaseKind.MISSION]
    mission, *after = new.phases
    begun = replace(mission, start_s=old.phase(PhaseKind.MISSION).start_s)
    passed = tuple(t_s for t_s in old.route_s if t_s < at_s and t_s not in new.route_s)
    known, now = len(zones(old.scenario)), len(zones(new.scenario))
    given_s = [min(t_s, at_s) if np.isfinite(t_s) else at_s for t_s in new.zones_since_s[known:]]
    return replace(
        new,
        leader_trajectory=joined([trajectory_part(old.leader_trajectory, old.t_start_s, at_s), new.leader_trajectory]),
        shape=joined_shapes([shape_part(old.shape, old.t_start_s, at_s), new.shape]),
        phases=(*before, begun, *after),
        begin_state=old.begin_state,
        route_s=(*passed, *new.route_s) if len(passed) + len(new.route_s) == len(old.route_s) else new.route_s,
        leg_limits=(),
        used_before=old.used_before,
        zones_since_s=(*(old.zones_since_s or (-np.inf,) * known), *(given_s or (at_s,) * (now - known))),
    )


def in_pieces(first: Plan, pieces: Sequence[Plan]) -> Plan:
    """The plan as flown, of its first piece and those that replaced the rest of it one after another."""
    plan = first
    for piece in pieces:
        plan = continued(plan, piece)
    return plan
