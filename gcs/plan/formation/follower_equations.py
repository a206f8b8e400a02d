"""Eq. 1 inverted for a vehicle that moves within the formation, as plain arithmetic on components.

`xp` supplies sin, cos, sqrt and arctan2: NumPy for values, Taylor models for bounds over an interval.
"""

from collections.abc import Sequence

import numpy as np

from gcs.physics.quadrotor import Quadrotor, equations_of_motion
from gcs.types import Maths, Scalar

Parts = Sequence[Scalar]  # components
Jet = tuple[Scalar, Scalar, Scalar]  # a value and its first two derivatives


def follower_state_and_control(
    x: Parts, u: Parts, thrust: Jet, offsets: Sequence[Parts], q: Quadrotor, xp: Maths = np
) -> tuple[tuple[Scalar, ...], tuple[Scalar, ...]]:
    """Return the 12 state and 4 control components of a vehicle at an offset from the leader.

    `x` (12) and `u` (4) are the leader's, `thrust` is the thrust by which followers tilt, `offsets` (5 of 3) are the
    offset and its first four derivatives. Where that thrust is the leader's, Eq. 1 holds for the result as exactly as
    for the leader.
    """
    place, speed, acceleration, jerk, snap = offsets
    angular = equations_of_motion(x, u, q, xp=xp)
    # What thrust does, in NED and turned over: f = U1 * e(attitude) with e = (0, 0, 1) when level.
    force = thrust_vector(x, angular[9:12], thrust, xp)
    lift = u[0] * xp.cos(x[6]) * xp.cos(x[7]) - q.mass_kg * acceleration[2] - q.drag_Nspm[2] * speed[2]
    moved: list[Jet] = []
    for axis in range(3):
        m, k = q.mass_kg, q.drag_Nspm[axis]
        f0, f1, f2 = force[axis]
        moved.append(
            (
                f0 - m * acceleration[axis] - k * speed[axis],
                f1 - m * jerk[axis] - k * acceleration[axis],
                f2 - m * snap[axis] - k * jerk[axis],
            )
        )
    if q.wind.has_shear:
        here = _wind_share(-x[2], -x[5], -angular[5], q, xp)
        there = _wind_share(-(x[2] + place[2]), -(x[5] + speed[2]), -(angular[5] + acceleration[2]), q, xp)
        for axis, toward in enumerate((q.wind.north_mps, q.wind.east_mps)):
            factor = q.drag_Nspm[axis] * toward
            f0, f1, f2 = (f + factor * (b - a) for f, a, b in zip(moved[axis], here, there, strict=True))
            moved[axis] = f0, f1, f2
    place_and_speed = (*(x[i] + place[i] for i in range(3)), *(x[3 + i] + speed[i] for i in range(3)))
    return under_force(place_and_speed, (moved[0], moved[1], moved[2]), lift, (x[8], x[11], angular[11]), q, xp)


def under_force(
    place_and_speed: Parts, force: tuple[Jet, Jet, Jet], lift: Scalar, yaw: Jet, q: Quadrotor, xp: Maths = np
) -> tuple[tuple[Scalar, ...], tuple[Scalar, ...]]:
    """Return the 12 state and 4 control components of a vehicle whose thrust exerts a force.

    `force` (NED) is turned over, so that it is (0, 0, U1) when level, and tilts the vehicle; `lift` is its vertical
    part by which the height is exact.
    """
    ahead, left = _turned(force[0], force[1], *yaw, xp)
    down = force[2]
    pitch = _angle(ahead, down, xp)
    roll = _angle(left, _length(ahead, down, xp), xp)
    state = (
        *place_and_speed,
        *(roll[0], pitch[0], yaw[0] + 0.0 * roll[0]),
        *(roll[1], pitch[1], yaw[1] + 0.0 * roll[0]),
    )
    # What Eq. 1 gives without moments is what they have to make up for.
    idle = equations_of_motion(state, (0.0 * lift, 0.0, 0.0, 0.0), q, xp=xp)
    ix, iy, iz = q.inertia_kgm2
    control = (
        lift / (xp.cos(roll[0]) * xp.cos(pitch[0])),
        (roll[2] - idle[9]) * (ix / q.arm_m),
        (pitch[2] - idle[10]) * (iy / q.arm_m),
        (yaw[2] - idle[11]) * iz,
    )
    return state, control


def leader_jets(x: Parts, u: Parts, thrust: Jet, q: Quadrotor) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Return acceleration, jerk and snap (3, ...) of Eq. 1 (NED) with this thrust, and the yaw's acceleration."""
    rates = equations_of_motion(x, u, q)
    force = thrust_vector(x, rates[9:12], thrust, np)
    gusts = wind_jets(-x[2], -x[5], -rates[5], q)
    found = []
    for axis, (f0, f1, f2) in enumerate(force):
        k, m = q.drag_Nspm[axis], q.mass_kg
        w0, w1, w2 = gusts[axis]
        a = (q.gravity_mps2 if axis == 2 else 0.0) - (f0 + k * (x[3 + axis] - w0)) / m
        j = -(f1 + k * (a - w1)) / m
        found.append((a, j, -(f2 + k * (j - w2)) / m))
    acceleration, jerks, snap = (np.stack(one) for one in zip(*found, strict=True))
    return acceleration, jerks, snap, rates[11]


