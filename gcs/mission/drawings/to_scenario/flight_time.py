"""The time that a formation takes along a route: its legs at their speeds, its holds, and what stops and turns cost."""

from __future__ import annotations

import math

import numpy as np

from gcs.physics.quadrotor import Array

CRUISE_MPS = 10.0 / 3.0  # where no speed is drawn
_ACCEL_MPS2 = 1.0  # half of what the vehicle type has
_STEP_S, _LEAST_S = 5.0, 30.0
_STRAIGHT_DEG = 30.0  # at a smaller turn a formation passes at its speed


def turns_rad(points_m: Array) -> Array:
    """The angle between the legs before and after each point between the ends (N - 2,), 0 straight ahead, rad."""
    legs_m = np.diff(points_m, axis=0)
    before, after = legs_m[:-1], legs_m[1:]
    lengths = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    cosine = np.einsum("ij,ij->i", before, after) / np.maximum(lengths, 1e-9)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def is_passed_at_speed(turn_rad: float) -> bool:
    """Whether a formation can be expected to keep its speed at a turn."""
    return turn_rad <= math.radians(_STRAIGHT_DEG)


def flight_time_s(points_m: Array, speeds_mps: Array, climb_mps: float, holds_s: Array) -> float:
    """The time along points (N, 3) with a speed for each leg (N - 1,) and a hold at each point (N,), s.

    A stop costs the time to brake and to accelerate again, a turn the time to change the direction of the velocity.
    """
    legs_m = np.diff(points_m, axis=0)
    flown_s = np.maximum(np.linalg.norm(legs_m, axis=1) / speeds_mps, np.abs(legs_m[:, 2]) / climb_mps)
    slower_mps = np.minimum(speeds_mps[:-1], speeds_mps[1:])
    stops = holds_s[1:-1] > 0.0
    turned_s = slower_mps * np.where(stops, 1.0, np.sin(turns_rad(points_m) / 2.0)) / _ACCEL_MPS2
    ends_s = (speeds_mps[0] + speeds_mps[-1]) / 2.0 / _ACCEL_MPS2
    total_s = float(flown_s.sum() + turned_s.sum() + ends_s + holds_s.sum())
    return max(_LEAST_S, _STEP_S * math.ceil(total_s / _STEP_S))
