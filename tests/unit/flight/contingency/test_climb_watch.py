"""Take-offs that fail and recorded ones that did not."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs.flight.contingency.climb_watch import CLIMB_S, ClimbWatch
from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand, ModeFlag
from tests.real_flights import FLIGHTS, Flight, unpacked


def moved(boot_ms: int, up_m: float, up_mps: float = 0.0) -> Message:
    fields = {"time_boot_ms": boot_ms, "x": 0.0, "y": 0.0, "z": 3.0 - up_m, "vx": 0.0, "vy": 0.0, "vz": -up_mps}
    return Message("LOCAL_POSITION_NED", fields, 1, 1)


def tilted(roll_deg: float, pitch_deg: float = 0.0) -> Message:
    return Message("ATTITUDE", {"roll": math.radians(roll_deg), "pitch": math.radians(pitch_deg)}, 1, 1)


def beat(*, armed: bool) -> Message:
    return Message("HEARTBEAT", {"base_mode": int(ModeFlag.ARMED) if armed else 0}, 1, 1)


def climbed(*heights_m: float, height_m: float = 8.0) -> ClimbWatch:
    """A vehicle that was at these heights, a second apart."""
    watch = ClimbWatch(height_m, moved(60_000, 0.0))
    before_m = 0.0
    for second, up_m in enumerate(heights_m, start=1):
        watch.receive(moved(60_000 + 1000 * second, up_m, up_m - before_m))
        before_m = up_m
    return watch


@pytest.mark.parametrize(("height_m", "enough_m"), [(8.0, 1.0), (1.2, 0.6)])
def test_a_vehicle_that_stays_down_is_told_with_its_height(height_m: float, enough_m: float) -> None:
    seconds = int(CLIMB_S)
    assert climbed(*[0.4] * seconds, height_m=height_m).failure == ""
    told = climbed(*[0.4] * (seconds + 1), height_m=height_m)
    assert told.failure == f"does not climb: 0.4 m in {seconds + 1} s (required {enough_m} m)"
    assert told.on_ground
    assert climbed(*[0.4] * (seconds - 1), enough_m, enough_m, height_m=height_m).failure == ""


def test_sinking_is_told_and_when_it_is_over_but_not_one_report_of_it() -> None:
    watch = climbed(0.5, 1.5, 2.5)
    for boot_ms, up_m, up_mps in ((63_100, 1.0, -1.2), (63_200, 1.5, -0.3), (63_300, 1.1, -1.0)):
        watch.receive(moved(boot_ms, up_m, up_mps))
        assert watch.failure == ""
    watch.receive(moved(63_400, 1.2, -3.0))
    assert watch.failure == "sinks at 3.0 m/s (limit 0.8 m/s) 1.2 m up"
    assert not watch.on_ground
    watch.receive(moved(63_600, 0.1, -4.0))
    assert not watch.on_ground
    watch.receive(moved(63_700, 0.1))
    assert watch.on_ground


def test_a_recorded_vehicle_with_a_dead_motor_is_told_as_soon_as_it_tumbles() -> None:
    """ArduCopter 4.5.6, 4.2 s after the order was accepted: height and climb rate, ten times a second."""
    tumbles = ((0.14, 0.23), (0.16, 0.09), (0.15, -0.34), (0.08, -1.18), (-0.08, -1.03), (-0.05, 0.66), (0.09, 0.92))
    watch = ClimbWatch(8.0, moved(60_000, 0.0))
    told = []
    for n, (up_m, up_mps) in enumerate(tumbles):
        watch.receive(moved(64_200 + 100 * n, up_m, up_mps))
        told.append(watch.failure)
    assert told == [""] * 4 + ["sinks at 1.0 m/s (limit 0.8 m/s) -0.1 m up"] * 3


@pytest.mark.parametrize(
    ("roll_deg", "pitch_deg", "told"),
    [
        (61.0, 0.0, "is tilted by 61 deg (limit 60 deg) 0.3 m up"),
        (45.0, -50.0, "is tilted by 63 deg (limit 60 deg) 0.3 m up"),
        (40.0, 40.0, ""),
        (math.inf, 0.0, ""),
        (0.0, math.nan, ""),
        (1e9, 0.0, ""),
    ],
)
def test_a_vehicle_on_its_side_is_told(roll_deg: float, pitch_deg: float, told: str) -> None:
    watch = climbed(0.3)
    watch.receive(tilted(roll_deg, pitch_deg))
    assert watch.failure == told


def test_a_vehicle_that_stops_its_motors_by_itself_is_told() -> None:
    watch = climbed(0.3)
    watch.receive(beat(armed=False))  # sent before it was armed
    watch.receive(beat(armed=True))
    assert watch.failure == ""
    watch.receive(beat(armed=False))
    assert watch.failure == "stopped its motors by itself 0.3 m up"


@pytest.mark.parametrize("name", FLIGHTS)
def test_no_recorded_take_off_fails(name: str, tmp_path: Path) -> None:
    """From each accepted take-off to 20 s later: by then all were 10 m up."""
    flight = Flight(unpacked(name, tmp_path))
    watches: dict[int, tuple[int, ClimbWatch]] = {}
    newest: dict[int, Message] = {}
    tops_m = dict.fromkeys(range(1, 7), 0.0)
    for frame in flight.log.frames:
        message, sysid = frame.message, frame.sysid
        if message is None or sysid not in tops_m:
            continue
        fields = message.fields
        if message.name == "COMMAND_ACK" and fields["command"] == MavCommand.NAV_TAKEOFF and sysid in newest:
            before = newest[sysid]
            watches[sysid] = before.fields["time_boot_ms"], ClimbWatch(10.0, before)
        if message.name == "LOCAL_POSITION_NED":
            newest[sysid] = message
        began_ms, watch = watches.get(sysid, (0, None))
        if watch is not None and newest[sysid].fields["time_boot_ms"] - began_ms < 20_000:
            watch.receive(message)
            tops_m[sysid] = watch._top_m
            assert watch.failure == ""
    assert name == "px4-1.17dev-return-into-fence" or min(tops_m.values()) > 10.0
