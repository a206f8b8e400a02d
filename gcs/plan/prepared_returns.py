"""Returns of a whole formation, prepared for instants along its plan: pressing *return* begins the next of them."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gcs.errors import PlanningError, UsageError
from gcs.plan.formation_return import plan_return
from gcs.plan.replanning.parametric_nlp import with_zones
from gcs.plan.trajectory.energy import charge_needed, used_until
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.types import Array
from gcs.util.long_work import report

EVERY_S = 10.0
_LATEST = 1e-3  # s before the landing


@dataclass(frozen=True)
class PreparedReturn:
    """The return that begins at one instant of a plan, or the reason why there is none."""

    begins_s: float  # plan time
    plan: Plan | None
    why_not: str = ""
    cpu_s: float = 0.0  # that it took to plan and to verify it

    @property
    def duration_s(self) -> float:
        """From its begin to the last touch-down, s. Raises ValueError where there is no return."""
        return self._plan.t_end_s - self.begins_s

    @property
    def charge(self) -> Array:
        """The share of a full battery that each vehicle (V,) needs from its begin. Raises ValueError without one."""
        return charge_needed(self._plan)

    @property
    def _plan(self) -> Plan:
        if self.plan is None:
            raise ValueError(f"there is no return from t = {self.begins_s:g} s: {self.why_not}")
        return self.plan


@dataclass(frozen=True)
class PreparedReturns:
    """The returns of one plan, in order of time."""

    returns: tuple[PreparedReturn, ...]

    def at(self, t_s: float) -> PreparedReturn | None:
        """The return that begins next at or after `t_s`, s; None where none is ahead.

        The formation flies its plan until that instant and goes over to the return there without a jump of position,
        velocity, acceleration or shape. So the distance of the instants bounds the wait.
        """
        return next(iter(self.from_on(t_s)), None)

    def from_on(self, t_s: float) -> tuple[PreparedReturn, ...]:
        """The returns that begin at or after `t_s`, s, the next one first."""
        found = [each for each in self.returns if each.plan is not None]
        return tuple(found[bisect_left([each.begins_s for each in found], t_s) :])

    @property
    def longest_wait_s(self) -> float:
        """The longest time from an instant within the table to the next return, s; infinite without returns."""
        begins = [each.begins_s for each in self.returns if each.plan is not None]
        first_s = self.returns[0].begins_s if self.returns else 0.0
        return float(np.diff([first_s, *begins]).max()) if begins else np.inf


def begun_from(flown: Plan, one: PreparedReturn) -> Plan:
    """A return as the rest of the plan that is flown: with the zones that came up, and with what was flown before.

    It is neither verified nor known to begin where the flown plan is then. Raises ValueError where there is none.
    """
    made = one._plan
    scenario = with_zones(made.scenario, flown.scenario.no_fly)
    return replace(made, scenario=scenario, used_before=used_until(flown, one.begins_s))


def prepare_returns(
    plan: Plan, every_s: float = EVERY_S, on_return: Callable[[PreparedReturn], None] = lambda _: None
) -> PreparedReturns:
    """Plan and verify a return of the formation for every `every_s` seconds of a plan, from take-off to landing.

    An instant from which there is none has the reason instead, also where a time limit has passed. `on_return` is
    called after each. Raises UsageError for a distance that is not above 0.
    """
    if not every_s > 0.0:
        raise UsageError(f"every {every_s:g} s is no distance of returns", hint="give seconds above 0, for example 10")
    found: list[PreparedReturn] = []
    near: Plan | None = None
    instants = np.arange(plan.airborne_s, plan.landing_s - _LATEST, every_s).tolist()
    for number, t_s in enumerate(instants):
        began_s = time.process_time()
        try:
            report(f"planning returns: {number} of {len(instants)} instants done")
            made = plan_return(plan, t_s, near)
            verify(made)
            one = PreparedReturn(t_s, made, cpu_s=time.process_time() - began_s)
            near = made
        except PlanningError as failure:
            one = PreparedReturn(t_s, None, failure.reason, time.process_time() - began_s)
        found.append(one)
        on_return(one)
    return PreparedReturns(tuple(found))
