"""Which files an export can write: a row for each format.

Knows: names, whether there is a file for each vehicle or one for all. Does not know: contents.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

from gcs.errors import UsageError


class Format(StrEnum):
    """A format by the name people ask for."""

    WAYPOINTS = "waypoints"
    PLAN = "plan"
    FENCE = "fence"
    RALLY = "rally"
    SETPOINTS = "setpoints"
    PARQUET = "parquet"
    HISTORY = "history"
    PARAM = "param"
    KML = "kml"
    KMZ = "kmz"
    GEOJSON = "geojson"


DEFAULT = (Format.WAYPOINTS, Format.PLAN, Format.SETPOINTS)
MISSIONS = frozenset({Format.WAYPOINTS, Format.PLAN})
MAPS = frozenset({Format.KML, Format.KMZ, Format.GEOJSON})
ALL = "all"
FLEET = "formation"  # name, without suffix, of files that hold all vehicles


def vehicle_name(sysid: int) -> str:
    """Name, without suffix, of one vehicle's files."""
    return f"uav{sysid}"


def formats_named(names: Iterable[str]) -> tuple[Format, ...]:
    """The formats people asked for, in the order of the table; "all" means every one. Raises `UsageError`."""
    wanted: set[Format] = set()
    for name in names:
        if name == ALL:
            wanted |= set(Format)
        elif name in set(Format):
            wanted.add(Format(name))
        else:
            raise UsageError(f"there is no format '{name}'", hint=f"there are {', '.join(Format)}, and {ALL}")
    return tuple(f for f in Format if f in wanted) or DEFAULT
