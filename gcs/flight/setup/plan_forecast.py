"""What another plan would cost, in words and numbers, beside the plan that is flown."""

import math

import numpy as np

from gcs.flight.monitoring.progress import PlanForecast
from gcs.physics.states import POSITION
from gcs.plan.plan_changer import Proposal
from gcs.plan.replanning.plan_pieces import continued
from gcs.plan.trajectory.energy import battery_model
from gcs.plan.trajectory.plan import Plan

_STEP_S = 0.5
_SAME_S, _SAME_M, _SAME_PCT = 0.1, 0.1, 0.1


def forecast_of(old: Plan, found: Proposal) -> PlanForecast:
    """Return what a verified proposal changes of the plan `old`, from its begin to the landing."""
    new = found.plan
    t_s = np.arange(new.t_start_s, new.landing_s, _STEP_S)
    before_s = np.arange(new.t_start_s, old.landing_s, _STEP_S)
    places, before = new.states(t_s)[..., POSITION], old.states(before_s)[..., POSITION]
    words = [
        f"verified; a plan from t = {new.t_start_s:.1f} s on",
        f"landing {_more(new.landing_s - old.landing_s, 's', 'later', 'earlier', _SAME_S)}",
        f"way of the longest {_more(_length_m(places) - _length_m(before), 'm', 'longer', 'shorter', _SAME_M)}",
    ]
    needs_pct = [_needed_pct(plan) for plan in (continued(old, new), old)]
    if all(map(math.isfinite, needs_pct)):
        words.append(f"battery {_more(needs_pct[0] - needs_pct[1], '%', 'more', 'less', _SAME_PCT)}")
    if len(new.sysids) > 1:
        least_m = [float(one.separations_m(at).min()) for one, at in ((new, t_s), (old, before_s))]
        words.append(f"least separation {least_m[0]:.1f} m (of the old plan {least_m[1]:.1f} m)")
    words.append(f"planned in {found.took_s:.1f} s")
    return PlanForecast(", ".join(words), t_s, places)


def _more(difference: float, unit: str, more: str, less: str, same: float) -> str:
    if abs(difference) < same:
        return "the same"
    return f"{abs(difference):.1f} {unit} {more if difference > 0.0 else less}"


def _length_m(places_ned_m: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(places_ned_m, axis=1), axis=2).sum(axis=1).max())


def _needed_pct(plan: Plan) -> float:
    """Of a full battery, for the whole flight, of the vehicle that needs most; NaN where it is not known."""
    model = battery_model(plan)
    return math.nan if model.full_J is None else 100.0 * float(model.used[:, -1].max())
