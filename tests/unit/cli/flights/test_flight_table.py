"""The live view of `gcs fly`, drawn from a recorded flight of real autopilots and from states made up: what it shows,
in 80 and in 160 columns, and that it stays within the screen."""

from __future__ import annotations

import asyncio
import io
import math
import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from gcs.cli.flights.flight_table import AS_REPORTED, FlightTable, metres, worst_of_each_column
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.monitoring.progress import FlightPart, InFlight, NearestPair, Snapshot, Step, VehicleNow
from gcs.flight.setup.build_loads import PreparedFlight, missions_only
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.waypoints.mission_items import build_missions
from gcs.scenario.environment.no_fly import nearest_zone_m
from gcs.scenario.environment.terrain import ground_height_m
from tests.real_flights import Flight, Recorded, in_virtual_time, unpacked

WIDTHS = (80, 160)
HEARD_S = 4.0
IN_FLIGHT_S = 60.0


class Still:
    """A flight at one moment."""

    def __init__(self, snapshot: Snapshot, vehicles: tuple[VehicleNow, ...], ground_m: float = 7.5) -> None:
        self.now, self.vehicles, self.ground_m = snapshot, vehicles, ground_m
        self.asked: list[tuple[int, ...]] = []  # for whose ground margins

    def snapshot(self) -> Snapshot:
        return self.now

    predicted: PredictedTracks | None = None

    def vehicles_now(self) -> tuple[VehicleNow, ...]:
        return self.vehicles

    def ground_margins_m(self, sysids: Collection[int]) -> dict[int, float]:
        self.asked.append(tuple(sysids))
        return dict.fromkeys(sysids, self.ground_m)


def vehicle(sysid: int, **known: float | str | bool) -> VehicleNow:
    usual = VehicleNow(sysid, "GUIDED", True, 20.0, 5.0, 80.0, 0.1, 0.0, 0.3, 12.0, 20.0)
    return replace(usual, **known)  # type: ignore[arg-type]


def moment(count: int = 2, **known: object) -> Snapshot:
    every = range(1, count + 1)
    pair = NearestPair(FlightPart.FLIGHT, (1, 2), 4.876, 1.7e9)
    usual = Snapshot(
        Step.FLY, 0.45, 61.0, dict.fromkeys(every, 0.3), dict.fromkeys(every, 0.1), dict.fromkeys(every, True), 4.876,
        0.02, "mission", 120.0, 1.7e9, pair, 5.0,
    )  # fmt: skip
    return replace(usual, **known)  # type: ignore[arg-type]


def recorded_print(flight: InFlight, width: int, height: int = 40) -> Console:
    console = Console(record=True, width=width, height=height, force_terminal=True, file=io.StringIO())
    console.print(FlightTable().draw(flight, width, height))
    return console


def drawn(flight: InFlight, width: int, height: int = 40) -> list[str]:
    """The lines on a terminal. One that folds or is cut would not be among them whole."""
    text = recorded_print(flight, width, height).export_text()
    return [line.rstrip() for line in text.splitlines()]


def heard_again(folder: Path, plan_time_s: float) -> tuple[FlightSequence, Still]:
    """A flight of real autopilots after a few seconds of listening, and its state then."""
    recorded = Flight(folder)

    async def hear() -> tuple[FlightSequence, Still]:
        plan = recorded.plan
        link = Recorded(recorded.log, recorded.t0_unix_s + plan_time_s - HEARD_S)
        fleet = LinkedFleet([link])
        await link.open(lambda data, address: fleet._receive(0, data, address))
        sessions = await fleet.vehicles(plan.sysids, 15.0)
        loads, stream = missions_only(build_missions(plan)), build_stream(plan, 5.0)
        sequence = FlightSequence(plan, sessions, FlightOptions(), PreparedFlight(loads, stream))
        sequence.monitor.set_t0(recorded.t0_unix_s)
        for one in sequence.vehicles.values():
            sequence.listen(one)
        await asyncio.sleep(HEARD_S)
        sequence.monitor.watch_separation(plan.sysids)
        sequence.enter(Step.FLY)
        still = Still(sequence.snapshot(), sequence.vehicles_now())
        still.ground_m = sequence.ground_margins_m(plan.sysids)[1]
        link.close()
        return sequence, still

    return in_virtual_time(hear())


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> tuple[FlightSequence, Still]:
    return heard_again(unpacked("mixed-stream", tmp_path_factory.mktemp("mixed")), IN_FLIGHT_S)


