"""The landing of a plan: as long as [ground_phases] landing_s says, else the descent of the vehicles' autopilots.

Autopilots land at speeds of their own, slowly near the ground. A plan that descends likewise ends as they touch down.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from gcs.autopilots.columns import LandingProfile, ReturnSettings
from gcs.autopilots.traits import Autopilot
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values import si

_OF_LIMIT = 0.98  # of the largest vertical speed
_OF_THRUST = 0.5  # of the spare one, for changes of speed
# The peak acceleration and jerk of a smooth change of speed by dv in T, in units of dv / T and dv / T².
_RAMP_PEAK, _RAMP_JERK = si.WIND_PEAKS
_STOP_S = 0.5  # a plan comes to rest on the ground, an autopilot meets it at its speed
_LEAST_S, _LEVEL_S = 1.0, 0.3
_SHARES = (0.25, 0.5, 0.75, 1.0)


class SpeedRamp(NamedTuple):
    """A part of a descent, in which the speed changes smoothly from one value to another, or stays."""

    duration_s: float
    from_mps: float
    to_mps: float

    @property
    def drop_m(self) -> float:
        """The height that it takes."""
        return self.duration_s * (self.from_mps + self.to_mps) / 2.0


def own_landing(scenario: Scenario) -> tuple[SpeedRamp, ...]:
    """The descent of the autopilot that takes longest; empty where landing_s is given, or the height is too small."""
    if scenario.ground_phases.landing_s is not None:
        return ()
    found = [_ramps(scenario, autopilot, fall_m) for autopilot, fall_m in _falls(scenario)]
    return max(found, key=_whole_s) if all(found) else ()


def landing_s(scenario: Scenario) -> float:
    """The length of the landing phase, s."""
    if (given := scenario.ground_phases.landing_s) is not None:
        return given
    if ramps := own_landing(scenario):
        return _rounded(_whole_s(ramps))
    most_mps = scenario.limits.speed_ned_mps[2]
    mean_mps = _OF_LIMIT * most_mps / si.ground_step_peaks(scenario)[0]
    return max(landing_duration_s(one, fall_m, most_mps, mean_mps) for one, fall_m in _falls(scenario))


def landing_duration_s(autopilot: Autopilot, fall_m: float, vertical_mps: float, mean_mps: float = math.inf) -> float:
    """The time in which an autopilot lands from a height above the ground, with a mean speed of at most `mean_mps`."""
    own_s = _profile(autopilot, vertical_mps).duration_s(max(fall_m, 0.0), 0.0)
    return _rounded(max(own_s, fall_m / mean_mps, _LEAST_S))


def _whole_s(ramps: tuple[SpeedRamp, ...]) -> float:
    return sum(ramp.duration_s for ramp in ramps)


def _rounded(duration_s: float) -> float:
    """Up to a tenth: the same on every machine."""
    return math.ceil(10.0 * duration_s - 1e-6) / 10.0


def _falls(scenario: Scenario) -> list[tuple[Autopilot, float]]:
    """The largest descent under each autopilot, in any shape in which the flight may end, m."""
    formation = scenario.formation
    names = {change.to for change in formation.change} | {point.shape for point in scenario.route}
    shapes = [si.offsets_ned_m(scenario), *(si.shape_offsets_ned_m(scenario, name) for name in names if name)]
    end_ned_m = np.array(scenario.end.position_m) * si.NED_FROM_UP
    falls_m = np.max([(si.landing_points_ned_m(scenario, each) - end_ned_m - each)[:, 2] for each in shapes], axis=0)
    every = si.autopilots(scenario)
    return [(one, float(np.max(falls_m[[each is one for each in every]]))) for one in dict.fromkeys(every)]


def _profile(autopilot: Autopilot, vertical_mps: float) -> LandingProfile:
    """Its profile with the parameters of an upload, in which returns sink at the plan's largest vertical speed."""
    returns, landing = autopilot.traits.returns, autopilot.traits.landing
    wanted = ReturnSettings(10.0, 1.0, vertical_mps, vertical_mps, 0.0, 100.0, 10.0)
    set_values = dict(returns.parameters(wanted))
    return landing.profile({name: float(set_values[name]) for name in landing.parameters if name in set_values})


