"""The common start of missions is brought forward on all vehicles or on none, on a clock of its own."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FlightError, PeerRefusal
from gcs.flight.execution.common_start import CommonStart
from gcs.link.session.upload_fleet import Holdings
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.mission.model import MissionItem
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.trajectory.plan import Plan
from tests.virtual_clock import VirtualLoop

BEGAN_S = 1_700_000_000.25  # 22:13:20.25 UTC


class Time:
    """The fleet's time, `rate` times as fast as the loop's."""

    def __init__(self, rate: float = 1.0) -> None:
        self.rate = rate
        self._loop = asyncio.get_running_loop()
        self._began_s = self._loop.time()

    def sure_s(self) -> float:
        return BEGAN_S + self.rate * (self._loop.time() - self._began_s)

    async def until(self, unix_s: float) -> None:
        while self.sure_s() < unix_s:
            await asyncio.sleep(0.01)


@dataclass
class Vehicle:
    """Takes `takes_s` for each change, and refuses those numbered in `refuses`."""

    takes_s: tuple[float, ...] = (0.5, 0.5, 0.5)
    refuses: tuple[int, ...] = ()
    looked_first: list[bool] = field(default_factory=list)
    starts: list[tuple[float, ...]] = field(default_factory=list)  # hours, minutes, seconds as asked

    async def replace_items(self, items: Mapping[int, MissionItem], *, look_first: bool = False) -> None:
        number = len(self.looked_first)
        self.looked_first.append(look_first)
        assert list(items) == [1], "the wait after the take-off only"
        await asyncio.sleep(self.takes_s[number])
        if number in self.refuses:
            raise PeerRefusal("vehicle 2 refused.")
        self.starts.append(items[1].params[1:])


@dataclass
class Brought:
    """What became of the start."""

    vehicles: dict[int, Vehicle]
    provisional_s: int = 0
    start_s: int = 0
    hovered_s: float = 0.0
    took_s: float = 0.0
    loads: tuple[VehicleLoad, ...] = ()
    held: Holdings | None = None
    said: str = ""
    error: FlightError | None = None


def brought(
    plan: Plan, *vehicles: Vehicle, ahead_s: float = 100.0, hovers_after_s: float = 20.0, rate: float = 1.0
) -> Brought:
    """Choose the provisional start, climb, and bring the start forward."""
    loads = [VehicleLoad(mission) for mission in build_missions(plan, firmware=Autopilot.ARDUPILOT)]
    found = Brought(dict(zip(plan.sysids, vehicles, strict=True)))

    async def work() -> None:
        time = Time(rate)
        start = CommonStart(found.vehicles, time, loads, ahead_s)  # type: ignore[arg-type]
        found.provisional_s = start.unix_s
        held = Holdings(plan.hash, {load.sysid: load.digest(plan.hash) for load in start.loads})
        await asyncio.sleep(hovers_after_s / rate)
        found.hovered_s = time.sure_s()
        try:
            found.held, found.said = await start.bring_forward(held)
        except FlightError as error:
            found.error = error
        found.took_s = time.sure_s() - found.hovered_s
        found.start_s, found.loads = start.unix_s, tuple(start.loads)

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(work())
    return found


def waits_for(found: Brought) -> set[tuple[float, ...]]:
    """Hours, minutes and seconds that the verified loads wait for; the proof is of these loads."""
    assert found.held is not None
    assert found.held.digests == {load.sysid: load.digest(found.held.plan_hash) for load in found.loads}
    return {load.mission.items[1].params for load in found.loads}


def test_the_start_is_the_next_whole_second_8_s_after_all_hover(hop: Plan) -> None:
    found = brought(hop, Vehicle(), Vehicle(), Vehicle())
    assert found.provisional_s == 1_700_000_101, "100 s ahead, rounded up"
    assert found.start_s == 1_700_000_029, "20 s of climb and 8 s, rounded up"
    assert waits_for(found) == {(-1.0, 22.0, 13.0, 49.0)}
    assert [one.starts for one in found.vehicles.values()] == [[(22.0, 13.0, 49.0)]] * 3
    assert [one.looked_first for one in found.vehicles.values()] == [[False]] * 3
    assert found.said == "start their missions at 22:13:49 UTC, 9 s after all hovered"
    assert found.took_s == pytest.approx(0.5, abs=0.05)


def test_a_provisional_start_that_is_no_later_stays(hop: Plan) -> None:
    found = brought(hop, Vehicle(), Vehicle(), Vehicle(), ahead_s=28.0)
    assert found.start_s == found.provisional_s == 1_700_000_029
    assert [one.starts for one in found.vehicles.values()] == [[]] * 3
    assert found.said == "keep their start at 22:13:49 UTC, in 9 s"


@pytest.mark.parametrize("ahead_s", [22.0, 5.0])
def test_a_provisional_start_that_cannot_be_kept_any_more_moves(hop: Plan, ahead_s: float) -> None:
    """Upload and take-off took longer than the time that was left for them; the vehicles hover, so nothing is lost."""
    found = brought(hop, Vehicle(), Vehicle(), Vehicle(), ahead_s=ahead_s)
    assert found.provisional_s < found.hovered_s + 3.0
    assert found.start_s == 1_700_000_029
    assert waits_for(found) == {(-1.0, 22.0, 13.0, 49.0)}


def test_if_the_later_start_is_refused_the_flight_ends(hop: Plan) -> None:
    found = brought(hop, Vehicle(), Vehicle(refuses=(0, 1, 2)), Vehicle(), ahead_s=5.0)
    assert found.error is not None
    assert "vehicle 2 refused" in found.error.message


def test_vehicles_faster_than_the_clock_get_a_second_of_the_clock(hop: Plan) -> None:
    quick = Vehicle((0.1,))
    assert brought(hop, quick, Vehicle((0.1,)), Vehicle((0.1,)), rate=20.0, ahead_s=200.0).start_s == 1_700_000_041


def test_a_slow_link_gets_a_second_attempt_with_more_time(hop: Plan) -> None:
    """The first attempt ends 3 s before its start, 5.75 s after the hover; the next gets 1.5 times that and 3 s."""
    found = brought(hop, Vehicle(), Vehicle((6.0, 6.0)), Vehicle())
    assert found.start_s == 1_700_000_038, "20.25 + 5.75 + 11.625 s, rounded up"
    assert waits_for(found) == {(-1.0, 22.0, 13.0, 58.0)}
    assert len(found.vehicles[2].starts) == 1, "the first change was given up"
    assert found.took_s == pytest.approx(11.75, abs=0.1)


def test_if_a_vehicle_refuses_all_get_the_provisional_start_back(hop: Plan) -> None:
    found = brought(hop, Vehicle(), Vehicle(refuses=(0, 1)), Vehicle())
    assert found.start_s == found.provisional_s
    assert waits_for(found) == {(-1.0, 22.0, 15.0, 1.0)}
    for vehicle in found.vehicles.values():
        assert vehicle.looked_first == [False, False, True], "two attempts, and what is on board is looked at first"
        assert vehicle.starts[-1] == (22.0, 15.0, 1.0)
    assert found.said.startswith("keep their start at 22:15:01 UTC, in 79 s: vehicle 2 refused.")


def test_a_start_that_is_not_known_on_a_vehicle_ends_the_flight(hop: Plan) -> None:
    found = brought(hop, Vehicle(), Vehicle(refuses=(0, 1, 2)), Vehicle())
    assert found.error is not None
    assert found.error.message.startswith(
        "it is unknown at what time each mission would start. vehicle 2 refused. Then vehicle 2 refused."
    )
    assert "check the links" in found.error.hint


def test_the_provisional_start_is_set_back_3_s_before_it_or_never(hop: Plan) -> None:
    """A vehicle that is too slow for that: provisional in 22 s, refused twice at once, then 30 s for the third."""
    slow = Vehicle((0.1, 0.1, 30.0), refuses=(0, 1))
    found = brought(hop, slow, Vehicle(), Vehicle(), ahead_s=42.0)
    assert found.error is not None
    assert "was not verified on every vehicle in time" in found.error.message
    assert found.took_s == pytest.approx(found.provisional_s - 3.0 - found.hovered_s, abs=0.1)
