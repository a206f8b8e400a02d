"""Position and velocity in a vehicle's local frame. Implausible numbers count as no report."""

from __future__ import annotations

from collections.abc import Sequence

from gcs.link.wire.message import Message

_AXES_M, _AXES_MPS = ("x", "y", "z"), ("vx", "vy", "vz")
_FARTHEST_M = 1e5  # a float32 has steps of 8 mm there: no vehicle flies so far by a local frame
_FASTEST_MPS = 1e3

Motion = tuple[float, float, float, float, float, float]


def local_motion(message: Message) -> Motion | None:
    """Return north, east, down [m] and their velocities [m/s] in the vehicle's local frame.

    None if one is not finite or beyond any flight: a damaged estimator and a radio can say so with a right checksum.
    """
    fields = message.fields
    place, velocity = [float(fields[name]) for name in _AXES_M], [float(fields[name]) for name in _AXES_MPS]
    if not is_local_place(place) or not all(abs(value) <= _FASTEST_MPS for value in velocity):
        return None
    return (place[0], place[1], place[2], velocity[0], velocity[1], velocity[2])


def is_local_place(place_ned_m: Sequence[float]) -> bool:
    """Whether this may be a place in a local frame; NaN is none."""
    return all(abs(value) <= _FARTHEST_M for value in place_ned_m)
