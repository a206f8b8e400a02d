"""One MAVLink message as a plain value, and the station (system, component) that sends or receives it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from gcs.mavlink import NO_AUTOPILOT, PAYLOADS, MavType

Fields = dict[str, Any]  # int, float, str or lists of them, by the name of the field
_GROUND_COMPONENT = 190  # MAV_COMP_ID_MISSIONPLANNER, the usual id of ground stations


class Station(NamedTuple):
    """One end of a conversation: MAVLink system and component id. Component 0 means any component."""

    sysid: int
    compid: int

    @property
    def target(self) -> dict[str, int]:
        """The address fields of a message to this station."""
        return {"target_system": self.sysid, "target_component": self.compid}

    def __str__(self) -> str:
        kind = "ground station" if self.compid == _GROUND_COMPONENT else "vehicle"
        return f"{kind} {self.sysid}"


GROUND = Station(255, _GROUND_COMPONENT)


@dataclass(frozen=True, slots=True)
class Message:
    """One message by its MAVLink name. Fields are str, int, float or lists of them, in the units of the wire.

    `sysid`, `compid` name the source; 0 means the station that encodes it. `raw` is the frame it was decoded from, for
    logs; comparisons ignore it.
    """

    name: str
    fields: Fields
    sysid: int = 0
    compid: int = 0
    raw: bytes = field(default=b"", compare=False, repr=False)

    @property
    def source(self) -> Station:
        """The station it came from."""
        return Station(self.sysid, self.compid)

    def comes_from(self, station: Station) -> bool:
        """Whether `station` sent it (any component of it when its component is 0)."""
        return self.sysid == station.sysid and (station.compid in (0, self.compid))

    def is_for(self, station: Station) -> bool:
        """Whether it is addressed to `station`, to all, or has no address."""
        fields = self.fields
        return fields.get("target_system", 0) in (0, station.sysid) and (
            station.compid == 0 or fields.get("target_component", 0) in (0, station.compid)
        )


def is_autopilots_beat(message: Message) -> bool:
    """Whether this is the HEARTBEAT of an autopilot, not of a ground station, a camera or a companion computer."""
    if message.name != "HEARTBEAT" or message.fields["autopilot"] == NO_AUTOPILOT:
        return False
    kind = message.fields["type"]
    return kind != MavType.GCS and kind not in PAYLOADS


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
