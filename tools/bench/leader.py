"""The common problem, for any library that has sin, cos, exp and sqrt: Simulation 1's leader in scaled unknowns.

From A to B, or through points: a leg is a phase of free duration. Skein's equations are repeated here on purpose: peers
live in environments without it (tests/unit/tools/test_bench.py compares the two).
"""

from typing import Any

import numpy as np

NX, NU = 12, 4


class Leader:
    """Dynamics, cost and path constraints of one instant; x and u are in units of `state_unit` and `control_unit`."""

    def __init__(self, numbers: dict[str, Any]) -> None:
        self.numbers = numbers
        self.end_s = float(numbers["end_s"])
        self.joints_s = np.array(numbers["joints_s"])
        self.degrees: list[int] = list(numbers["degrees"])
        self.state_unit = np.array(numbers["state_unit"])
        self.control_unit = np.array(numbers["control_unit"])
        self.control_shift = np.array(numbers["control_shift"])
        self.x_low, self.x_high, self.x_start, self.x_end = (
            np.array(numbers[key]) / self.state_unit for key in ("state_low", "state_high", "start_state", "end_state")
        )
        self.u_low, self.u_high = (
            (np.array(numbers[key]) - self.control_shift) / self.control_unit for key in ("control_low", "control_high")
        )
        self.guess_s = np.array(numbers["guess_s"])
        self.guess_x = np.array(numbers["guess_state"]) / self.state_unit  # (G, 12)
        self.guess_u = (np.array(numbers["guess_control"]) - self.control_shift) / self.control_unit  # (G, 4)
        self.points = np.array(numbers["points_ned_m"]).reshape(-1, 3) / self.state_unit[:3]  # (P, 3)
        self.stretch_low, self.stretch_high = numbers["stretch"]  # bounds of a leg's duration, over that of the guess
        legs = np.array(numbers["leg_of_interval"])
        self.legs = int(legs[-1]) + 1
        self.intervals = [np.flatnonzero(legs == leg).tolist() for leg in range(self.legs)]
        # (K + 1,) in the guess: start, points, end
        self.ends_s = np.array([self.joints_s[0], *(self.joints_s[own[-1] + 1] for own in self.intervals)])

    def degrees_of(self, leg: int) -> list[int]:
        """Nodes of each interval of a leg."""
        return [self.degrees[i] for i in self.intervals[leg]]

    def shares_of(self, leg: int) -> list[float]:
        """Length of each interval of a leg, as a share of the leg."""
        lengths = np.diff(self.joints_s)[self.intervals[leg]]
        return [float(share) for share in lengths / lengths.sum()]

    def duration_of(self, leg: int) -> tuple[float, float]:
        """Least and largest duration of a leg, in seconds."""
        guess_s = float(self.ends_s[leg + 1] - self.ends_s[leg])
        return self.stretch_low * guess_s, self.stretch_high * guess_s

    def box_of(self, leg: int, *, end: bool) -> tuple[Any, Any]:
        """Bounds (12,), (12,) of the state at the start or the end of a leg."""
        stop = leg + end
        if stop in (0, self.legs):
            fixed = self.x_end if stop else self.x_start
            return fixed, fixed
        low, high = self.x_low.copy(), self.x_high.copy()
        low[:3] = high[:3] = self.points[stop - 1]
        return low, high

    def guess_of(self, leg: int) -> tuple[Any, Any, Any]:
        """Instants (G,), x (G, 12) and u (G, 4) of the guess of one leg."""
        start_s, end_s = self.ends_s[leg : leg + 2]
        inner = self.guess_s[(self.guess_s > start_s) & (self.guess_s < end_s)]
        times_s = np.array([start_s, *inner, end_s])
        return (times_s, *self.guess(times_s))

    def joints_of(self, ends_s: Any) -> list[float]:
        """Ends of all intervals, where the legs end at `ends_s` (K + 1,)."""
        joints = [float(ends_s[0])]
        for leg in range(self.legs):
            joints += (ends_s[leg] + np.cumsum(self.shares_of(leg)) * (ends_s[leg + 1] - ends_s[leg])).tolist()
        return joints

    def guess(self, times_s: Any) -> tuple[Any, Any]:
        """Guess of x (T, 12) and u (T, 4) at any instants."""
        x, u = (
            np.stack([np.interp(times_s, self.guess_s, column) for column in values.T], axis=-1)
            for values in (self.guess_x, self.guess_u)
        )
        return x, u

    def times_s(self, i: int, tau: Any) -> Any:
        """Instants of interval i at tau on [0, 1]."""
        return self.joints_s[i] + np.asarray(tau) * (self.joints_s[i + 1] - self.joints_s[i])

    def rates(self, x: Any, u: Any, xp: Any) -> list[Any]:
        """Eq. 1: time derivatives of x, per second."""
        q = self.numbers["quadrotor"]
        _, _, _, vx, vy, vz, roll, pitch, yaw, p, r, s = (x[i] * self.state_unit[i] for i in range(NX))
        thrust, u2, u3, u4 = (u[i] * self.control_unit[i] + self.control_shift[i] for i in range(NU))
        lift = thrust / q["mass_kg"]
        drag = [k / q["mass_kg"] for k in q["drag_Nspm"]]
        (jx, jy, jz), (dx, dy, dz) = q["inertia_kgm2"], q["drag_moment_Nms"]
        f = [
            vx,
            vy,
            vz,
            -lift * (xp.cos(yaw) * xp.sin(pitch) * xp.cos(roll) + xp.sin(yaw) * xp.sin(roll)) - drag[0] * vx,
            -lift * (xp.sin(yaw) * xp.sin(pitch) * xp.cos(roll) - xp.cos(yaw) * xp.sin(roll)) - drag[1] * vy,
            -lift * xp.cos(pitch) * xp.cos(roll) + q["gravity_mps2"] - drag[2] * vz,
            p,
            r,
            s,
            (q["arm_m"] * u2 + r * s * (jy - jz) - dx * p) / jx,
            (q["arm_m"] * u3 + p * s * (jz - jx) - dy * r) / jy,
            (u4 + p * r * (jx - jy) - dz * s) / jz,
        ]
        return [rate / unit for rate, unit in zip(f, self.state_unit, strict=True)]

    def cost_rate(self, x: Any, t: Any, xp: Any) -> Any:
        """Eq. 35: its integral over the flight is the objective."""
        o = self.numbers["objective"]
        height = -x[2] * self.state_unit[2]
        vx, vy, vz = (x[i] * self.state_unit[i] for i in (3, 4, 5))
        yaw = x[8] * self.state_unit[8]
        still = (0.01 * o["speed_ref_mps"]) ** 2
        energy = (xp.sqrt(vx * vx + vy * vy + vz * vz + still) / o["speed_ref_mps"]) ** 3
        course = xp.sqrt(vx * vx + vy * vy + still)
        ahead = vx * xp.cos(yaw) + vy * xp.sin(yaw)
        slip = 2.0 * course * (course - ahead) / (o["speed_ref_mps"] * o["heading_scale_rad"]) ** 2
        heading = ((yaw - o["heading_ref_rad"]) / o["heading_scale_rad"]) ** 2 + slip
        climb = ((height - o["height_ref_m"]) / o["height_scale_m"]) ** 2
        late = 1.0 / (self.end_s - t + 0.5) / self.numbers["late_integral"]
        steering = o["heading_weight"] * heading + o["height_weight"] * climb
        turned = (x[11] * self.state_unit[11] / self.numbers["yaw_rate_max_radps"]) ** 2
        mean = o["energy_weight"] * energy + self.numbers["turning_weight"] * turned
        return mean / self.end_s + late * steering

    def path(self, x: Any, u: Any, xp: Any) -> list[Any]:
        """Clearance above the smooth ground (Eqs. 20, 53) and turning (Eqs. 17, 18): each >= 0 when held."""
        m, q = self.numbers["mountains"], self.numbers["quadrotor"]
        north, east = x[0] * self.state_unit[0], x[1] * self.state_unit[1]
        ground = 0.0
        for height, n, e, wide_n, wide_e in zip(*m, strict=True):
            ground = ground + height * xp.exp(-(((north - n) / wide_n) ** 2) - ((east - e) / wide_e) ** 2)
        rise = ground - self.numbers["ripple_peak_m"]
        ground = self.numbers["ripple_peak_m"] + 0.5 * (rise + xp.sqrt(rise * rise + self.numbers["rounding_m"] ** 2))
        clearance = -x[2] * self.state_unit[2] - ground - self.numbers["clearance_min_m"]
        rates = self.rates(x, u, xp)
        vx, vy = x[3] * self.state_unit[3], x[4] * self.state_unit[4]
        turn = vx * rates[4] * self.state_unit[4] - vy * rates[3] * self.state_unit[3]
        most = self.numbers["load_factor_max"] * q["gravity_mps2"]
        turning = 1.0 - (turn / most) ** 2 / (vx * vx + vy * vy + self.numbers["rest_mps"] ** 2)
        return [clearance, turning]