@pytest.mark.parametrize("width", WIDTHS)
def test_a_recorded_flight_of_real_autopilots_is_shown_whole(width: int, mixed: tuple[FlightSequence, Still]) -> None:
    lines = drawn(mixed[1], width)
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    assert "…" not in text
    assert re.search(r"flying: mission +t = \d+ s of \d+ s +\d\d:\d\d:\d\d UTC", text)
    assert re.search(r"nearest: vehicles \d and \d, \d+\.\d\d m \(limit \d+\.\d\d m\)", text)
    assert AS_REPORTED in text
    rows = [line.split() for line in lines if re.match(r" *[1-6] +yes", line)]
    assert [row[0] for row in rows] == list("123456")
    assert {row[2] for row in rows} == {"GUIDED", "OFFBOARD"}
    assert len({len(row) for row in rows}) == 1  # no cell is empty, none has broken in two


def test_the_figures_are_those_of_the_vehicles_reports(mixed: tuple[FlightSequence, Still]) -> None:
    sequence, still = mixed
    scenario, views = sequence.plan.scenario, sequence.monitor.views
    for now in still.vehicles:
        view = views[now.sysid]
        north, east, down = view.position_ned_m
        assert now.height_m == -down
        assert now.speed_mps == pytest.approx(float(np.linalg.norm(view.velocity_ned_mps)))
        assert now.error_m == view.error_m
        assert 0.0 <= now.battery_pct <= 100.0
        at = np.array([north]), np.array([east])
        assert now.above_ground_m == pytest.approx(-down - float(ground_height_m(scenario.terrain, *at)[0]))
        t_s = still.now.plan_time_s
        assert t_s is not None
        assert now.zone_m == pytest.approx(float(nearest_zone_m(scenario.no_fly, np.array(t_s), *at)[0]))
        assert now.ceiling_m == scenario.limits.height_m[1] - now.height_m
        assert 0.0 < now.fence_m < 1000.0
        assert 0.0 < sequence.ground_margins_m([now.sysid])[now.sysid] <= now.above_ground_m


@pytest.mark.parametrize("width", WIDTHS)
def test_the_longest_cells_fit(width: int) -> None:
    long = vehicle(
        254, mode="mode 4294967295", height_m=-1234.5, speed_mps=123.4, battery_pct=100.0, link_age_s=123.4, loss=1.0,
        error_m=1234.56, zone_m=-123.4, above_ground_m=2000.0, fence_m=-123.4, ceiling_m=-123.4,
    )  # fmt: skip
    pair = NearestPair(FlightPart.FLIGHT, (253, 254), 123.45, 1.7e9)
    now = moment(phase=Step.READY, plan_phase="arrival-hover", plan_time_s=-1234.0, plan_end_s=12345.0, nearest=pair)
    lines = drawn(Still(now, (long, vehicle(1))), width)
    assert max(map(len, lines)) <= width
    row = next(line for line in lines if line.startswith("    254"))
    for cell in ("mode 4294967295", "-1234.5", "123.4", "100", "1234.56", "-123.4", "7.50"):
        assert cell in row
    assert any("vehicles 253 and 254, 123.45 m" in line for line in lines)


def test_what_is_not_known_and_what_is_not_there() -> None:
    unknown = VehicleNow(3, "", False, *[math.nan] * 3, math.inf, math.nan, math.nan, math.inf, math.nan)
    lines = drawn(Still(moment(plan_time_s=None, plan_phase="", nearest=None), (unknown,), math.nan), 160)
    row = next(line for line in lines if line.lstrip().startswith("3")).split()
    assert row == ["3", "no", "–", "–", "–", "–", "never", "–", "–", "none", "–", "–", "–"]
    assert not any("nearest" in line for line in lines)


