"""The margin of every constraint at any instants: Eqs. 17-25 and 51 on plain arrays, over the exact ground.

The mesh is refined where they are negative. The replanner and the common return judge their motions by them.
"""

from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import control_from_rotors, derivative, rotors_from_control
from gcs.physics.states import ATTITUDE, RATES, VELOCITY
from gcs.plan.trajectory.constraint_id import CONTROLS, STATES, ConstraintId, Kind
from gcs.scenario.environment.ground_distance import ground_distance_m
from gcs.scenario.environment.no_fly import outside_m, zone_names, zones
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import quadrotor, torque_limits
from gcs.types import Array

# Below this speed the direction of flight, and with it the turning radius of Eq. 18, loses its meaning.
REST_SPEED_MPS = 0.1
# A formation that turns with its course must face where it flies above this speed.
COURSE_SPEED_MPS = 1.0
NEAR_M = 1.0  # more than a vehicle flies within a step of the check


@dataclass(frozen=True)
class Margin:
    """One constraint at N instants for V vehicles: value >= 0 where it is satisfied."""

    constraint: ConstraintId
    unit: str
    value: Array  # (V, N)
    scale: float  # size of the limit: "to 0.1 %" refers to it

    @property
    def name(self) -> str:
        """The constraint, for messages."""
        return str(self.constraint)


def clearance(scenario: Scenario, states: Array, within_m: float = NEAR_M) -> Margin:
    """Distance to the exact ground (Eqs. 20, 23, 52, 53) minus h_min; states or positions (V, N, 3 or more).

    The distance is that in any direction. Larger margins than `within_m` count as that: from far away exact distances
    take long, and nobody needs them.
    """
    north, east, up = states[..., 0], states[..., 1], -states[..., 2]
    least = scenario.limits.clearance_min_m
    away = ground_distance_m(scenario.terrain, north, east, up, least + within_m)
    return Margin(ConstraintId(Kind.CLEARANCE), "m", away - least, least)


def box(scenario: Scenario, states: Array) -> list[Margin]:
    """Margins of the x-y box of Eq. 51."""
    limits = scenario.limits
    return [
        _between(kind, "m", states[..., axis], *bounds)
        for axis, (kind, bounds) in enumerate(((Kind.NORTH, limits.north_m), (Kind.EAST, limits.east_m)))
    ]


def height(scenario: Scenario, states: Array, *, to_the_ground: bool = False) -> Margin:
    """Margin of the height limits of Eq. 51 (V, N, 3 or more); `to_the_ground` leaves out the lower one."""
    low_m, high_m = scenario.limits.height_m
    return _between(Kind.HEIGHT, "m", -states[..., 2], -np.inf if to_the_ground else low_m, high_m)


def state_limits(scenario: Scenario, states: Array) -> list[Margin]:
    """Margins of speeds, attitude and rates (Eq. 51)."""
    limits = scenario.limits
    margins: list[Margin] = []
    for columns, unit, values, bounds in (
        (VELOCITY, "m/s", states[..., VELOCITY], limits.speed_ned_mps),
        (ATTITUDE, "deg", np.degrees(states[..., ATTITUDE]), limits.roll_pitch_yaw_deg),
        (RATES, "deg/s", np.degrees(states[..., RATES]), limits.rates_degps),
    ):
        margins += [
            Margin(ConstraintId(kind), unit, bound - np.abs(values[..., i]), bound)
            for i, (kind, bound) in enumerate(zip(STATES[columns], bounds, strict=True))
        ]
    return margins


def control_limits(scenario: Scenario, controls: Array) -> list[Margin]:
    """Margins of U1..U4 (Eq. 51), and whether rotors reach the speeds that Eq. 2 requires."""
    limits, torque = scenario.limits, torque_limits(scenario.limits, scenario.vehicle.arm_m)
    margins = [_between(Kind.U1, "N", controls[..., 0], *limits.thrust_N)]
    margins += [
        Margin(ConstraintId(kind), unit, bound - np.abs(controls[..., i]), bound)
        for i, (kind, unit, bound) in enumerate(zip(CONTROLS[1:], ("N", "N", "N m"), torque, strict=True), start=1)
    ]
    vehicle = quadrotor(scenario)
    reached = control_from_rotors(rotors_from_control(controls, vehicle), vehicle)
    # Each control against its own limit: a yaw moment is hundreds of times smaller than a thrust.
    shortfall = np.max(np.abs(reached - controls) / [limits.thrust_N[1], *torque], axis=-1)
    return [*margins, Margin(ConstraintId(Kind.ROTOR_SPEED), "of a control's limit", -shortfall, 1.0)]


