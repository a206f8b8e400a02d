"""How much telemetry fits into a radio that all vehicles share, beside setpoints and commands.

Sizes are those of MAVLink 2 frames with full payloads; a byte takes ten bits on a serial line.
"""

import math

from gcs.errors import UsageError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.options import POSITION_HZ, STATE_HZ

_BITS_PER_BYTE = 10
_POSITION_BYTES, _ATTITUDE_BYTES, _STATE_BYTES, _SETPOINT_BYTES = 40, 40, 45, 65
_STATES = 10  # kinds of message that show the state of a vehicle, with its HEARTBEAT
_USED = 0.6  # of a radio: it changes direction, and what was lost is sent again
LEAST_SHARE = 0.1  # a position and a state every second or two: less shows no incident in time


def full_telemetry_Bps(vehicles: int) -> float:
    """Bytes per second of all vehicles at the full telemetry rates."""
    return vehicles * (POSITION_HZ * (_POSITION_BYTES + _ATTITUDE_BYTES / 2.0) + STATE_HZ * _STATES * _STATE_BYTES)


def telemetry_share(baud: int | None, vehicles: int, mode: FlightMode, setpoint_rate_hz: float) -> float:
    """Return the share of the full telemetry rates that fits into a radio of `baud`; 1 where its baud is not known.

    Raises UsageError if setpoints and the least telemetry do not fit.
    """
    if baud is None:
        return 1.0
    room_Bps = _USED * baud / _BITS_PER_BYTE
    setpoints_Bps = vehicles * setpoint_rate_hz * _SETPOINT_BYTES if mode is FlightMode.STREAM else 0.0
    full_Bps = full_telemetry_Bps(vehicles)
    share = (room_Bps - setpoints_Bps) / full_Bps
    if share >= LEAST_SHARE:
        return min(share, 1.0)
    needed_Bps = setpoints_Bps + LEAST_SHARE * full_Bps
    streamed = f"setpoints at {setpoint_rate_hz:g} Hz and " if setpoints_Bps else ""
    rate_hz = math.floor(10.0 * (room_Bps - LEAST_SHARE * full_Bps) / (vehicles * _SETPOINT_BYTES)) / 10.0
    slower = f", or set `setpoint_rate_hz` to {rate_hz:.1f} or less" if rate_hz >= 2.0 else ""
    raise UsageError(
        f"a radio of {baud} baud carries about {room_Bps:.0f} bytes a second; {streamed}the least telemetry of "
        f"{vehicles} vehicles need {needed_Bps:.0f}.",
        hint=f"fly --mode mission{slower}" if setpoints_Bps else "use a faster radio, or one for every few vehicles",
    )
