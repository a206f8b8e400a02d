"""Everything the optimiser asks of one instant z = (state, control): motion, cost rate and path constraints.

Knows: Eq. 1, Eq. 35's integrands, Eqs. 17-29 in the leader's variables, and their exact derivatives (CasADi).
Does not know: meshes, time, other instants.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from gcs.plan.margins import REST_SPEED_MPS
from gcs.plan.problem import Problem
from gcs.quadrotor import equations_of_motion
from gcs.scenario.terrain import ground_envelope_m

# Keeps the load factor smooth at rest, and so small that no speed, to 0.05 %, is granted more than the verifier grants.
REST_SMOOTHING_MPS = 0.03 * REST_SPEED_MPS


@dataclass(frozen=True)
class Instant:
    """CasADi functions of z (16) and, for the cost, of two quadrature shares (plain, and weighted by Q)."""

    motion: ca.Function  # z -> (12)
    motion_jacobian: ca.Function  # z -> (12, 16)
    cost: ca.Function  # z, shares (2) -> ()
    cost_gradient: ca.Function  # z, shares -> (16)
    motion_hessian: ca.Function  # z, shares, sigma, costate (12) -> (16, 16): of sigma * cost + costate . motion
    path: ca.Function  # z -> (P), each >= 0
    path_jacobian: ca.Function  # z -> (P, 16)
    path_hessian: ca.Function  # z, multipliers (P) -> (16, 16)
    path_names: tuple[str, ...]


def functions(problem: Problem) -> Instant:
    """Build the functions of one problem."""
    z = ca.SX.sym("z", 16)
    x, u = ca.vertsplit(z[:12]), ca.vertsplit(z[12:])
    motion = ca.vertcat(*equations_of_motion(x, u, problem.quadrotor, xp=ca))
    shares = ca.SX.sym("shares", 2)
    cost = _cost_rate(problem, x, shares)
    names, path_parts = _path(problem, x, motion)
    path = ca.vertcat(*path_parts)
    sigma, costate, multipliers = (
        ca.SX.sym("sigma"),
        ca.SX.sym("costate", 12),
        ca.SX.sym("multipliers", len(names)),
    )

    def function(name: str, inputs: list[ca.SX], output: ca.SX) -> ca.Function:
        return ca.Function(name, inputs, [output])

    return Instant(
        motion=function("motion", [z], motion),
        motion_jacobian=function("motion_jacobian", [z], ca.jacobian(motion, z)),
        cost=function("cost", [z, shares], cost),
        cost_gradient=function("cost_gradient", [z, shares], ca.gradient(cost, z)),
        motion_hessian=function(
            "motion_hessian",
            [z, shares, sigma, costate],
            ca.hessian(sigma * cost + ca.dot(costate, motion), z)[0],
        ),
        path=function("path", [z], path),
        path_jacobian=function("path_jacobian", [z], ca.jacobian(path, z)),
        path_hessian=function("path_hessian", [z, multipliers], ca.hessian(ca.dot(multipliers, path), z)[0]),
        path_names=names,
    )


def _cost_rate(problem: Problem, x: list[ca.SX], shares: ca.SX) -> ca.SX:
    """Eqs. 30-35: energy of a rigid formation, heading with sideslip, height; each in units of its reference."""
    wanted = problem.objective
    vx, vy, vz, yaw = x[3], x[4], x[5], x[8]
    # Smoothed at rest, where |v|^3 has no second derivative.
    speed = ca.sqrt(vx**2 + vy**2 + vz**2 + (1e-2 * wanted.speed_ref_mps) ** 2)
    energy = (speed / wanted.speed_ref_mps) ** 3
    # Yaw alone cannot bend a quadrotor's path: coming from a direction needs yaw *and* course. At reference speed the
    # angle between them costs what yaw's angle to the reference costs: (2 v sin(angle / 2))^2; backwards is worst.
    ground_speed = ca.sqrt(vx**2 + vy**2 + (1e-2 * wanted.speed_ref_mps) ** 2)
    forward = vx * ca.cos(yaw) + vy * ca.sin(yaw)
    slip = 2.0 * ground_speed * (ground_speed - forward) / (wanted.speed_ref_mps * wanted.heading_scale_rad) ** 2
    heading = ((yaw - wanted.heading_ref_rad) / wanted.heading_scale_rad) ** 2 + slip
    height = ((-x[2] - wanted.height_ref_m) / wanted.height_scale_m) ** 2
    return shares[0] * wanted.energy_weight * energy + shares[1] * (
        wanted.heading_weight * heading + wanted.height_weight * height
    )


def _path(problem: Problem, x: list[ca.SX], motion: ca.SX) -> tuple[tuple[str, ...], list[ca.SX]]:
    """Eqs. 17-25 for the leader and, moved by its offset, for every follower; each value >= 0 when held."""
    scenario = problem.scenario
    names: list[str] = []
    values: list[ca.SX] = []
    for vehicle, (north, east, down) in zip(scenario.formation.vehicle, problem.offsets_ned_m, strict=True):
        ground = ground_envelope_m(scenario.terrain, x[0] + north, x[1] + east, ca)
        names.append(f"clearance of vehicle {vehicle.sysid}")
        values.append(-(x[2] + down) - ground - scenario.limits.clearance_min_m - problem.clearance_reserve_m)
        for number, disk in enumerate(scenario.no_fly, start=1):
            squared = (x[0] + north - disk.north_m) ** 2 + (x[1] + east - disk.east_m) ** 2
            names.append(f"no-fly disk {number} for vehicle {vehicle.sysid}")
            values.append((squared - disk.radius_m**2) / (2.0 * disk.radius_m))
    # Offsets are constant in the inertial frame, so all vehicles share one velocity and one turning constraint.
    bound = scenario.limits.load_factor_max * problem.quadrotor.gravity_mps2
    vx, vy = x[3], x[4]
    turn = vx * motion[4] - vy * motion[3]
    names.append("turning radius")
    values.append(1.0 - (turn / bound) ** 2 / (vx**2 + vy**2 + REST_SMOOTHING_MPS**2))
    return tuple(names), values
