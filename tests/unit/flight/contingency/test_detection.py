"""What messages say of trouble, each thing once."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from gcs.autopilots.columns import FlightBehaviour
from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency.detection import DetectionLimits, Incident, IncidentKind, VehicleWatch
from gcs.link.wire.message import Message
from gcs.mavlink import CopterMode, px4_mode

MOTION = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz"), 0.0)
PLACE = Message("LOCAL_POSITION_NED", {"time_boot_ms": 1, **MOTION})

ARDUPILOT = Autopilot.ARDUPILOT.traits.flight


PX4 = Autopilot.PX4.traits.flight


def watch(unix_s: float = 100.0, behaviour: FlightBehaviour = ARDUPILOT) -> VehicleWatch:
    return VehicleWatch(3, behaviour, DetectionLimits(), unix_s, frozenset({behaviour.guided}))


def kinds(found: list[Incident]) -> list[IncidentKind]:
    assert all(incident.sysid == 3 for incident in found)
    return [incident.kind for incident in found]


def test_silence_is_told_twice_and_its_end_with_the_first_position() -> None:
    ours = watch()
    ours.receive(PLACE, 100.0)
    assert kinds(ours.look(100.0)) == []
    assert kinds(ours.look(102.9)) == []
    assert kinds(ours.look(103.1)) == [IncidentKind.LINK_LOST]
    assert kinds(ours.look(109.9)) == []
    assert kinds(ours.look(110.1)) == [IncidentKind.VEHICLE_LOST]
    ours.receive(Message("HEARTBEAT", {"custom_mode": ARDUPILOT.guided}), 120.0)
    assert kinds(ours.look(120.0)) == []  # where is it?
    ours.receive(PLACE, 120.3)
    (back,) = ours.look(120.3, usable=False)
    assert back.unix_s == 120.3
    assert back.kind is IncidentKind.LINK_BACK
    assert not back.usable
    assert kinds(ours.look(120.4)) == []


def test_a_position_that_is_no_number_does_not_end_a_silence() -> None:
    ours = watch()
    assert kinds(ours.look(111.0)) == [IncidentKind.VEHICLE_LOST]
    ours.receive(Message("LOCAL_POSITION_NED", {"time_boot_ms": 1, **MOTION, "vy": math.inf}), 112.0)
    assert kinds(ours.look(112.0)) == []
    ours.receive(PLACE, 112.5)
    assert kinds(ours.look(112.5)) == [IncidentKind.LINK_BACK]


def test_a_vehicle_that_is_lost_between_two_looks_is_not_told_to_be_silent_afterwards() -> None:
    ours = watch()
    assert kinds(ours.look(111.0)) == [IncidentKind.VEHICLE_LOST]
    assert kinds(ours.look(111.1)) == []
    ours.receive(PLACE, 112.0)
    assert kinds(ours.look(112.0)) == [IncidentKind.LINK_BACK]


def test_of_a_silent_vehicle_nothing_else_is_told() -> None:
    """Its last fix was bad; whether it still is, nobody knows."""
    ours = watch()
    ours.receive(PLACE, 100.0)
    ours.receive(Message("GPS_RAW_INT", {"fix_type": 1}), 100.0)
    assert kinds(ours.look(100.0)) == [IncidentKind.GNSS_LOST]
    assert kinds(ours.look(103.1)) == [IncidentKind.LINK_LOST]
    assert kinds(ours.look(108.5)) == []
    ours.receive(PLACE, 109.0)
    assert kinds(ours.look(109.0)) == [IncidentKind.LINK_BACK, IncidentKind.GNSS_GONE]


def test_a_standstill_of_this_program_is_no_silence() -> None:
    ours = watch()
    ours.receive(PLACE, 100.0)
    assert kinds(ours.look(100.0)) == []
    ours.excuse(20.0, 120.0)
    assert kinds(ours.look(122.9)) == []
    assert kinds(ours.look(123.1)) == [IncidentKind.LINK_LOST]


def test_a_failsafes_text_does_not_become_old_in_a_standstill_of_this_program() -> None:
    """The texts are read first, at the time of the last check: then it is known for how long nothing was read."""

    def left(mode_s: float) -> list[Incident]:
        ours = watch()
        ours.receive(Message("HEARTBEAT", {"custom_mode": ARDUPILOT.guided}), 100.0)
        ours.look(100.0)
        ours.receive(Message("STATUSTEXT", {"text": "GCS Failsafe"}), 100.0)
        ours.excuse(15.0, 115.0)
        ours.receive(Message("HEARTBEAT", {"custom_mode": ARDUPILOT.returning}), mode_s)
        found = ours.look(mode_s)
        return found + ours.look(mode_s + 1.6)

    assert kinds(left(115.0)) == [IncidentKind.FAILSAFE]
    assert kinds(left(117.9)) == [IncidentKind.FAILSAFE]
    assert kinds(left(118.2)) == [IncidentKind.MODE_LEFT], "the text is 3 s old"


def test_a_vehicle_that_was_lost_before_the_watch_is_back_with_its_first_position() -> None:
    ours = watch()
    ours.never_heard()
    ours.begin(100.0)
    assert kinds(ours.look(100.0)) == kinds(ours.look(120.0)) == []
    ours.receive(Message("HEARTBEAT", {"custom_mode": ARDUPILOT.guided}), 130.0)
    assert kinds(ours.look(130.0)) == []
    ours.receive(PLACE, 130.5)
    (back,) = ours.look(130.5)
    assert (back.kind, back.usable) == (IncidentKind.LINK_BACK, True)  # it is near its place, and in an ordered mode
    other = watch()
    other.never_heard()
    other.receive(PLACE, 130.5)
    (back,) = other.look(130.5)
    assert back.usable  # nothing is known against it


def test_a_watch_begins_with_the_flight() -> None:
    ours = watch()
    ours.begin(150.0)
    assert kinds(ours.look(152.9)) == []
    assert kinds(ours.look(153.1)) == [IncidentKind.LINK_LOST]
    theirs = watch()
    theirs.begin(150.0, ARDUPILOT.hold)
    assert kinds(theirs.look(150.0) + theirs.look(151.6)) == [IncidentKind.MODE_LEFT]


def test_a_position_in_a_burst_of_messages_ends_a_silence() -> None:
    ours = watch()
    assert kinds(ours.look(104.0)) == [IncidentKind.LINK_LOST]
    ours.receive(PLACE, 104.1)
    assert kinds(ours.look(160.0)) == [IncidentKind.LINK_BACK]


def test_incidents_bear_the_time_of_the_look_and_what_was_seen() -> None:
    ours = watch()
    ours.receive(Message("SYS_STATUS", {"battery_remaining": 9}), 100.0)
    shows(ours, ARDUPILOT.hold, 100.0)
    found = ours.look(100.0) + ours.look(101.5) + ours.look(104.75) + ours.look(114.5)
    assert [(one.unix_s, one.kind, one.detail) for one in found] == [
        (100.0, IncidentKind.BATTERY_CRITICAL, "9 % left"),
        (101.5, IncidentKind.MODE_LEFT, "now in LOITER"),
        (104.75, IncidentKind.LINK_LOST, "silent for 4.8 s"),
        (114.5, IncidentKind.VEHICLE_LOST, "silent for 14.5 s"),
    ]
    theirs = watch()
    says(theirs, "Battery Failsafe", 101.0)
    shows(theirs, ARDUPILOT.returning, 101.0)
    theirs.receive(Message("GPS_RAW_INT", {"fix_type": 1}), 101.0)
    found = theirs.look(101.25)
    theirs.receive(Message("FENCE_STATUS", {"breach_status": 1}), 101.5)
    theirs.receive(Message("GPS_RAW_INT", {"fix_type": 3}), 101.5)
    found += theirs.look(101.75)
    assert [(one.unix_s, one.kind) for one in found] == [
        (101.25, IncidentKind.GNSS_LOST),
        (101.25, IncidentKind.FAILSAFE),
        (101.75, IncidentKind.GNSS_BACK),
        (101.75, IncidentKind.FENCE),
    ]


def test_a_burst_of_messages_is_no_silence() -> None:
    """On board a minute passed; what was read in one go bears the time from before it."""
    ours = watch()
    ours.look(100.0)
    ours.receive(PLACE, 100.0)
    assert kinds(ours.look(171.0)) == []
    assert kinds(ours.look(173.9)) == []
    assert kinds(ours.look(174.1)) == [IncidentKind.LINK_LOST]


def test_who_comes_back_in_another_mode_does_not_obey() -> None:
    ours = watch()
    ours.look(104.0)
    ours.receive(Message("HEARTBEAT", {"custom_mode": ARDUPILOT.returning}), 105.0)
    ours.receive(PLACE, 105.0)
    (back,) = ours.look(105.0)
    assert (back.kind, back.usable) == (IncidentKind.LINK_BACK, False)
    assert kinds(ours.look(106.6)) == [IncidentKind.MODE_LEFT]


def test_outages_of_gnss() -> None:
    ours = watch()
    for now_s, fix in ((100.0, 6), (101.0, 1), (102.0, 1)):
        ours.receive(Message("GPS_RAW_INT", {"fix_type": fix}), now_s)
    assert kinds(ours.look(102.0)) == [IncidentKind.GNSS_LOST]
    ours.receive(Message("GPS_RAW_INT", {"fix_type": 3}), 103.0)
    assert kinds(ours.look(103.0)) == [IncidentKind.GNSS_BACK]
    ours.receive(Message("GPS_RAW_INT", {"fix_type": 0}), 104.0)
    assert kinds(ours.look(104.0)) == [IncidentKind.GNSS_LOST]
    ours.receive(Message("GPS_RAW_INT", {"fix_type": 0}), 111.9)
    assert kinds(ours.look(111.9)) == []
    (gone,) = ours.look(112.5)
    assert (gone.kind, gone.unix_s, gone.detail) == (IncidentKind.GNSS_GONE, 112.5, "no fix for 8.5 s")
    assert kinds(ours.look(113.0)) == []


def test_levels_of_the_battery() -> None:
    ours = watch()
    for left, told in (
        (-1, []),
        (21, []),
        (20, [IncidentKind.BATTERY_LOW]),
        (20, []),
        (15, [IncidentKind.BATTERY_LOW]),
        (16, []),
        (10, [IncidentKind.BATTERY_CRITICAL]),
        (5, [IncidentKind.BATTERY_CRITICAL]),
        (0, [IncidentKind.BATTERY_CRITICAL]),
    ):
        ours.receive(Message("SYS_STATUS", {"battery_remaining": left}), 100.0)
        assert kinds(ours.look(100.0)) == told


def test_fences_of_either_autopilot() -> None:
    ours = watch()
    for breached, told in ((0, []), (1, [IncidentKind.FENCE]), (1, []), (0, []), (1, [IncidentKind.FENCE])):
        ours.receive(Message("FENCE_STATUS", {"breach_status": breached}), 100.0)
        assert kinds(ours.look(100.0)) == told
    for text in ("Geofence violation\t", "Geofence: approaching or outside geofence"):
        theirs = watch(behaviour=PX4)
        theirs.receive(Message("STATUSTEXT", {"text": text, "severity": 4}), 100.0)
        assert kinds(theirs.look(100.0)) == [IncidentKind.FENCE]


def shows(ours: VehicleWatch, mode: int, unix_s: float, status: int = 4) -> None:
    ours.receive(Message("HEARTBEAT", {"custom_mode": mode, "system_status": status}), unix_s)


def says(ours: VehicleWatch, text: str, unix_s: float) -> None:
    ours.receive(Message("STATUSTEXT", {"text": text, "severity": 2}), unix_s)


def test_a_mode_without_any_sign_is_a_pilots_and_told_once() -> None:
    ours = watch()
    shows(ours, ARDUPILOT.guided, 100.0)
    assert kinds(ours.look(100.0)) == []
    shows(ours, ARDUPILOT.hold, 101.0)
    assert kinds(ours.look(101.0)) == []  # a failsafe's text may follow
    assert kinds(ours.look(102.6)) == [IncidentKind.MODE_LEFT]
    for later_s in (102.8, 105.0, 107.0):
        shows(ours, ARDUPILOT.hold, later_s)
        assert kinds(ours.look(later_s)) == []
    ours.order(ARDUPILOT.land)
    shows(ours, ARDUPILOT.land, 108.0)
    assert kinds(ours.look(108.0)) == kinds(ours.look(110.5)) == []


@pytest.mark.parametrize("text_first", [True, False])
def test_a_mode_with_a_failsafes_text_is_the_failsafes(text_first: bool) -> None:
    ours = watch()
    shows(ours, ARDUPILOT.guided, 100.0)
    if text_first:
        says(ours, "Polygon fence breached", 101.0)
    shows(ours, ARDUPILOT.returning, 101.0)
    found = ours.look(101.0)
    if not text_first:
        says(ours, "Polygon fence breached", 101.2)
        found += ours.look(101.3)
    (took,) = found
    assert (took.kind, took.takeable) == (IncidentKind.FAILSAFE, True)
    assert took.detail == "now in RTL, cause: fence"
    for later_s in (102.0, 104.0, 106.0):  # told once, however often it is shown
        shows(ours, ARDUPILOT.returning, later_s)
        assert kinds(ours.look(later_s)) == []


@pytest.mark.parametrize("status", [5, 6])
def test_px4s_failsafe_is_shown_by_the_system_status(status: int) -> None:
    ours = watch(behaviour=PX4)
    shows(ours, PX4.guided, 100.0)
    says(ours, "Failsafe activated\t", 101.0)
    shows(ours, PX4.hold, 101.6, status)
    assert kinds(ours.look(101.6)) == [IncidentKind.FAILSAFE]
    shows(ours, PX4.returning, 130.0, status)  # it goes on to another mode, long after the text
    assert kinds(ours.look(130.0)) == [IncidentKind.FAILSAFE]


def test_a_pilot_ends_px4s_failsafe() -> None:
    ours = watch(behaviour=PX4)
    shows(ours, PX4.guided, 100.0)
    says(ours, "Failsafe activated\t", 101.0)
    says(ours, "Pilot took over using sticks\t", 101.5)
    shows(ours, px4_mode(3), 101.6)
    assert kinds(ours.look(101.6)) == [IncidentKind.MODE_LEFT]
    other = watch(behaviour=PX4)
    says(other, "Failsafe activated\t", 101.0)
    shows(other, px4_mode(3), 101.6)  # by the mode switch: no text, and no failsafe any more
    assert kinds(other.look(101.6) + other.look(103.2)) == [IncidentKind.MODE_LEFT]


def test_sticks_that_move_are_a_pilots() -> None:
    ours = watch()
    shows(ours, ARDUPILOT.guided, 100.0)
    for unix_s, switch_us in ((100.0, 1100), (100.5, 1105), (101.0, 1700)):
        fields = {f"chan{n}_raw": 1500 for n in range(1, 9)} | {"chan5_raw": switch_us}
        ours.receive(Message("RC_CHANNELS", fields), unix_s)
    shows(ours, ARDUPILOT.returning, 101.0, 5)
    assert kinds(ours.look(101.0)) == [IncidentKind.MODE_LEFT]


def test_an_earlier_failsafe_of_ardupilot_proves_nothing() -> None:
    """It shows a battery's failsafe to the end of the flight."""
    ours = watch()
    shows(ours, ARDUPILOT.guided, 100.0, 5)
    assert kinds(ours.look(100.0)) == []
    shows(ours, ARDUPILOT.hold, 150.0, 5)
    assert kinds(ours.look(150.0) + ours.look(151.6)) == [IncidentKind.MODE_LEFT]


