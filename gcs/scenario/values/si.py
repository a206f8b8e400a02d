"""A scenario's values in SI units, NED and radians, as all later layers compute with them.

Among them are the accelerations that its vehicle can reach at most, whatever its autopilot is set to.
"""

import math
from typing import NamedTuple

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.autopilots.waypoint_models.navigator import Ability
from gcs.frames import Origin
from gcs.physics.quadrotor import Quadrotor, hover_trim
from gcs.physics.wind import STILL, SteadyWind
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.heightmap import Region
from gcs.scenario.schema.scenario import START_SHAPE, Boundary, ChangeTable, Performance, RoutePoint, Scenario
from gcs.scenario.values.formations import places_up_m, turned
from gcs.types import Array

_ROOM_M = 15.0  # the fence stands 10 m outside of everything
_SHARE = 0.6  # of what physics allows: feedback needs the rest
NED_FROM_UP = np.array([1.0, 1.0, -1.0])
# The peak speed and acceleration of a climb or descent of d in T, in units of d / T and d / T².
STILL_PEAKS, WIND_PEAKS = (15 / 8, 10 / 3**0.5), (35 / 16, 84 * 5**0.5 / 25)


def local_origin(scenario: Scenario) -> Origin:
    """The point on Earth that is (0, 0, 0) of the scenario's local NED frame."""
    return Origin(**scenario.origin.model_dump())


def quadrotor(scenario: Scenario) -> Quadrotor:
    """The physical constants of the scenario's vehicle."""
    return Quadrotor(**scenario.vehicle.model_dump(exclude={"name", "power"}), wind=steady_wind(scenario))


def torque_limits(limits: Performance, arm_m: float) -> tuple[float, float, float]:
    """Largest |U_2|, |U_3|, N, and |U_4|, N m, as Eqs. 1 and 2 have them, whichever way the scenario gives them."""
    if limits.torque is not None:
        return limits.torque
    assert limits.yaw_moment_Nm is not None
    if limits.roll_pitch_force_N is not None:
        return (*limits.roll_pitch_force_N, limits.yaw_moment_Nm)
    assert limits.roll_pitch_moment_Nm is not None
    roll_Nm, pitch_Nm = limits.roll_pitch_moment_Nm
    return roll_Nm / arm_m, pitch_Nm / arm_m, limits.yaw_moment_Nm


def steady_wind(scenario: Scenario) -> SteadyWind:
    """The wind that plans take into account, as the direction in which air moves."""
    wind = scenario.wind
    if wind is None:
        return STILL
    to_rad = np.radians(wind.from_deg) + np.pi
    north, east = wind.speed_mps * np.cos(to_rad), wind.speed_mps * np.sin(to_rad)
    return SteadyWind(float(north), float(east), wind.height_m, wind.shear)


def sysids(scenario: Scenario) -> tuple[int, ...]:
    """System ids in the order of every (V, ...) array; the leader comes where the scenario lists it."""
    return scenario.formation.sysids


def autopilots(scenario: Scenario) -> tuple[Autopilot, ...]:
    """The autopilot of each vehicle, in the order of every (V, ...) array: its own, else that of [mission]."""
    own = {vehicle.sysid: vehicle.autopilot for vehicle in scenario.formation.vehicle}
    return tuple(Autopilot.named(own.get(sysid) or scenario.mission.autopilot) for sysid in sysids(scenario))


def names_autopilots(scenario: Scenario) -> bool:
    """Whether the scenario says of a vehicle which autopilot it runs; all of them are then checked on the link."""
    return any(vehicle.autopilot is not None for vehicle in scenario.formation.vehicle)


def leader_index(scenario: Scenario) -> int:
    """Row of the leader in every (V, ...) array."""
    return sysids(scenario).index(scenario.formation.leader)


