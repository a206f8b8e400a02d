"""The landing profiles of vehicles from their telemetry: their autopilots, and the parameters that they reported."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gcs.autopilots.columns import LandingProfile
from gcs.autopilots.parameter_names import in_units_of, spellings
from gcs.autopilots.traits import traits_of
from gcs.flight.expected_motion import landing_profiles
from gcs.link.wire.message import Message
from gcs.mavlink import NO_AUTOPILOT


def reported_profiles(messages: Iterable[Message], vehicle_of: Mapping[int, int]) -> dict[int, LandingProfile]:
    """Return the landing profiles of vehicles, `vehicle_of` by MAVLink system id.

    Parameters count until a vehicle is in its landing mode: after the flight they may be restored.
    """
    autopilots: dict[int, int] = {}
    values: dict[int, dict[str, float]] = {}
    landing: set[int] = set()
    for message in messages:
        sysid = vehicle_of.get(message.sysid)
        if sysid is None:
            continue
        fields = message.fields
        if message.name == "HEARTBEAT" and fields["autopilot"] != NO_AUTOPILOT:
            autopilots[sysid] = int(fields["autopilot"])
            row = traits_of(autopilots[sysid])
            if row is not None and int(fields["custom_mode"]) == row.flight.land:
                landing.add(sysid)
        elif message.name == "PARAM_VALUE" and sysid not in landing:
            values.setdefault(sysid, {})[str(fields["param_id"])] = float(fields["param_value"])
    known = {sysid: _by_old_names(autopilot, values.get(sysid, {})) for sysid, autopilot in autopilots.items()}
    return landing_profiles(autopilots, known)


def _by_old_names(autopilot: int, values: Mapping[str, float]) -> dict[str, float]:
    row = traits_of(autopilot)
    found = {}
    for wanted in row.landing.parameters if row is not None else ():
        for name in spellings(autopilot, wanted):
            if name in values:
                found[wanted] = float(in_units_of(autopilot, wanted, name, values[name]))
    return found
