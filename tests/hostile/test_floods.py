"""Floods on the port of a flight: bytes that keep a parser busy, and systems that nobody knows. All fly on."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.hostile.attacker import Attacker
from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import Ended, Ground, fly_arguments

HUGE = 65_000
GARBAGE = (
    b"\xfe" * HUGE,
    b"\xfd" * HUGE,
    bytes([0xFD, 255, 1, 0, 0, 1, 1, 0, 0, 0]) * 6_500,
    bytes([0xFE, 251, 0, 1, 1, 110]) * 10_000,
)


def flown(ground: Ground, attack: Callable[[], object]) -> Ended:
    """The flight to its end, attacked from the first second of its plan on."""
    ground.until("flying")
    while ground.running:
        attack()
    return ground.ended()


def events(flights: Path) -> list[dict[str, object]]:
    (file,) = flights.glob("*/events.jsonl")
    return [json.loads(line) for line in file.read_text().splitlines()]


@pytest.mark.parametrize(
    "autopilot", [pytest.param("ardupilot", marks=pytest.mark.slow), pytest.param("px4", marks=pytest.mark.long)]
)
def test_bytes_that_are_no_frames_hold_nothing_up(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, autopilot: str
) -> None:
    world, port = vehicles(autopilot)
    with Attacker(port) as stranger, Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        done = flown(ground, lambda: stranger.flood(GARBAGE, 300.0, 0.5))
    assert done.code == 0, done.output
    assert " lost" not in done.output
    assert "dropped unread" in done.output
    assert stranger.sent > 100
    assert all_down(world)
    assert abs(world.airframes.truth[0, :2] - [60.0, 20.0]).max() < 1.0


@pytest.mark.long
def test_the_heartbeats_of_all_other_systems_are_counted_and_told_once(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path
) -> None:
    world, port = vehicles("ardupilot")
    others = [n for n in range(1, 255) if n not in world.sysids]
    with Attacker(port) as stranger, Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        beats = [
            stranger.frame(
                "HEARTBEAT",
                n,
                type=2,
                autopilot=3,
                base_mode=217,
                custom_mode=4,
                system_status=4,
                mavlink_version=3,
            )
            for n in others
        ]
        done = flown(ground, lambda: stranger.flood(beats, 9_000.0, 0.5))
        answers = stranger.heard()
    assert done.code == 0, done.output
    assert done.output.count(f"heard {len(others)} systems that are not in the plan") == 1, done.output
    assert answers == [], "strangers are not spoken to"
    assert stranger.sent > 1_000
    assert all_down(world)
    told = [event for event in events(tmp_path) if "not in the plan" in str(event["what"])]
    assert len(told) == 1
    (log,) = tmp_path.glob("*/telemetry.tlog")
    assert log.stat().st_size < 5_000_000


@pytest.mark.long
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_flood_from_many_ports_and_every_system_at_once(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, autopilot: str
) -> None:
    world, port = vehicles(autopilot, speedup=2.0)
    crowd = [Attacker(port) for _ in range(40)]
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        while ground.running:
            for n, one in enumerate(crowd):
                for sysid in range(1, 255, 5):
                    one.heartbeat(sysid + n % 5, armed=False)
                one.throw(b"\xfe" * 2_000)
            time.sleep(0.05)
        done = ground.ended()
    assert done.code == 0, done.output
    assert all_down(world)
