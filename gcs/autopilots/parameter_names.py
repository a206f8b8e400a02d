"""The names of one parameter in several versions of an autopilot, and its value in the unit of each name.

The tables are in the rows (`LinkBehaviour.renaming`). A vehicle does not answer for a name that it does not have, so
requests go out under every name that its version may have, and the answer decides.
"""

from collections.abc import Iterable
from functools import cache

from gcs.autopilots.columns import RenamedParameter
from gcs.autopilots.traits import Autopilot, link_behaviour, traits_of

_DECIMALS = 6  # of a value in another unit: 0.29 m are 29 cm


def spellings(autopilot: int, name: str, version: int | None = None) -> tuple[str, ...]:
    """Return the names that a parameter may have on a vehicle of MAV_AUTOPILOT `autopilot`, the likeliest first.

    `name` is any of them. `version` is AUTOPILOT_VERSION.flight_sw_version; None: every version.
    """
    renaming = link_behaviour(autopilot).renaming
    renamed = _renamed(autopilot).get(name)
    if renaming is None or renamed is None:
        return (name,)
    if version is None:
        return renamed.old, renamed.new
    if (version >> 24 & 0xFF, version >> 16 & 0xFF) < renaming.since:
        return (renamed.old,)
    return renamed.new, renamed.old


def reason_for(autopilot: int, name: str) -> str:
    """Return why an upload sets a parameter, under any of its names; empty for one that uploads do not set."""
    row = traits_of(autopilot)
    table = {} if row is None else row.returns.table
    return next((table[known][0] for known in (name, *spellings(autopilot, name)) if known in table), "")


def in_units_of(autopilot: int, wanted: str, name: str, value: int | float) -> int | float:
    """Return the value of parameter `name` in the unit of its other name `wanted`: 15 of RTL_ALT_M is 1500 of RTL_ALT.

    A value keeps its type where both names have one unit.
    """
    renamed = _renamed(autopilot).get(name)
    if wanted == name or renamed is None or renamed.per_new == 1.0:
        return value
    return round(value * renamed.per_new if wanted == renamed.old else value / renamed.per_new, _DECIMALS)


def with_new_names(autopilot: int, values: Iterable[tuple[str, int | float]]) -> tuple[tuple[str, int | float], ...]:
    """Return parameters of old versions, followed by the same ones under their new names: for files."""
    given = tuple(values)
    table = _renamed(autopilot)
    newer = ((table[name].new, name, value) for name, value in given if name in table and name == table[name].old)
    return given + tuple((new, in_units_of(autopilot, new, old, value)) for new, old, value in newer)


def has_new_names(autopilot: int, names: Iterable[str]) -> bool:
    """Return whether one of these names is the new name of a parameter."""
    table = _renamed(autopilot)
    return any(name in table and name == table[name].new for name in names)


def system_id_names() -> str:
    """Return the parameters with a vehicle's system id, for messages: "SYSID_THISMAV or MAV_SYSID on ArduCopter"."""
    return ", ".join(
        f"{' or '.join(spellings(known, known.traits.link.system_id))} on {known.title}"
        for known in Autopilot
        if known.traits.link.system_id
    )


@cache
def _renamed(autopilot: int) -> dict[str, RenamedParameter]:
    renaming = link_behaviour(autopilot).renaming
    rows = () if renaming is None else renaming.names
    return {name: row for row in rows for name in (row.old, row.new)}