def test_a_failsafe_that_lands_or_has_no_position_is_not_ended() -> None:
    ours = watch()
    says(ours, "EKF Failsafe: changed to ALT_HOLD Mode", 100.0)
    shows(ours, CopterMode.ALT_HOLD, 100.0)
    (took,) = ours.look(100.0)
    assert not took.takeable
    theirs = watch()
    says(theirs, "Battery Failsafe", 100.0)
    shows(theirs, ARDUPILOT.land, 100.0)
    (took,) = theirs.look(100.0)
    assert not took.takeable


@pytest.mark.parametrize(
    ("text", "mode", "ours_too", "expected"),
    [
        ("Failsafe activated\t", "hold", True, (True, True)),
        ("Failsafe activated\t", "land", True, (True, True)),  # it lands because this program sent no setpoints
        ("Failsafe activated\t", "land", False, (False, False)),
        ("Critical battery, land now\t", "returning", True, (True, False)),  # that is not from the standstill
    ],
)
def test_a_failsafe_of_a_standstill_of_this_program(
    text: str, mode: str, ours_too: bool, expected: tuple[bool, bool]
) -> None:
    """What is expected: the vehicle can be taken over, and the standstill is the cause."""
    theirs = watch(behaviour=PX4)
    says(theirs, text, 101.0)
    shows(theirs, getattr(PX4, mode), 101.5, 5)
    (took,) = theirs.look(101.5, ours=ours_too)
    assert took.kind is IncidentKind.FAILSAFE
    assert (took.takeable, took.ours) == expected


