"""What a vehicle says about its own failures: heard once, and answered."""

from __future__ import annotations

import pytest

from gcs.autopilots.alarms import Alarm
from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency.alarm_watch import Place
from gcs.flight.contingency.choices import Choices, OnLoss
from gcs.flight.contingency.decisions import ContingencyPolicy
from gcs.flight.contingency.detection import DetectionLimits, Incident, IncidentKind, VehicleWatch
from gcs.flight.contingency.policy import State
from gcs.flight.monitoring.progress import Action
from gcs.link.wire.message import Message
from gcs.mavlink import PREARM_CHECK

ARDUPILOT, PX4 = (known.traits.flight for known in Autopilot)
BATTERY, GYRO = 0x2000000, 0x1
ALOFT, LOW, LANDS = Place(20.0, flies=True), Place(0.1, flies=False), Place(20.0, flies=False, sure_m=4.0)


def watch() -> VehicleWatch:
    return VehicleWatch(3, ARDUPILOT, DetectionLimits(), 100.0, frozenset({ARDUPILOT.guided}))


def beat(ours: VehicleWatch, unix_s: float, *, armed: bool = True, status: int = 4) -> None:
    fields = {"base_mode": 128 * armed | 1, "custom_mode": ARDUPILOT.guided, "system_status": status}
    ours.receive(Message("HEARTBEAT", fields, 3, 1), unix_s)


def moves(ours: VehicleWatch, unix_s: float, down_mps: float) -> None:
    motion = dict.fromkeys(("x", "y", "z", "vx", "vy"), 0.0)
    ours.receive(Message("LOCAL_POSITION_NED", {"time_boot_ms": 1, **motion, "vz": down_mps}, 3, 1), unix_s)


def senses(ours: VehicleWatch, unix_s: float, unhealthy: int, pct: int = 88) -> None:
    fields = {"onboard_control_sensors_enabled": BATTERY | GYRO | PREARM_CHECK, "battery_remaining": pct}
    fields["onboard_control_sensors_health"] = (BATTERY | GYRO | PREARM_CHECK) & ~unhealthy
    ours.receive(Message("SYS_STATUS", fields, 3, 1), unix_s)


def told(found: list[Incident]) -> list[tuple[IncidentKind, str]]:
    return [(incident.kind, incident.detail) for incident in found]


@pytest.mark.parametrize(
    ("autopilot", "text", "alarm"),
    [
        (ARDUPILOT, "Battery 1 is low 10.00V used 378 mAh", Alarm.BATTERY_LOW),
        (ARDUPILOT, "Battery 1 is critical 9.80V used 400 mAh", Alarm.BATTERY_CRITICAL),
        (ARDUPILOT, "Battery Failsafe", Alarm.BATTERY_LOW),
        (ARDUPILOT, "Crash: Disarming: AngErr=78>30, Accel=1.2<3.0", Alarm.CRASH),
        (ARDUPILOT, "Potential Thrust Loss (3)", Alarm.MOTOR),
        (ARDUPILOT, "EKF variance", Alarm.ESTIMATOR),
        (ARDUPILOT, "EKF3 lane switch 1", Alarm.ESTIMATOR),
        (ARDUPILOT, "GPS Glitch or Compass error", Alarm.GNSS),
        (ARDUPILOT, "Vibration compensation ON", Alarm.VIBRATION),
        (ARDUPILOT, "Failsafe: Terrain data missing", Alarm.TERRAIN),
        (ARDUPILOT, "Fence Breached", Alarm.FENCE),
        (ARDUPILOT, "EKF3 IMU0 MAG0 in-flight yaw alignment complete", None),
        (ARDUPILOT, "Glitch cleared", None),
        (ARDUPILOT, "PreArm: Battery 1 below minimum arming voltage", None),
        (ARDUPILOT, "Fence Indexed OK", None),
        (PX4, "Low battery level, return advised", Alarm.BATTERY_LOW),
        (PX4, "Critical battery level, landing advised", Alarm.BATTERY_CRITICAL),
        (PX4, "Geofence: approaching or outside geofence", Alarm.FENCE),
        (PX4, "Attitude failure (roll)", Alarm.CRASH),
        (PX4, "Mission finished, landed", None),
        (PX4, "RTL: unsupported MAV_FRAME", None),
    ],
)
def test_texts_that_raise_an_alarm(autopilot: object, text: str, alarm: Alarm | None) -> None:
    assert autopilot.alarms.alarm(text) is alarm  # type: ignore[attr-defined]


def test_a_low_voltage_counts_although_the_percentage_is_high() -> None:
    """As recorded: 10 V under load, "Battery 1 is low", 88 % by the current."""
    ours = watch()
    beat(ours, 100.0)
    senses(ours, 100.1, 0)
    assert ours.look(100.2, place=ALOFT) == []
    ours.receive(Message("STATUSTEXT", {"severity": 4, "text": "Battery 1 is low 10.00V used 378 mAh"}, 3, 1), 100.3)
    assert ours.look(102.2, place=ALOFT) == []  # its own failsafe may answer first
    assert told(ours.look(102.4, place=ALOFT)) == [
        (IncidentKind.BATTERY_LOW, "the vehicle says: Battery 1 is low 10.00V used 378 mAh")
    ]
    assert ours.remaining_pct == 20
    senses(ours, 102.5, 0, pct=15)
    assert (ours.remaining_pct, told(ours.look(102.6, place=ALOFT))) == (15, [(IncidentKind.BATTERY_LOW, "15 % left")])
    ours.receive(Message("BATTERY_STATUS", {"charge_state": 3}, 3, 1), 102.7)
    assert [one.kind for one in ours.look(104.8, place=ALOFT)] == [IncidentKind.BATTERY_CRITICAL]
    assert ours.remaining_pct == 10