def wind_jets(height: Scalar, climb: Scalar, climb_rate: Scalar, q: Quadrotor) -> tuple[Jet, Jet, Jet]:
    """The planned wind (NED) at a height, each axis with two derivatives."""
    north, east, down = (part + 0.0 * height for part in q.wind.at(height))
    none = 0.0 * height
    if not q.wind.has_shear:
        return (north, none, none), (east, none, none), (down, none, none)
    _, slope, bend = _wind_share(height, climb, climb_rate, q, np)
    n, e = q.wind.north_mps, q.wind.east_mps
    return (north, n * slope, n * bend), (east, e * slope, e * bend), (down, none, none)


def jerk(x: Parts, u: Parts, thrust_rate: Scalar, q: Quadrotor, xp: Maths = np) -> tuple[Scalar, Scalar, Scalar]:
    """The derivative of the acceleration of Eq. 1 (NED), at a state `x` (12), a control `u` (4) and the rate of U1."""
    moved = equations_of_motion(x, u, q, xp=xp)[3:6]
    force = thrust_vector(x, (0.0, 0.0, 0.0), (u[0], thrust_rate, 0.0), xp)
    gust = q.wind.shares(-x[2], xp)[1] * -x[5] if q.wind.has_shear else 0.0
    air = (moved[0] - gust * q.wind.north_mps, moved[1] - gust * q.wind.east_mps, moved[2])
    north, east, down = ((force[axis][1] + q.drag_Nspm[axis] * air[axis]) * (-1.0 / q.mass_kg) for axis in range(3))
    return north, east, down


def _wind_share(height: Scalar, climb: Scalar, climb_rate: Scalar, q: Quadrotor, xp: Maths) -> Jet:
    """The share of the wind at a height, with two derivatives."""
    share, slope, bend = q.wind.shares(height, xp)
    return share, slope * climb, bend * (climb * climb) + slope * climb_rate


def thrust_vector(x: Parts, angular: Parts, thrust: Jet, xp: Maths) -> tuple[Jet, Jet, Jet]:
    """U1 * e with its first two derivatives, for each axis.

    e = Rz(yaw) (sin pitch cos roll, -sin roll, cos pitch cos roll).
    """
    p, q, r = x[9:12]
    pp, qq, rr = angular
    sr, cr = xp.sin(x[6]), xp.cos(x[6])
    sp, cp = xp.sin(x[7]), xp.cos(x[7])
    sy, cy = xp.sin(x[8]), xp.cos(x[8])
    spcr, cpcr, spsr, cpsr = sp * cr, cp * cr, sp * sr, cp * sr
    a0, b0, c0 = spcr, -sr, cpcr
    a1 = q * cpcr - p * spsr
    b1 = -(p * cr)
    c1 = -(q * spcr) - p * cpsr
    squares, both = q * q + p * p, 2.0 * (p * q)
    a2 = qq * cpcr - pp * spsr - squares * spcr - both * cpsr
    b2 = -(pp * cr) + p * p * sr
    c2 = -(qq * spcr) - pp * cpsr - squares * cpcr + both * spsr
    # Turned by the yaw: (a + i b) exp(i yaw), whose derivative adds i r times itself.
    a1t, b1t = a1 - r * b0, b1 + r * a0
    a2t = a2 - 2.0 * (r * b1) - rr * b0 - r * r * a0
    b2t = b2 + 2.0 * (r * a1) + rr * a0 - r * r * b0
    u0, u1, u2 = thrust

    def along(e0: Scalar, e1: Scalar, e2: Scalar) -> Jet:
        return u0 * e0, u1 * e0 + u0 * e1, u2 * e0 + 2.0 * (u1 * e1) + u0 * e2

    north = along(a0 * cy - b0 * sy, a1t * cy - b1t * sy, a2t * cy - b2t * sy)
    east = along(a0 * sy + b0 * cy, a1t * sy + b1t * cy, a2t * sy + b2t * cy)
    return north, east, along(c0, c1, c2)


def _turned(north: Jet, east: Jet, yaw: Scalar, rate: Scalar, acceleration: Scalar, xp: Maths) -> tuple[Jet, Jet]:
    """The force seen along the heading: ahead, and to the left; (n + i e) exp(-i yaw) = ahead - i left."""
    c, s = xp.cos(yaw), xp.sin(yaw)
    n0, n1, n2 = north
    e0, e1, e2 = east
    n1t, e1t = n1 + rate * e0, e1 - rate * n0
    n2t = n2 + 2.0 * (rate * e1) + acceleration * e0 - rate * rate * n0
    e2t = e2 - 2.0 * (rate * n1) - acceleration * n0 - rate * rate * e0
    ahead = (n0 * c + e0 * s, n1t * c + e1t * s, n2t * c + e2t * s)
    left = (n0 * s - e0 * c, n1t * s - e1t * c, n2t * s - e2t * c)
    return ahead, left


def _length(a: Jet, c: Jet, xp: Maths) -> Jet:
    """sqrt(a^2 + c^2)."""
    h0 = xp.sqrt(a[0] * a[0] + c[0] * c[0])
    h1 = (a[0] * a[1] + c[0] * c[1]) / h0
    h2 = (a[1] * a[1] + a[0] * a[2] + c[1] * c[1] + c[0] * c[2] - h1 * h1) / h0
    return h0, h1, h2


def _angle(y: Jet, x: Jet, xp: Maths) -> Jet:
    """atan2(y, x)."""
    square = y[0] * y[0] + x[0] * x[0]
    cross = y[1] * x[0] - y[0] * x[1]
    cross_rate = y[2] * x[0] - y[0] * x[2]
    square_rate = 2.0 * (y[0] * y[1] + x[0] * x[1])
    return xp.arctan2(y[0], x[0]), cross / square, (cross_rate - cross * square_rate / square) / square