def offsets_ned_m(scenario: Scenario) -> Array:
    """Position of each vehicle relative to the leader at t = 0 (V, 3): minus Eq. 22's [x_i1, y_i1, z_i1]."""
    formation = scenario.formation
    if formation.start_shape is not None:
        return shape_offsets_ned_m(scenario, formation.start_shape)
    position = np.array([v.position_m for v in formation.vehicle]) * NED_FROM_UP
    return np.asarray(position - position[leader_index(scenario)])


def shape_offsets_ned_m(scenario: Scenario, name: str) -> Array:
    """Places (V, 3) of a named shape relative to the leader's place in it, in the order of the vehicles.

    A generator's first place is the leader's; the others are taken in order.
    """
    formation = scenario.formation
    if name == START_SHAPE:
        return offsets_ned_m(scenario)
    shape = next(shape for shape in formation.shape if shape.name == name)
    leader = leader_index(scenario)
    if shape.generator is None:
        places = np.array(shape.offsets_m)
    else:
        assert shape.spacing_m is not None
        generated = places_up_m(shape.generator, len(formation.sysids), shape.spacing_m)
        if shape.heading_deg is not None:
            generated = turned(generated, shape.heading_deg)
        places = np.insert(generated[1:], leader, generated[0], axis=0)
    return np.asarray((places - places[leader]) * NED_FROM_UP)


def ground_step_peaks(scenario: Scenario) -> tuple[float, float]:
    """The peak speed and acceleration of a climb or descent of d in T, in units of d / T and d / T².

    In still air it is a quintic. In wind the vehicle tilts, so it is a septic, which has no jerk at its ends.
    """
    return STILL_PEAKS if steady_wind(scenario).is_still else WIND_PEAKS


def ground_step_jerk_peak(scenario: Scenario) -> float:
    """The peak jerk of a climb or descent of d in T, in units of d / T³."""
    return 60.0 if steady_wind(scenario).is_still else 52.5


def heading_ref_deg(scenario: Scenario) -> float:
    """The desired heading psi_r, degrees: that of [objective], else the yaw of [end]."""
    heading_deg = scenario.objective.heading_ref_deg
    return scenario.end.roll_pitch_yaw_deg[2] if heading_deg is None else heading_deg


def height_ref_m(scenario: Scenario) -> float:
    """The desired height h_r, m above height 0: that of [objective], else the height of [end]."""
    height_m = scenario.objective.height_ref_m
    return scenario.end.position_m[2] if height_m is None else height_m


def boundary_state(scenario: Scenario, boundary: Boundary) -> Array:
    """Leader's state (12,) at one end, at rest in attitude (body rates are not in Eqs. 15, 16).

    In a hover in wind, roll and pitch are the trim against the wind; those of the scenario are ignored.
    """
    attitude = np.radians(boundary.roll_pitch_yaw_deg)
    vehicle = quadrotor(scenario)
    if not any(boundary.velocity_mps) and not vehicle.wind.is_still:
        _, attitude[0], attitude[1] = hover_trim(boundary.position_m[2], float(attitude[2]), vehicle)
    place, velocity = (np.array(part) * NED_FROM_UP for part in (boundary.position_m, boundary.velocity_mps))
    return np.concatenate([place, velocity, attitude, np.zeros(3)])


def route_points(scenario: Scenario) -> tuple[RoutePoint, ...]:
    """The points between start and end in the order in which the leader passes them, round after round."""
    return scenario.route * scenario.loops


def with_changes_of_route(scenario: Scenario) -> Scenario:
    """The scenario with the shapes of its [[route]] as changes that begin at the points, in every round."""
    changes = [
        ChangeTable(kind="reshape", to=point.shape, at_point=number)
        for number, point in enumerate(route_points(scenario), start=1)
        if point.shape is not None
    ]
    if not changes:
        return scenario
    formation = scenario.formation.model_copy(update={"change": (*scenario.formation.change, *changes)})
    route = tuple(point.model_copy(update={"shape": None}) for point in scenario.route)
    return scenario.model_copy(update={"formation": formation, "route": route})


