"""The supported autopilots: their MAVLink numbers, and the table with one row for each.

To add one: a member of `Autopilot`, a file with its row, an entry in `TRAITS` (docs/extending.md). Vehicles may run
others: on a link their numbers stay plain ints, and `link_behaviour` has defaults for them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import TYPE_CHECKING, Literal

from gcs.autopilots.ardupilot import ARDUPILOT
from gcs.autopilots.columns import AutopilotTraits, FlightBehaviour, LinkBehaviour
from gcs.autopilots.px4 import PX4
from gcs.autopilots.waypoint_models.navigator import Navigator
from gcs.errors import PeerError
from gcs.mavlink import GENERIC_AUTOPILOT, ROTORCRAFT, MavType


class Autopilot(IntEnum):
    """MAV_AUTOPILOT values of the autopilots in the table. Properties read the row; `traits` is all of it."""

    ARDUPILOT = 3
    PX4 = 12

    @property
    def traits(self) -> AutopilotTraits:
        """Its row of the table `TRAITS`."""
        return TRAITS[self]

    @property
    def key(self) -> str:
        """Its name in scenarios and on the command line ("ardupilot", "px4")."""
        return self.name.lower()

    @property
    def title(self) -> str:
        """Its name in messages."""
        return self.traits.title

    @property
    def home_is_item_0(self) -> bool:
        """Whether item 0 of a stored mission is home; else it is the first item that is flown."""
        return self.traits.link.home_is_item_0

    @property
    def navigator(self) -> Navigator:
        """The model that predicts its flight of waypoints, as it was recorded."""
        return self.traits.navigator

    @classmethod
    def named(cls, name: str) -> Autopilot:
        """Return the autopilot of a `key`. Raises KeyError for another name."""
        return cls[name.upper()]


TRAITS: dict[Autopilot, AutopilotTraits] = {Autopilot.ARDUPILOT: ARDUPILOT, Autopilot.PX4: PX4}

if TYPE_CHECKING:
    AutopilotKey = str
else:
    AutopilotKey = Literal[tuple(known.key for known in Autopilot)]  # a key, as a type of data models

_UNKNOWN = LinkBehaviour()


def traits_of(autopilot: int) -> AutopilotTraits | None:
    """Return the row of MAV_AUTOPILOT `autopilot`; None for one that is not in the table."""
    return TRAITS[Autopilot(autopilot)] if autopilot in TRAITS else None


def link_behaviour(autopilot: int) -> LinkBehaviour:
    """Return how MAV_AUTOPILOT `autopilot` communicates; careful defaults for one that is not in the table."""
    row = traits_of(autopilot)
    return _UNKNOWN if row is None else row.link


# The autopilot of all vehicles, or that of each, in the plan's order.
FleetFirmware = Autopilot | Sequence[Autopilot]


def one_each(firmware: FleetFirmware, vehicles: int) -> tuple[Autopilot, ...]:
    """Return the autopilot of each vehicle. Raises `ValueError` for a list of another length."""
    each = (firmware,) * vehicles if isinstance(firmware, Autopilot) else tuple(firmware)
    if len(each) != vehicles:
        raise ValueError(f"{len(each)} autopilots for {vehicles} vehicles")
    return each


def titles(autopilots: Iterable[Autopilot] = tuple(Autopilot)) -> str:
    """Return the names of these autopilots, or of all in the table, for messages: "ArduCopter and PX4"."""
    return " and ".join(known.title for known in dict.fromkeys(autopilots))


def flight_behaviour(sysid: int, autopilot: int, kind: int) -> FlightBehaviour:
    """Return how MAV_AUTOPILOT `autopilot` is flown on a vehicle of MAV_TYPE `kind`.

    Raises PeerError for an autopilot that is not in the table, and for what is no rotorcraft: ArduPlane and Rover have
    ArduCopter's number, and other modes under the numbers of its modes.
    """
    if kind not in ROTORCRAFT:
        names = (known.name.lower().replace("_", " ") for known in MavType if known == kind)
        what = next(names, "vehicle of another kind")
        raise PeerError(
            f"vehicle {sysid} is a {what} (MAV_TYPE {kind}); only rotorcraft can be flown.",
            hint="give the vehicle that is meant this system id, or map it with --map",
        )
    row = traits_of(autopilot)
    if row is None:
        raise PeerError(
            f"vehicle {sysid} runs autopilot number {autopilot}; only {titles()} can be flown.",
            hint="export the missions with `gcs export` and fly them with its own ground station",
        )
    return row.flight


def autopilot_name(autopilot: int) -> str:
    """Return the name of MAV_AUTOPILOT `autopilot`."""
    row = traits_of(autopilot)
    if row is not None:
        return row.title
    return "generic" if autopilot == GENERIC_AUTOPILOT else f"autopilot {autopilot}"


def mode_name(autopilot: int, custom_mode: int, kind: int = MavType.GENERIC) -> str:
    """Return the name of HEARTBEAT.custom_mode; a mode that is not known keeps its number.

    So has every mode of a vehicle of MAV_TYPE `kind` that is no rotorcraft.
    """
    row = traits_of(autopilot) if kind in ROTORCRAFT else None
    return f"mode {custom_mode}" if row is None else row.flight.mode_name(custom_mode)
