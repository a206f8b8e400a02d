"""Fault injection by MAVLink command during a flight.

Clients such as MAVSDK send MAV_CMD_INJECT_FAILURE; MAV_CMD_USER_1 covers every kind of fault. Both are for the
emulator, not for the vehicle. They bypass the link faults of the vehicle; otherwise a dead link could not be repaired.

    MAV_CMD_USER_1 (31010)                         MAV_CMD_INJECT_FAILURE (420)
    1  number of the kind, as in `fault_spec`;     1  FAILURE_UNIT
       0 ends all faults of the vehicle            2  FAILURE_TYPE; 0 (OK) ends the unit's faults
    2-4  its values; NaN for a default             3  instance: motor 1 to 4, 0 for all
    5  direction: 0 both, 1 up, 2 down
    6  delay until the fault begins, simulated s
    7  duration, simulated s; 0 for no end
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gcs.errors import UsageError
from gcs.link.wire.message import Message
from gcs.mavlink import MavResult
from sim_bridge.faults import fault_spec as f
from sim_bridge.faults.fault_spec import Fault, FaultKind, LinkDirection, When, make_fault

INJECT_FAILURE = 420
USER_1 = 31010
_COMMANDS = (INJECT_FAILURE, USER_1)
_DIRECTIONS = (LinkDirection.BOTH, LinkDirection.UP, LinkDirection.DOWN)
_ALL_KINDS = 0

# FAILURE_UNIT and FAILURE_TYPE
_GYRO, _ACCEL, _MAG, _BARO, _GPS, _BATTERY, _MOTOR, _LINK = 0, 1, 2, 3, 4, 100, 101, 105
_OK, _OFF, _IS_STUCK, _GARBAGE, _WRONG, _DELAYED, _INTERMITTENT = 0, 1, 2, 3, 4, 6, 7
_SENSOR_OF = {_GYRO: 0.0, _ACCEL: 1.0, _MAG: 2.0, _BARO: 3.0, _GPS: 4.0}
_MOTORS = (1.0, 2.0, 3.0, 4.0)

_FAILURES: dict[tuple[int, int], tuple[FaultKind, tuple[float, ...]]] = {
    **{(unit, _IS_STUCK): (f.STUCK, (sensor,)) for unit, sensor in _SENSOR_OF.items()},
    (_GPS, _OFF): (f.GNSS_OUTAGE, ()),
    (_GPS, _WRONG): (f.GNSS_JUMP, (20.0, 0.0, 0.0)),
    (_BATTERY, _OFF): (f.BATTERY, (0.05,)),
    (_LINK, _OFF): (f.SILENT, ()),
    (_LINK, _GARBAGE): (f.CORRUPT, (0.3,)),
    (_LINK, _DELAYED): (f.DELAY, (0.5, 0.2)),
    (_LINK, _INTERMITTENT): (f.LOSS, (0.3,)),
}


@dataclass(frozen=True)
class FaultOrder:
    """The content of a command: kinds of fault to end, faults to begin, and the result for COMMAND_ACK."""

    result: MavResult
    ends: Sequence[FaultKind] = ()
    begins: Sequence[Fault] = ()


_REFUSED = FaultOrder(MavResult.DENIED)


def is_fault_command(message: Message) -> bool:
    """Whether a message is a fault command for the emulator."""
    return message.name in ("COMMAND_LONG", "COMMAND_INT") and message.fields["command"] in _COMMANDS


def read_order(message: Message) -> FaultOrder:
    """Return what the command orders."""
    if message.name != "COMMAND_LONG":
        return FaultOrder(MavResult.COMMAND_LONG_ONLY)
    params = [float(message.fields[f"param{i}"]) for i in range(1, 8)]
    return _injected(params) if message.fields["command"] == INJECT_FAILURE else _user_fault(params)


def _user_fault(params: Sequence[float]) -> FaultOrder:
    number, direction = params[0], params[4]
    if number == _ALL_KINDS:
        return FaultOrder(MavResult.ACCEPTED, ends=f.KINDS)
    kind = f.kind_of(round(number)) if math.isfinite(number) else None
    if kind is None or direction not in (0.0, 1.0, 2.0):
        return _REFUSED
    given = [math.nan if math.isinf(value) else value for value in params[1:4]]
    values = [
        (value.default if value.default is not None else math.nan) if math.isnan(number) else number
        for number, value in zip(given, kind.values, strict=False)
    ]
    begin_s, last_s = params[5], params[6]
    end_s = begin_s + last_s if last_s > 0 else math.inf
    try:
        fault = make_fault(kind, values, _DIRECTIONS[round(direction)], When(begin_s, end_s))
    except UsageError:
        return _REFUSED
    return FaultOrder(MavResult.ACCEPTED, begins=(fault,))


def _injected(params: Sequence[float]) -> FaultOrder:
    if not all(map(math.isfinite, params[:3])):
        return _REFUSED
    unit, kind, instance = (round(number) for number in params[:3])
    ends = (f.MOTOR,) if unit == _MOTOR else tuple(fault for (of, _), (fault, _) in _FAILURES.items() if of == unit)
    if kind == _OK and ends:
        return FaultOrder(MavResult.ACCEPTED, ends=ends)
    if (unit, kind) == (_MOTOR, _OFF):
        motors = _MOTORS if instance == 0 else (float(instance),)
        if not set(motors) <= set(_MOTORS):
            return _REFUSED
        return FaultOrder(MavResult.ACCEPTED, begins=tuple(make_fault(f.MOTOR, (motor,)) for motor in motors))
    failure = _FAILURES.get((unit, kind))
    if failure is None:
        return FaultOrder(MavResult.UNSUPPORTED)
    return FaultOrder(MavResult.ACCEPTED, begins=(make_fault(*failure),))