def test_a_failsafe_that_is_shown_by_the_first_heartbeat_has_no_cause() -> None:
    ours = watch()
    shows(ours, ARDUPILOT.hold, 100.0, 5)
    (took,) = ours.look(100.0)
    assert (took.kind, took.detail) == (IncidentKind.FAILSAFE, "now in LOITER, cause: not told")


@pytest.mark.parametrize("first", ["Failsafe activated\t", "Critical battery, return now\t"])
def test_the_last_cause_counts(first: str) -> None:
    theirs = watch(behaviour=PX4)
    says(theirs, first, 101.0)
    says(theirs, "Geofence violation\t", 101.5)
    shows(theirs, PX4.returning, 102.0, 5)
    assert [one.detail for one in theirs.look(102.0)] == ["now in RTL, cause: fence"]


@pytest.mark.parametrize(("later_s", "cause"), [(2.9, "battery"), (3.1, "not told")])
def test_a_general_text_does_not_hide_the_cause_that_was_told_shortly_before(later_s: float, cause: str) -> None:
    theirs = watch(behaviour=PX4)
    says(theirs, "Critical battery, return now\t", 101.0)
    says(theirs, "Failsafe activated\t", 101.0 + later_s)
    shows(theirs, PX4.returning, 101.0 + later_s, 5)
    (took,) = theirs.look(101.0 + later_s)
    assert took.detail.endswith(f"cause: {cause}")


