"""The energy that a plan takes from each vehicle's battery, by momentum theory from the planned controls.

Planned controls include climbs, the planned wind and every turn. Gusts, waiting in the air and slower landings are not
in a plan: the reserve covers them, and in flight the measured discharge.
"""

from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import air_density_kgpm3, drawn_power_W, induced_power_W
from gcs.physics.states import ATTITUDE, POSITION, VELOCITY
from gcs.plan.formation.shape import EVERYONE, Rows
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import PreflightTable
from gcs.types import Array

ENDURANCE_S = 900.0  # of hover on a full battery, without [vehicle.power]
_STEP_S = 0.1
_J_PER_WH = 3600.0


def energy_Wh(plan: Plan) -> Array | None:
    """Energy of each vehicle (V,) from take-off to landing, Wh; None where the scenario does not describe rotors."""
    if plan.scenario.vehicle.power is None:
        return None
    t_s, drawn_W = _power_profile_W(plan)
    return np.asarray(np.trapezoid(drawn_W, t_s, axis=-1) / _J_PER_WH)


def charge_needed(plan: Plan, limits: PreflightTable | None = None) -> Array:
    """Return the share of a full battery that the flight needs, per vehicle (V,), without the reserve.

    Without [vehicle.power] it is estimated from the flight's time by `limits`, those of the scenario unless given.
    """
    taken_Wh, power = energy_Wh(plan), plan.scenario.vehicle.power
    if taken_Wh is None or power is None:
        limits = limits or plan.scenario.preflight
        flight_s = plan.t_end_s - plan.t_start_s
        return np.full(len(plan.sysids), flight_s * limits.effort / limits.endurance_s)
    return taken_Wh / power.battery_Wh


def used_until(plan: Plan, t_s: float) -> tuple[float, ...]:
    """Return the shares (V) of a full battery that a plan, and what was flown before it, take until an instant.

    Empty where they are not known: without [vehicle.power], and of a plan that begins in the air and does not say.
    """
    if plan.scenario.vehicle.power is None or (plan.begin_state is not None and not plan.used_before):
        return ()
    model = battery_model(plan)
    used = np.array([np.interp(t_s, model.t_s, row) for row in model.used])
    return tuple(np.clip(used + (plan.used_before or 0.0), 0.0, 1.0).tolist())


@dataclass(frozen=True)
class BatteryModel:
    """The expected use of a full battery, as shares of it.

    `hover_per_s` is the use in hover. `used` (V, N) is what the plan has taken from each vehicle at plan times t_s
    (N,). Without [vehicle.power] a battery hovers for `ENDURANCE_S`, and flight takes as much as hover.
    """

    t_s: Array
    used: Array
    hover_per_s: float
    weight_N: float
    drag_Nspm: Array  # (3,) north, east, down
    full_J: float | None  # None without [vehicle.power]
    figure_of_merit: float

    def planned_use(self, row: int, from_s: float, to_s: float) -> float:
        """Return what the plan takes from a vehicle between two plan times; beyond the plan, hover."""
        begin_s, end_s = float(self.t_s[0]), float(self.t_s[-1])
        at = np.interp([from_s, to_s], self.t_s, self.used[row])
        outside_s = max(min(to_s, begin_s) - from_s, 0.0) + max(to_s - max(from_s, end_s), 0.0)
        return float(at[1] - at[0]) + self.hover_per_s * outside_s

    def use_per_s(self, speed_mps: float, climb_mps: float = 0.0) -> float:
        """Return the use in steady flight: thrust against weight and drag, and the work of a climb."""
        if self.full_J is None:
            return self.hover_per_s
        drag_N = float(max(self.drag_Nspm[:2])) * speed_mps
        lift_N = self.weight_N + float(self.drag_Nspm[2]) * max(climb_mps, 0.0)
        thrust = float(np.hypot(lift_N, drag_N) / self.weight_N) ** 1.5
        climb_W = self.weight_N * max(climb_mps, 0.0) / self.figure_of_merit
        return float(self.hover_per_s * thrust + climb_W / self.full_J)


def battery_model(plan: Plan) -> BatteryModel:
    """Return the model of a plan's vehicles."""
    power, q = plan.scenario.vehicle.power, plan.quadrotor
    weight_N = q.weight_N
    drag = np.asarray(q.drag_Nspm, dtype=np.float64)
    if power is None:
        t_s = np.array([plan.t_start_s, plan.t_end_s])
        used = np.tile((t_s - t_s[0]) / ENDURANCE_S, (len(plan.sysids), 1))
        return BatteryModel(t_s, used, 1.0 / ENDURANCE_S, weight_N, drag, None, 1.0)
    t_s, drawn_W = _power_profile_W(plan)
    full_J = power.battery_Wh * _J_PER_WH
    mean_W = (drawn_W[:, 1:] + drawn_W[:, :-1]) / 2.0
    used = np.concatenate([np.zeros((len(drawn_W), 1)), np.cumsum(mean_W * np.diff(t_s), axis=1)], axis=1) / full_J
    density = float(air_density_kgpm3(plan.scenario.origin.alt_amsl_m))
    hover_W = 4.0 * float(induced_power_W(weight_N / 4.0, power.rotor_radius_m, density)) / power.figure_of_merit
    return BatteryModel(t_s, used, hover_W / full_J, weight_N, drag, full_J, power.figure_of_merit)