def turning(scenario: Scenario, states: Array, controls: Array) -> Margin:
    """Normal acceleration in the horizontal plane against n_max g (Eq. 17, Eq. 18, Eq. 25), per vehicle."""
    vehicle = quadrotor(scenario)
    acceleration = derivative(states, controls, vehicle)[..., VELOCITY]
    vx, vy = states[..., 3], states[..., 4]
    speed = np.hypot(vx, vy)
    normal = np.abs(vx * acceleration[..., 1] - vy * acceleration[..., 0]) / np.maximum(speed, REST_SPEED_MPS)
    bound = scenario.limits.load_factor_max
    return Margin(ConstraintId(Kind.TURNING), "g", bound - normal / vehicle.gravity_mps2, bound)


def acceleration(scenario: Scenario, states: Array, controls: Array) -> list[Margin]:
    """Acceleration of every vehicle against a_max, where the scenario has one."""
    most = scenario.limits.accel_max_mps2
    if most is None:
        return []
    moved = derivative(states, controls, quadrotor(scenario))[..., VELOCITY]
    return [Margin(ConstraintId(Kind.ACCELERATION), "m/s2", most - np.linalg.norm(moved, axis=-1), most)]


def jerk(scenario: Scenario, jerks: Array) -> list[Margin]:
    """Jerk (V, N, 3) of every vehicle against j_max, where the scenario has one."""
    most = scenario.limits.jerk_max_mps3
    if most is None:
        return []
    return [Margin(ConstraintId(Kind.JERK), "m/s3", most - np.linalg.norm(jerks, axis=-1), most)]


def shape_motion(scenario: Scenario, speeds: Array, accelerations: Array) -> list[Margin]:
    """Motion of every vehicle within the shape (V, N, 3) against v_max and a_max of a change."""
    formation = scenario.formation
    return [
        Margin(ConstraintId(kind), unit, most - np.linalg.norm(motion, axis=-1), most)
        for kind, unit, motion, most in (
            (Kind.SHAPE_SPEED, "m/s", speeds, formation.change_speed_mps),
            (Kind.SHAPE_ACCELERATION, "m/s2", accelerations, formation.change_accel_mps2),
        )
    ]


def course(scenario: Scenario, velocities: Array, headings_rad: Array) -> Margin:
    """Heading of the formation (N,) against its course (1, N) from velocities (N, 3); free below 1 m/s."""
    most_deg = scenario.formation.course_tolerance_deg
    north, east = velocities[:, 0], velocities[:, 1]
    away = np.angle(np.exp(1j * (np.arctan2(east, north) - headings_rad)))
    off_deg = np.where(np.hypot(north, east) > COURSE_SPEED_MPS, np.degrees(np.abs(away)), 0.0)
    return Margin(ConstraintId(Kind.COURSE), "deg", (most_deg - off_deg)[None], most_deg)


def no_fly(scenario: Scenario, states: Array, t_s: Array) -> list[Margin]:
    """Distance from every zone (Eqs. 21, 24), negative inside. Zones may move: t_s (N,) are the plan times."""
    return [
        Margin(ConstraintId(Kind.ZONE, of=name), "m", outside_m(zone, t_s, states[..., 0], states[..., 1]), 1.0)
        for name, zone in zip(zone_names(scenario), zones(scenario), strict=True)
    ]


def _between(kind: Kind, unit: str, values: Array, low: float, high: float) -> Margin:
    scale = max(abs(bound) for bound in (low, high) if np.isfinite(bound))
    return Margin(ConstraintId(kind), unit, np.minimum(values - low, high - values), scale)