def test_a_sensor_that_fails_in_flight_is_told_once_and_one_that_was_ailing_before_is_not() -> None:
    ours = watch()
    beat(ours, 100.0)
    senses(ours, 100.1, GYRO | PREARM_CHECK)
    senses(ours, 100.6, GYRO | BATTERY)
    assert ours.look(100.7, place=ALOFT) == []  # one report may be wrong
    senses(ours, 101.1, GYRO | BATTERY | PREARM_CHECK)
    assert told(ours.look(101.2, place=ALOFT)) == [(IncidentKind.ALARM, "not healthy any more: battery")]
    senses(ours, 101.6, GYRO | BATTERY)
    assert ours.look(101.7, place=ALOFT) == []
    assert told(ours.look(103.2, place=ALOFT)) == [(IncidentKind.BATTERY_LOW, "the vehicle says: battery not healthy")]


def test_a_sensor_that_is_not_the_battery_says_nothing_of_the_charge() -> None:
    ours = watch()
    beat(ours, 100.0)
    senses(ours, 100.1, 0)
    senses(ours, 100.6, GYRO)
    senses(ours, 101.1, GYRO)
    assert [kind for kind, _ in told(ours.look(104.0, place=ALOFT))] == [IncidentKind.ALARM]


def test_a_battery_failsafe_that_takes_over_is_one_incident() -> None:
    ours = watch()
    beat(ours, 100.0)
    ours.receive(Message("STATUSTEXT", {"severity": 4, "text": "Battery Failsafe"}, 3, 1), 100.3)
    fields = {"base_mode": 129, "custom_mode": ARDUPILOT.returning, "system_status": 5}
    ours.receive(Message("HEARTBEAT", fields, 3, 1), 100.5)
    found = [kind for n in range(28) for kind, _ in told(ours.look(100.5 + n / 10, place=ALOFT))]
    assert found == [IncidentKind.FAILSAFE]
    assert ours.remaining_pct == 20


def test_a_critical_status_in_the_ordered_mode_is_told_after_two_seconds() -> None:
    ours = watch()
    for tenth in range(40):
        beat(ours, 100.0 + tenth / 10.0, status=5 if tenth >= 10 else 4)
        found = told(ours.look(100.0 + tenth / 10.0, place=ALOFT))
        assert found == ([(IncidentKind.ALARM, "system status critical")] if tenth == 31 else [])


def test_motors_that_stop_in_the_air_are_an_incident_at_the_first_heartbeat_of_a_vehicle_that_falls() -> None:
    ours = watch()
    beat(ours, 100.0)
    moves(ours, 100.0, 0.1)
    beat(ours, 101.0, armed=False)
    assert ours.look(101.1, place=ALOFT) == []
    moves(ours, 101.2, 2.5)
    assert told(ours.look(101.2, place=ALOFT)) == [(IncidentKind.MOTORS_STOPPED, "")]
    beat(ours, 102.0, armed=False)
    assert ours.look(102.1, place=LOW) == []


@pytest.mark.parametrize(("place", "fell"), [(ALOFT, True), (LANDS, True), (LOW, False)])
def test_without_a_fall_two_heartbeats_must_say_so_above_ground(place: Place, fell: bool) -> None:
    """A vehicle that landed is disarmed too; its height may be off by the navigation error."""
    ours = watch()
    beat(ours, 100.0)
    beat(ours, 101.0, armed=False)
    assert ours.look(101.1, place=place) == []
    beat(ours, 102.0, armed=False)
    assert bool(ours.look(102.1, place=place)) is fell


@pytest.mark.parametrize(("place", "fell"), [(ALOFT, True), (LANDS, False)])
def test_one_that_lands_without_a_fix_and_disarms_has_landed_whatever_height_it_reports(
    place: Place, fell: bool
) -> None:
    ours = watch()
    beat(ours, 100.0)
    ours.receive(Message("GPS_RAW_INT", {"fix_type": 1}, 3, 1), 100.1)
    ours.look(100.2, place=place)
    for second in (101.0, 102.0):
        beat(ours, second, armed=False)
        found = told(ours.look(second + 0.1, place=place))
    assert ((IncidentKind.MOTORS_STOPPED, "") in found) is fell


def test_a_vehicle_that_was_never_armed_did_not_stop() -> None:
    ours = watch()
    for second in range(3):
        beat(ours, 100.0 + second, armed=False)
        assert ours.look(100.5 + second, place=ALOFT) == []


@pytest.mark.parametrize(("on_loss", "action"), [(OnLoss.LAND, Action.LAND), (OnLoss.RETURN, Action.RETURN)])
def test_the_others_follow_on_loss_when_one_falls(on_loss: OnLoss, action: Action) -> None:
    policy = ContingencyPolicy((1, 2, 3), 1, Choices(on_loss=on_loss))
    orders = policy.take(Incident(IncidentKind.MOTORS_STOPPED, 2, 100.0))
    assert [(order.sysid, order.action) for order in orders] == [(1, action), (3, action)]
    assert policy.states[2] is State.LOST
    assert policy.take(Incident(IncidentKind.ALARM, 1, 101.0, "not healthy any more: gyro")) == []