def hover_start_ned_m(scenario: Scenario) -> Array:
    """Where each vehicle hovers before the run-up (V, 3): behind its place at t = 0, at the same height."""
    velocity = np.array(scenario.start.velocity_mps) * NED_FROM_UP
    horizontal = np.hypot(velocity[0], velocity[1])
    back = np.zeros(3)
    if horizontal > 0:
        back[:2] = velocity[:2] / horizontal * scenario.ground_phases.run_up_m
    start = np.array(scenario.start.position_m) * NED_FROM_UP
    return np.asarray(start - back + offsets_ned_m(scenario))


def ground_needed(scenario: Scenario) -> Region:
    """The region whose ground the plan, take-off, landing and fence may need: box, hovers, ends, and a margin."""
    limits, offsets = scenario.limits, offsets_ned_m(scenario)
    ends = [np.array(b.position_m) * NED_FROM_UP + offsets for b in (scenario.start, scenario.end)]
    places = np.concatenate([hover_start_ned_m(scenario), *ends])[:, :2]
    low = np.minimum(places.min(axis=0), [limits.north_m[0], limits.east_m[0]]) - _ROOM_M
    high = np.maximum(places.max(axis=0), [limits.north_m[1], limits.east_m[1]]) + _ROOM_M
    return Region((float(low[0]), float(high[0])), (float(low[1]), float(high[1])))


def pads_ned_m(scenario: Scenario) -> Array:
    """Ground point each vehicle takes off from (V, 3): straight below its first hover."""
    return _on_ground(scenario, hover_start_ned_m(scenario))


def landing_points_ned_m(scenario: Scenario, offsets: Array | None = None) -> Array:
    """Ground point each vehicle lands on (V, 3): below its place at the end, in the start's or another shape."""
    end = np.array(scenario.end.position_m) * NED_FROM_UP
    return _on_ground(scenario, end + (offsets_ned_m(scenario) if offsets is None else offsets))


def _on_ground(scenario: Scenario, position_ned_m: Array) -> Array:
    down = -ground_height_m(scenario.terrain, position_ned_m[:, 0], position_ned_m[:, 1])
    return np.column_stack([position_ned_m[:, :2], down])


class PhysicalLimits(NamedTuple):
    """What thrust, tilt and rotors allow: the bounds of every manoeuvre."""

    sideways_mps2: float  # the horizontal part of full thrust at constant height, or of the tilt limit
    upwards_mps2: float  # thrust beyond the weight
    tilt_rate_radps: float
    tilt_accel_radps2: float


def physical_limits(vehicle: Quadrotor, limits: Performance) -> PhysicalLimits:
    """The limits of one type of vehicle.

    A quadrotor accelerates sideways by tilting: its jerk is at most g times the tilt rate, its snap g times the tilt
    acceleration that its rotors produce, arm * U2 / I.
    """
    g = vehicle.gravity_mps2
    surplus = limits.thrust_N[1] / vehicle.weight_N
    sideways = g * math.sqrt(max(surplus * surplus - 1.0, 0.01))
    torque = torque_limits(limits, vehicle.arm_m)
    tilt = g * math.tan(math.radians(min(limits.roll_pitch_yaw_deg[:2])))
    tilt_accel = min(vehicle.arm_m * torque[axis] / vehicle.inertia_kgm2[axis] for axis in (0, 1))
    tilt_rate = math.radians(min(limits.rates_degps[:2]))
    return PhysicalLimits(min(sideways, tilt), g * (surplus - 1.0), tilt_rate, tilt_accel)


def ability_of(vehicle: Quadrotor, limits: Performance) -> Ability:
    """The share of the physical limits that navigation models may use."""
    g, most = vehicle.gravity_mps2, physical_limits(vehicle, limits)
    return Ability(
        horizontal_mps2=_SHARE * most.sideways_mps2,
        vertical_mps2=_SHARE * max(most.upwards_mps2, 0.1),
        horizontal_mps3=g * most.tilt_rate_radps,
        horizontal_mps4=_SHARE * g * most.tilt_accel_radps2,
    )
