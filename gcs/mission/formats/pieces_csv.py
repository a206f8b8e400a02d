"""Writes CSV of polynomial pieces for uav_trajectories and Crazyswarm: a duration, then 8 coefficients an axis.

The axes are x east, y north, z up and yaw from east to north; the lowest power stands first.
"""

import numpy as np

from gcs.mission.formats.vehicle_curve import VehicleCurve, cubic, quintic

_POWERS = 8
_HEADER = ",".join(["duration", *(f"{axis}^{power}" for axis in ("x", "y", "z", "yaw") for power in range(_POWERS))])
_DIGITS = ".12g"


def write_pieces(curve: VehicleCurve) -> str:
    """The text of a file."""
    length_s = np.diff(curve.t_s)
    motion = (curve.position_ned_m, curve.velocity_ned_mps, curve.acceleration_ned_mps2)
    places = quintic(length_s, *(part[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for part in motion))
    yaw = cubic(length_s, 0.5 * np.pi - curve.yaw_ned_rad, -curve.yaw_rate_radps)
    table = np.zeros((len(length_s), 4, _POWERS))
    table[:, :3, : len(places)] = np.moveaxis(places, 0, 2)
    table[:, 3, : len(yaw)] = yaw.T
    rows = np.column_stack([length_s, table.reshape(len(length_s), -1)])
    return "\n".join([_HEADER, *(",".join(format(value, _DIGITS) for value in row) for row in rows.tolist()), ""])
