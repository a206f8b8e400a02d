"""What messages say of trouble, each thing once."""

from __future__ import annotations

from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency.detection import DetectionLimits, Incident, IncidentKind, VehicleWatch
from gcs.link.wire.message import Message

PLACE = Message("LOCAL_POSITION_NED", {"time_boot_ms": 1})

ARDUPILOT = Autopilot.ARDUPILOT.traits.flight


def watch(unix_s: float = 100.0) -> VehicleWatch:
    return VehicleWatch(3, ARDUPILOT, DetectionLimits(), unix_s, frozenset({ARDUPILOT.guided}))


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
    ours.usable = False
    ours.receive(PLACE, 120.3)
    (back,) = ours.look(120.3)
    assert back.kind is IncidentKind.LINK_BACK
    assert not back.usable
    assert kinds(ours.look(120.4)) == []


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
    (back, left) = ours.look(105.0)
    assert (back.kind, back.usable) == (IncidentKind.LINK_BACK, False)
    assert left.kind is IncidentKind.MODE_LEFT


def test_outages_of_gnss() -> None:
    ours = watch()
    for now_s, fix in ((100.0, 6), (101.0, 1), (102.0, 1)):
        ours.receive(Message("GPS_RAW_INT", {"fix_type": fix}), now_s)
    assert kinds(ours.look(102.0)) == [IncidentKind.GNSS_LOST]
    ours.receive(Message("GPS_RAW_INT", {"fix_type": 3}), 103.0)
    assert kinds(ours.look(103.0)) == [IncidentKind.GNSS_BACK]
    ours.receive(Message("GPS_RAW_INT", {"fix_type": 0}), 104.0)
    assert kinds(ours.look(104.0)) == [IncidentKind.GNSS_LOST]
    ours.receive(Message("GPS_RAW_INT", {"fix_type": 0}), 112.5)
    assert kinds(ours.look(112.5)) == [IncidentKind.GNSS_GONE]
    assert kinds(ours.look(113.0)) == []


def test_levels_of_the_battery() -> None:
    ours = watch()
    for left, told in (
        (-1, []),
        (21, []),
        (20, [IncidentKind.BATTERY_LOW]),
        (15, []),
        (10, [IncidentKind.BATTERY_CRITICAL]),
        (5, []),
    ):
        ours.receive(Message("SYS_STATUS", {"battery_remaining": left}), 100.0)
        assert kinds(ours.look(100.0)) == told


def test_fences_of_either_autopilot() -> None:
    ours = watch()
    for breached, told in ((0, []), (1, [IncidentKind.FENCE]), (1, []), (0, []), (1, [IncidentKind.FENCE])):
        ours.receive(Message("FENCE_STATUS", {"breach_status": breached}), 100.0)
        assert kinds(ours.look(100.0)) == told
    theirs = watch()
    theirs.receive(Message("STATUSTEXT", {"text": "Geofence violation\t", "severity": 4}), 100.0)
    assert kinds(theirs.look(100.0)) == [IncidentKind.FENCE]


def test_a_mode_that_nobody_asked_for() -> None:
    ours = watch()
    for mode, told in (
        (ARDUPILOT.guided, []),
        (ARDUPILOT.returning, [IncidentKind.MODE_LEFT]),
        (ARDUPILOT.returning, []),
    ):
        ours.receive(Message("HEARTBEAT", {"custom_mode": mode}), 100.0)
        assert kinds(ours.look(100.0)) == told
    ours.obeys |= {ARDUPILOT.land}
    ours.receive(Message("HEARTBEAT", {"custom_mode": ARDUPILOT.land}), 100.5)
    assert kinds(ours.look(100.5)) == []
