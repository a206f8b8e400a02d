"""The contingency policy as one table: incident, state of the vehicle and choice -> new state, order and rule.

`gcs.flight.contingency.decisions` executes `POLICY`; tools/reference.py prints it into docs/flying.md. The first row
that applies counts.
"""

from __future__ import annotations

from gcs.flight.contingency import policy as p
from gcs.flight.contingency.detection import IncidentKind
from gcs.flight.contingency.policy import Row

KEEPS = "The vehicle keeps its order"
_K, _S, _A, _T = IncidentKind, p.State, p.Action, p.Trigger
POLICY = (
    Row(
        _K.FAILSAFE,
        frozenset({_S.STARTING, _S.FLYING}),
        "A vehicle that left its mode for a pause of this program follows setpoints again",
        _A.OBEY,
        when=p.OWN_STANDSTILL,
    ),
    *(
        Row(kind, frozenset({_S.STARTING}), "Before T0 a vehicle in trouble lands on its pad", _A.LAND)
        for kind in (_K.GNSS_GONE, _K.BATTERY_LOW, _K.BATTERY_CRITICAL, _K.FENCE, _K.FAILSAFE, _K.CONFLICT)
    ),
    Row(_K.LINK_LOST, frozenset({_S.FLYING}), "The setpoint stream continues", to=_S.SILENT),
    Row(_K.LINK_LOST, p.ALL - {_S.FLYING}, KEEPS),
    Row(
        _K.LINK_BACK,
        frozenset({_S.SILENT}),
        "A vehicle heard again in its place rejoins; its deviation fades in 8 s",
        _A.REJOIN,
        to=_S.FLYING,
        when=p.IN_PLACE,
    ),
    Row(
        _K.LINK_BACK,
        frozenset({_S.SILENT, _S.LOST}),
        "A vehicle heard again too late, off its place or in another mode returns",
        _A.RETURN,
    ),
    Row(_K.LINK_BACK, p.ALL - {_S.SILENT, _S.LOST}, KEEPS),
    Row(_K.VEHICLE_LOST, p.ALL, "A lost vehicle gets no order until it is heard again", to=_S.LOST),
    Row(_K.GNSS_LOST, p.ALL, "The vehicle flies on by its own estimate"),
    Row(_K.GNSS_BACK, p.ALL, "The vehicle flies on"),
    Row(_K.GNSS_GONE, p.AIRBORNE, "A vehicle without a position lands at once", _A.LAND),
    Row(_K.GNSS_GONE, p.ALL - p.AIRBORNE - {_S.STARTING}, KEEPS),
    Row(
        _K.BATTERY_LOW,
        p.IN_FORMATION,
        "A vehicle with a low battery finishes the plan if the reserve is left then",
        when=p.ENOUGH_TO_FINISH,
    ),
    Row(
        _K.BATTERY_LOW,
        p.IN_FORMATION,
        "A vehicle with a low battery lands at the nearest safe point",
        _A.DIVERT,
        when=p.ENOUGH_TO_DIVERT,
    ),
    Row(_K.BATTERY_LOW, p.IN_FORMATION, "A vehicle with a low battery returns", _A.RETURN, when=p.ENOUGH_TO_RETURN),
    Row(_K.BATTERY_LOW, p.IN_FORMATION, "A vehicle whose battery allows nothing else lands where it is", _A.LAND),
    Row(_K.BATTERY_LOW, p.ALL - p.IN_FORMATION - {_S.STARTING}, KEEPS),
    Row(
        _K.BATTERY_CRITICAL,
        p.IN_FORMATION | {_S.RETURNING},
        "With a critical battery a vehicle ends what it began, if the energy for it is left",
        when=p.ENOUGH_TO_FINISH,
    ),
    Row(
        _K.BATTERY_CRITICAL,
        p.AIRBORNE,
        "A vehicle with a critical battery lands at the nearest safe point",
        _A.DIVERT,
        when=p.ENOUGH_TO_DIVERT,
    ),
    Row(
        _K.BATTERY_CRITICAL,
        p.AIRBORNE,
        "A vehicle with a critical battery returns if its pad is the nearest safe point",
        _A.RETURN,
        when=p.ENOUGH_TO_RETURN,
    ),
    Row(_K.BATTERY_CRITICAL, p.AIRBORNE, "A vehicle with a critical battery lands at once", _A.LAND),
    Row(_K.BATTERY_CRITICAL, p.ALL - p.AIRBORNE - {_S.STARTING}, KEEPS),
    Row(_K.FENCE, p.IN_FORMATION, "A vehicle outside the fence returns", _A.RETURN),
    Row(_K.FENCE, p.ALL - p.IN_FORMATION - {_S.STARTING}, KEEPS),
    Row(
        _K.FAILSAFE,
        p.AIRBORNE,
        "A vehicle in its failsafe's mode is taken over again and returns",
        _A.RETURN,
        when=p.TAKEABLE,
    ),
    Row(
        _K.FAILSAFE,
        p.AIRBORNE,
        "A vehicle in its failsafe's mode is taken over again and lands at the nearest safe point",
        _A.DIVERT,
        when=p.TAKEABLE_NEAR,
    ),
    Row(
        _K.FAILSAFE,
        p.AIRBORNE | {_S.LANDING},
        "A vehicle that cannot be taken over safely from its failsafe lands",
        _A.LAND,
    ),
    Row(_K.FAILSAFE, frozenset({_S.LEFT, _S.LOST}), KEEPS),
    Row(
        _K.MODE_LEFT,
        p.OURS,
        "A vehicle in a mode that was not ordered, and no failsafe's, is left to its pilot",
        _A.LEAVE,
    ),
    Row(_K.MODE_LEFT, frozenset({_S.LEFT, _S.LOST}), KEEPS),
    Row(
        _K.CONFLICT,
        p.IN_FORMATION,
        "Vehicles that fly missions on board all brake and hold",
        _A.HOLD,
        when=p.ON_MISSIONS,
        vehicles=p.formation_of_vehicle,
    ),
    Row(
        _K.CONFLICT,
        frozenset({_S.FLYING}),
        "The yielding vehicle brakes and holds",
        _A.HOLD,
        when=p.TIME_TO_BRAKE,
        vehicles=p.yielding_vehicle,
    ),
    Row(
        _K.CONFLICT,
        frozenset({_S.FLYING, _S.HOLDING}),
        f"The upper vehicle climbs by {p.SPREAD_M:g} m",
        _A.SPREAD,
        vehicles=p.upper_vehicle,
    ),
    Row(_K.CONFLICT, p.YIELDS, "The yielding vehicle lands", _A.LAND, vehicles=p.yielding_vehicle),
    Row(_K.CONFLICT, p.ALL, "An earlier order gets time to act, or no vehicle can yield"),
    Row(
        _K.OFF_TRACK,
        p.IN_FORMATION,
        "A vehicle is off its predicted track: all vehicles brake and hold",
        _A.HOLD,
        when=p.COMPANY,
        vehicles=p.formation_of_vehicle,
    ),
    Row(_K.OFF_TRACK, p.ALL, KEEPS),
    Row(
        _K.STRANDED,
        frozenset({_S.FLYING}),
        "After a pause of this program all vehicles are led back to the plan together",
        _A.REJOIN,
        when=p.SAFE_WAY,
    ),
    Row(
        _K.STRANDED,
        p.IN_FORMATION,
        "Without a safe way back to the plan after a pause of this program, vehicles return",
        _A.RETURN,
    ),
    Row(_K.STRANDED, p.ALL - p.IN_FORMATION, KEEPS),
    Row(_K.MOTORS_STOPPED, p.ALL, "A vehicle without motors falls: no order can help it", to=_S.LOST),
    Row(_K.ALARM, p.ALL, "It is told; the vehicle keeps its order, and its autopilot its failsafes"),
    Row(
        _T.CLEAR,
        p.YIELDED,
        f"A vehicle that yielded returns after {p.CLEAR_S:g} s without a conflict",
        _A.RETURN,
        vehicles=p.clear_vehicles,
    ),
    Row(
        _T.VEHICLE_OUT,
        p.IN_FORMATION,
        "A vehicle was lost: all others land",
        _A.LAND,
        when=p.LAND_ON_LOSS,
        vehicles=p.every_vehicle,
    ),
    Row(
        _T.VEHICLE_OUT,
        p.IN_FORMATION,
        "A vehicle was lost: all others return",
        _A.RETURN,
        when=p.RETURN_ON_LOSS,
        vehicles=p.every_vehicle,
    ),
    Row(_T.VEHICLE_OUT, p.IN_FORMATION, "All others continue", when=p.CONTINUE_ON_LOSS, vehicles=p.every_vehicle),
    Row(
        _T.LEADER_OUT,
        frozenset({_S.FLYING}),
        "The next vehicle leads",
        _A.PROMOTE,
        when=p.PROMOTE,
        vehicles=p.next_leader,
    ),
    Row(
        _T.LEADER_OUT,
        p.IN_FORMATION,
        "The formation has no leader: all vehicles return",
        _A.RETURN,
        vehicles=p.every_vehicle,
    ),
    Row(
        _T.RETURN_ALL,
        p.IN_FORMATION,
        "The operator ordered all vehicles to return",
        _A.RETURN,
        vehicles=p.every_vehicle,
    ),
    Row(
        _T.NOT_OBEYED,
        frozenset({_S.HOLDING, _S.SPREAD, _S.RETURNING}),
        "A vehicle that disobeys an order to stop or to return is ordered to land",
        _A.LAND,
    ),
    Row(
        _T.START_ABORTED,
        frozenset({_S.STARTING}),
        "A vehicle was in trouble before T0: all others land on their pads",
        _A.LAND,
        vehicles=p.every_vehicle,
    ),
)
