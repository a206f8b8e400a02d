"""ArduCopter 4.7: the recorded 4.5.6 with the parameter names and units of 4.7, and its version."""

from __future__ import annotations

from dataclasses import replace

from gcs.autopilots.ardupilot import ARDUPILOT as ROW
from gcs.mavlink import ParameterType
from sim_bridge.personality.ardupilot.behaviour import ARDUPILOT
from sim_bridge.personality.table import Param, Personality

_VERSION = (4 << 24) | (7 << 16) | (0 << 8) | 255
_NAMES = {} if ROW.link.renaming is None else {row.old: row for row in ROW.link.renaming.names}


def _renamed(param: Param) -> Param:
    row = _NAMES.get(param.name)
    if row is None:
        return param
    if row.per_new == 1.0:
        return param._replace(name=row.new)
    return Param(
        row.new,
        param.value / row.per_new,
        int(ParameterType.REAL32),
        param.low / row.per_new,
        param.high / row.per_new,
        param.sets,
        param.unit * row.per_new,
    )


def _newer(older: Personality) -> Personality:
    traits = older.param_traits
    own = _NAMES[traits.sysid].new if traits.sysid in _NAMES else traits.sysid
    banner = tuple(line.replace("V4.5.6", "V4.7.0") for line in traits.banner)
    return replace(
        older,
        edition="-4.7",
        identity=replace(older.identity, version=_VERSION),
        params=tuple(_renamed(param) for param in older.params),
        param_traits=replace(traits, sysid=own, banner=banner),
        missions=replace(older.missions, file_leftovers=False),
    )


ARDUPILOT_4_7 = _newer(ARDUPILOT)