def _power_profile_W(plan: Plan) -> tuple[Array, Array]:
    """Plan times (N,), and the power drawn by each vehicle (V, N)."""
    t_s = _instants_s(plan)
    states, controls = plan.motion(np.clip(t_s, plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf)))
    return t_s, _drawn_W(plan, states, controls)


def _instants_s(plan: Plan) -> Array:
    """Plan times (N,) of the integral, from take-off to landing."""
    return np.linspace(plan.t_start_s, plan.t_end_s, max(2, round((plan.t_end_s - plan.t_start_s) / _STEP_S) + 1))


def _drawn_W(plan: Plan, states: Array, controls: Array) -> Array:
    """The power (V, N) that vehicles in states (V, N, 12) draw at controls (V, N, 4)."""
    power = plan.scenario.vehicle.power
    assert power is not None
    density = air_density_kgpm3(plan.scenario.origin.alt_amsl_m - states[..., POSITION][..., 2])
    return drawn_power_W(controls, plan.quadrotor, power.rotor_radius_m, power.figure_of_merit, density)


class ChargeInWind:
    """The share of a full battery that the same flight needs in another steady wind.

    Vehicles keep their planned tracks: the force of the rotors changes by the drag alone (Eq. 1), their moments stay.
    Power is a convex function of thrust, and thrust of the wind, so the charge is a convex function of the wind.
    """

    def __init__(self, plan: Plan) -> None:
        """Raises ValueError for a plan without [vehicle.power]."""
        if plan.scenario.vehicle.power is None:
            raise ValueError("the plan has no [vehicle.power]")
        self._plan, self._t_s = plan, _instants_s(plan)
        self._states, self._controls = plan.motion(
            np.clip(self._t_s, plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
        )
        roll, pitch, yaw = np.moveaxis(self._states[..., ATTITUDE], -1, 0)
        ahead, left = np.sin(pitch) * np.cos(roll), np.sin(roll)
        sy, cy = np.sin(yaw), np.cos(yaw)
        up = np.cos(pitch) * np.cos(roll)
        along = np.stack([cy * ahead + sy * left, sy * ahead - cy * left, up], axis=-1)
        self._force_N = self._controls[..., :1] * along  # (V, N, 3)
        wind = plan.quadrotor.wind
        self._share = np.broadcast_to(wind.share(-self._states[..., POSITION][..., 2]), roll.shape)

    def needed(self, wind_ned_mps: Array, rows: slice | Rows = EVERYONE) -> Array:
        """The charge (V,) of `rows`, for the wind (2,), north and east, at the planned wind's reference height."""
        plan, q = self._plan, self._plan.quadrotor
        more_mps = np.asarray(wind_ned_mps) - [q.wind.north_mps, q.wind.east_mps]
        drag_N = self._share[rows][..., None] * (np.array(q.drag_Nspm[:2]) * more_mps)
        north, east, down = np.moveaxis(self._force_N[rows], -1, 0)
        controls = self._controls[rows].copy()
        controls[..., 0] = np.sqrt((north + drag_N[..., 0]) ** 2 + (east + drag_N[..., 1]) ** 2 + down**2)
        drawn_W = _drawn_W(plan, self._states[rows], controls)
        power = plan.scenario.vehicle.power
        assert power is not None
        return np.asarray(np.trapezoid(drawn_W, self._t_s, axis=-1) / _J_PER_WH / power.battery_Wh)


def drag_energy_J(plan: Plan) -> Array:
    """Eq. 32 for each vehicle (V,) from T0 to the arrival, J: the integral of k_f |v|^3, with v relative to the air.

    Eq. 30 is its sum.
    """
    mission = plan.phase(PhaseKind.MISSION)
    count = max(2, round((mission.end_s - mission.start_s) / _STEP_S) + 1)
    t_s = np.linspace(mission.start_s, np.nextafter(mission.end_s, -np.inf), count)
    states = plan.states(t_s)
    air = np.stack(np.broadcast_arrays(*plan.quadrotor.wind.at(-states[..., POSITION][..., 2])), axis=-1)
    power_W = plan.scenario.objective.drag_power_Ns2pm2 * np.linalg.norm(states[..., VELOCITY] - air, axis=-1) ** 3
    return np.asarray(np.trapezoid(power_W, t_s, axis=-1))