@pytest.mark.parametrize(("channel", "pilots"), [(1, True), (8, True), (9, False), (18, False)])
def test_eight_channels_are_a_pilots_and_the_others_are_the_payloads(channel: int, pilots: bool) -> None:
    ours = watch()
    shows(ours, ARDUPILOT.guided, 100.0)
    for unix_s, moved_us in ((100.0, 1100), (101.0, 1700)):
        fields = {f"chan{n}_raw": 1500 for n in range(1, 19)} | {f"chan{channel}_raw": moved_us}
        ours.receive(Message("RC_CHANNELS", fields), unix_s)
    shows(ours, ARDUPILOT.returning, 101.0, 5)
    assert kinds(ours.look(101.0)) == [IncidentKind.MODE_LEFT if pilots else IncidentKind.FAILSAFE]


def test_the_mode_that_an_order_ends_is_no_incident_until_it_was_left() -> None:
    ours = watch(behaviour=PX4)
    shows(ours, px4_mode(3), 100.0)
    ours.order(PX4.guided)
    assert kinds(ours.look(100.0) + ours.look(102.5)) == []
    shows(ours, PX4.guided, 103.0)
    assert kinds(ours.look(103.0)) == []
    shows(ours, px4_mode(3), 104.0)
    assert kinds(ours.look(104.0) + ours.look(105.6)) == [IncidentKind.MODE_LEFT]