def test_a_zone_that_is_entered_and_a_silent_vehicle_stand_out() -> None:
    flight = Still(moment(), (vehicle(1, zone_m=-0.019), vehicle(2, link_age_s=3.0), vehicle(3)), 60.0)
    marked = re.findall(r"\x1b\[1;31m *([^\x1b]+)\x1b", recorded_print(flight, 80).export_text(styles=True))
    assert marked == ["nearest: vehicles 1 and 2, 4.88 m (limit 5.00 m)", "-0.02", "3.0"]
    assert ">50" in "\n".join(drawn(flight, 80))


def test_fence_and_ceiling_have_columns_where_there_is_room_and_a_line_where_there_is_none() -> None:
    flight = Still(moment(), (vehicle(1, fence_m=9.5, ceiling_m=4.25), vehicle(2, fence_m=-0.5, ceiling_m=12.0)))
    narrow = drawn(flight, 80)
    assert any("fence: -0.50 m (vehicle 2)   ceiling: 4.25 m (vehicle 1)" in line for line in narrow)
    marked = re.findall(r"\x1b\[1;31m *([^\x1b]+)\x1b", recorded_print(flight, 80).export_text(styles=True))
    assert "fence: -0.50 m (vehicle 2)" in marked
    wide = drawn(flight, 160)
    assert not any("(vehicle 2)" in line for line in wide)
    (headings,) = (line for line in wide if "to ceiling" in line)
    assert headings.split("to ground")[1].split() == ["to", "fence", "to", "ceiling"]
    rows = [line.split() for line in wide if re.match(r" *[12] +yes", line)]
    assert [row[-2:] for row in rows] == [["9.50", "4.25"], ["-0.50", "12.00"]]


@pytest.mark.parametrize("height", [14, 24, 60])
def test_a_hundred_vehicles_stay_within_the_screen_and_the_worst_are_shown(height: int) -> None:
    vehicles = tuple(vehicle(n, zone_m=100.0 + n, error_m=0.001 * n) for n in range(1, 101))
    worst = {40: {"zone_m": -1.0}, 41: {"link_age_s": 9.0}, 42: {"error_m": 5.0}, 43: {"above_ground_m": 0.5}}
    worst[44] = {"battery_pct": 3.0}
    vehicles = tuple(replace(v, **worst.get(v.sysid, {})) for v in vehicles)
    flight = Still(moment(100), vehicles)
    lines = drawn(flight, 80, height)
    assert len(lines) < height
    rows = [int(line.split()[0]) for line in lines if re.match(r" *\d+ +yes", line)]
    assert worst.keys() <= set(rows) and rows == sorted(rows)
    assert f"{100 - len(rows)} vehicles more; shown are the worst of each column." in lines
    assert flight.asked == [tuple(rows)]  # the costly figure is for those alone


def test_the_choice_stands_for_some_redraws() -> None:
    table, flight = FlightTable(), Still(moment(100), tuple(vehicle(n) for n in range(1, 101)))
    table.draw(flight, 80, 20)
    flight.vehicles = (*flight.vehicles[:-1], vehicle(100, zone_m=-3.0))
    table.draw(flight, 80, 20)
    assert flight.asked[0] == flight.asked[1]
    for _ in range(20):
        table.draw(flight, 80, 20)
    assert 100 in flight.asked[-1]


def test_unknown_figures_are_not_the_worst() -> None:
    known, unknown = vehicle(1), VehicleNow(2, "", False, *[math.nan] * 3, 0.0, *[math.nan] * 4)
    assert worst_of_each_column((unknown, known), 1) == {1}


def test_metres_take_few_characters() -> None:
    given_m = (0.019, -0.02, 123.444, 999.996, 12345.6)
    assert [metres(m) for m in given_m] == ["0.02", "-0.02", "123.44", "1000", "12346"]