class _Cruise(NamedTuple):
    """A speed that a descent keeps, and between which heights it slows down from this one to the next lower one."""

    mps: float
    slower_high_m: float = 0.0
    slower_low_m: float = 0.0


def _cruises(profile: LandingProfile, most_mps: float) -> list[_Cruise]:
    """The speeds that a profile keeps, lowest first."""
    speeds = [min(speed, most_mps) for speed in profile.speeds_mps]
    found, top_m = [_Cruise(speeds[0])], profile.heights_m[0]  # where the last one ends
    for n, (height_m, mps) in enumerate(zip(profile.heights_m, speeds, strict=True)):
        is_last = n == len(speeds) - 1
        if mps == found[-1].mps:
            top_m = height_m
        elif is_last or speeds[n + 1] == mps:
            found.append(_Cruise(mps, height_m, top_m))
            top_m = height_m
    return found


def _ramps(scenario: Scenario, autopilot: Autopilot, fall_m: float) -> tuple[SpeedRamp, ...]:
    """The descent from a height, with changes of speed that thrust suffices for; empty where there is no room for them.

    A change of speed ends where the profile's does: one that takes longer begins higher.
    """
    vertical_mps = scenario.limits.speed_ned_mps[2]
    spare_mps2, jerk_mps3 = _spare_mps2(scenario), scenario.limits.jerk_max_mps3 or math.inf

    def change_s(by_mps: float, usual_s: float) -> float:
        by_thrust_s = _RAMP_PEAK * by_mps / (_OF_THRUST * spare_mps2)
        return max(usual_s, by_thrust_s, math.sqrt(_RAMP_JERK * by_mps / (_OF_LIMIT * jerk_mps3)))

    profile = _profile(autopilot, vertical_mps)
    cruises = _cruises(profile, _OF_LIMIT * vertical_mps)
    stop = SpeedRamp(change_s(cruises[0].mps, _STOP_S), cruises[0].mps, 0.0)
    below, from_m = [stop], stop.drop_m  # the parts up to the height `from_m`, in reverse order

    def begun(fast_mps: float, below: list[SpeedRamp], from_m: float) -> tuple[SpeedRamp, ...]:
        begin = SpeedRamp(change_s(fast_mps, 2.0 * profile.delay_s), 0.0, fast_mps)
        level = SpeedRamp((fall_m - begin.drop_m - from_m) / fast_mps, fast_mps, fast_mps)
        return tuple(reversed([*below, level, begin])) if level.duration_s > _LEVEL_S else ()

    best = begun(cruises[0].mps, below, from_m)
    for slower, cruise in pairwise(cruises):
        slow_mps = slower.mps
        level = SpeedRamp((cruise.slower_low_m - from_m) / slow_mps, slow_mps, slow_mps)
        for share in _SHARES if level.duration_s > 0.0 else ():  # of the change of speed, where it begins low
            fast_mps = slow_mps + share * (cruise.mps - slow_mps)
            usual_s = 2.0 * share * (cruise.slower_high_m - cruise.slower_low_m) / (slow_mps + fast_mps)
            change = SpeedRamp(change_s(fast_mps - slow_mps, usual_s), fast_mps, slow_mps)
            quick = [*below, level, change], cruise.slower_low_m + change.drop_m
            best = begun(fast_mps, *quick) or best
        if level.duration_s <= _LEVEL_S:
            break
        below, from_m = quick
    return best


def _spare_mps2(scenario: Scenario) -> float:
    """The vertical acceleration for which thrust suffices, in the scenario's wind."""
    limits, vehicle = scenario.limits, si.quadrotor(scenario)
    sideways_N = float(np.hypot(*np.multiply(vehicle.wind.at(limits.height_m[1]), vehicle.drag_Nspm)[:2]))
    upwards_N = max(limits.thrust_N[1] ** 2 - sideways_N**2, 0.0) ** 0.5
    spare_mps2 = max(upwards_N / vehicle.mass_kg - vehicle.gravity_mps2, 0.01)
    return min(float(spare_mps2), math.inf if limits.accel_max_mps2 is None else limits.accel_max_mps2)