@pytest.mark.parametrize("unused_us", [0, 65535])
def test_a_channel_that_comes_into_use_is_no_pilots_stick(unused_us: int) -> None:
    ours = watch()
    shows(ours, ARDUPILOT.guided, 100.0)
    for unix_s, moved_us in ((100.0, unused_us), (101.0, 1500), (101.2, 1440)):  # and 60 us are noise
        ours.receive(Message("RC_CHANNELS", {f"chan{n}_raw": moved_us for n in range(1, 9)}), unix_s)
    shows(ours, ARDUPILOT.returning, 101.2, 5)
    assert kinds(ours.look(101.2)) == [IncidentKind.FAILSAFE]


def test_limits_of_silence_are_passed_and_not_reached() -> None:
    ours = watch()
    assert kinds(ours.look(103.0)) == []
    assert kinds(ours.look(103.01)) == [IncidentKind.LINK_LOST]
    assert kinds(ours.look(110.0)) == []
    assert kinds(ours.look(110.01)) == [IncidentKind.VEHICLE_LOST]


def sticks(ours: VehicleWatch, unix_s: float) -> None:
    for moved_us in (1100, 1700):
        ours.receive(Message("RC_CHANNELS", {f"chan{n}_raw": moved_us for n in range(1, 9)}), unix_s)


@pytest.mark.parametrize("stood_still_s", [0.0, 20.0])
@pytest.mark.parametrize(
    ("behaviour", "sign", "critical", "fresh", "stale"),
    [
        (ARDUPILOT, lambda ours: says(ours, "GCS Failsafe", 101.0), False, "failsafe", "pilot"),
        (ARDUPILOT, lambda ours: shows(ours, ARDUPILOT.guided, 101.0, 5), True, "failsafe", "pilot"),
        (ARDUPILOT, lambda ours: sticks(ours, 101.0), True, "pilot", "failsafe"),
        (PX4, lambda ours: says(ours, "Pilot took over using sticks\t", 101.0), True, "pilot", "failsafe"),
        (PX4, lambda ours: says(ours, "Critical battery, return now\t", 101.0), True, "battery", "not told"),
    ],
)
def test_a_sign_tells_whose_choice_a_mode_is_for_three_seconds(
    behaviour: FlightBehaviour,
    sign: Callable[[VehicleWatch], None],
    critical: bool,
    fresh: str,
    stale: str,
    stood_still_s: float,
) -> None:
    """Without other signs; the seconds in which this program did not listen do not count."""

    def says_whose(age_s: float) -> str:
        ours = watch(behaviour=behaviour)
        shows(ours, behaviour.guided, 100.0)
        sign(ours)
        now_s = 101.0 + stood_still_s + age_s
        ours.excuse(stood_still_s, 101.0 + stood_still_s)
        shows(ours, behaviour.returning, now_s, 5 if critical else 4)
        (told,) = ours.look(now_s) + ours.look(now_s + 1.5)
        return f"{told.kind.value}; {told.detail}"

    assert fresh in says_whose(0.0)
    assert fresh in says_whose(3.0)
    assert stale in says_whose(3.125)


@pytest.mark.parametrize(("by_us", "pilots"), [(60, False), (-60, False), (61, True), (-61, True)])
def test_a_stick_that_moves_by_more_than_60_us_is_a_pilots(by_us: int, pilots: bool) -> None:
    ours = watch()
    shows(ours, ARDUPILOT.guided, 100.0)
    for unix_s, us in ((100.0, 1500), (101.0, 1500 + by_us)):
        ours.receive(Message("RC_CHANNELS", {f"chan{n}_raw": us if n == 3 else 1100 for n in range(1, 9)}), unix_s)
    shows(ours, ARDUPILOT.returning, 101.0, 5)
    assert kinds(ours.look(101.0)) == [IncidentKind.MODE_LEFT if pilots else IncidentKind.FAILSAFE]
