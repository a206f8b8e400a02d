"""ArduCopter and PX4 in one formation: files, returns and loads for each, one flight, and who answers on the link."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.cli.main import run as gcs
from gcs.errors import PeerError, UsageError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.setup.build_loads import build_loads
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.session.vehicle_load import read_onboard
from gcs.mission.export import mission_files
from gcs.mission.export.atomic_folder import INDEX
from gcs.mission.export.export import export
from gcs.mission.formats.any_mission import load_missions
from gcs.mission.returns.fence_rally import build_safety
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.mission.returns.rtl_cases import return_cases
from gcs.plan.plan_file import save_plan
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.sources.load import load_scenario
from sim_bridge.fleet import Fleet
from sim_bridge.sim.world import World
from tests.bridge.flying import fly, mixed_scenario
from tests.fleets import in_their_time

ARDUPILOT, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4
MIXED = (ARDUPILOT, PX4, ARDUPILOT, PX4)
NUMBERS = {1: 3, 2: 12, 3: 3, 4: 12}


@pytest.fixture(scope="module")
def mixed(repo_root: Path) -> Plan:
    return make_plan(mixed_scenario(load_scenario(repo_root / "missions" / "field")))


def unnamed(plan: Plan) -> Plan:
    """The plan of a scenario that names no autopilot."""
    data = plan.scenario.model_dump(mode="json")
    for vehicle in data["formation"]["vehicle"]:
        vehicle.pop("autopilot", None)
    return replace(plan, scenario=type(plan.scenario).model_validate(data))


def test_returns_hold_for_what_each_vehicle_does(mixed: Plan) -> None:
    safety = build_safety(mixed, mixed.autopilots)
    for row, known in enumerate(MIXED):
        values, altitude_m = dict(safety.parameters[row]), safety.returns.altitudes_m[row]
        if known is ARDUPILOT:  # it flies at the higher of its rally point and RTL_ALT
            assert values["RTL_ALT"] == pytest.approx(100.0 * altitude_m)
            assert (safety.rally[row][0].alt_m, values["RTL_LOIT_TIME"]) == (altitude_m, 5000)
            assert altitude_m == round(altitude_m)
        else:  # it adds RTL_RETURN_ALT to the height of its rally point, which is the ground
            assert values["RTL_RETURN_ALT"] == pytest.approx(altitude_m)
            assert (safety.rally[row][0].alt_m, values["RTL_LAND_DELAY"]) == (0.0, 0.0)
    worst = safety.returns.worst
    assert worst is not None
    assert worst.distance_m >= mixed.scenario.judge.separation_min_m


def test_only_ardupilot_waits_above_its_end_and_counts_from_home(mixed: Plan) -> None:
    returns = plan_returns(mixed, MIXED)
    raised = mixed.landing_points_ned_m - np.array([0.0, 0.0, 7.0])  # the landing field lies 7 m higher
    uphill = replace(mixed)
    uphill.__dict__["landing_points_ned_m"] = raised
    nearest = return_cases(uphill, MIXED, returns.speeds, 1.0)[1]
    at_end = np.isclose(nearest.to_ned_m[..., 2], raised[:, None, 2]) & np.isclose(
        nearest.to_ned_m[..., 0], raised[:, None, 0]
    )
    assert at_end.any()
    homes_m = -mixed.pads_ned_m[:, 2]
    for row, known in enumerate(MIXED):
        datum_m = nearest.datum_m[row] - homes_m[row]
        assert np.allclose(datum_m[at_end[row]], 0.0 if known is ARDUPILOT else 7.0, atol=0.1)
        waits_s = np.diff(nearest.motion(row, 20.0)[0], axis=-1)[..., 2]
        assert np.allclose(waits_s, 5.0 if known is ARDUPILOT else 0.0)


def test_an_export_has_each_vehicles_own_files(mixed: Plan, tmp_path: Path) -> None:
    index = export(mixed, tmp_path, formats=["plan", "waypoints", "param"], timed=False)
    assert index.autopilots == MIXED
    document = json.loads((tmp_path / INDEX).read_text())
    assert document["firmware"] == {"1": "ardupilot", "2": "px4", "3": "ardupilot", "4": "px4"}
    suffixes = {path.name for path in tmp_path.glob("*.param*")}
    assert suffixes == {"uav1.param", "uav2.params", "uav3.param", "uav4.params"}
    read = load_missions([tmp_path / f"uav{sysid}.plan" for sysid in mixed.sysids])
    assert tuple(mission.firmware for mission in read) == MIXED
    homes = [(tmp_path / f"uav{n}.waypoints").read_text().splitlines()[1].split("\t")[3] for n in mixed.sysids]
    assert homes == ["16", "22", "16", "22"], "ArduPilot's first item is home, PX4's the take-off"
    uniform = export(mixed, tmp_path, formats=["plan"], firmware=PX4, timed=False)
    assert uniform.autopilots == (PX4,) * 4
    assert json.loads((tmp_path / INDEX).read_text())["firmware"] == "px4"


def test_timed_missions_are_predicted_by_each_vehicles_own_model(
    mixed: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    landings: list[tuple[object, ...]] = []
    monkeypatch.setattr(mission_files, "refuse_close_landing", lambda *given: landings.append(given[3:]))
    index = export(mixed, tmp_path)
    assert index.timing is not None
    assert landings == [(), (index.timing.may_differ_s,)], "missions may begin to land as far apart as they fly"
    assert index.timing.nearest is not None
    first, second = (mixed.sysids.index(sysid) for sysid in index.timing.nearest.sysids)
    apart_s = max(MIXED[first].traits.apart_s, MIXED[second].traits.apart_s)
    assert index.timing.nearest.apart_s == apart_s
    alone = export(mixed, tmp_path, firmware=ARDUPILOT)
    assert alone.timing is not None
    ours, theirs = ([v.error_rms_m for v in i.timing.vehicles][::2] for i in (index, alone) if i.timing)
    assert ours == pytest.approx(theirs, abs=1e-6), "the same model flies the same legs"
    for row in (0, 2):
        assert index.missions[row] == alone.missions[row]
    with pytest.raises(UsageError, match="PX4 cannot wait until a time of day"):
        export(mixed, tmp_path, gates=1, start_s=0)


def test_who_answers_is_compared_with_the_scenario(mixed: Plan) -> None:
    with pytest.raises(PeerError) as caught:
        build_loads(mixed, NUMBERS | {1: 12, 4: 3}, timed=False)
    assert caught.value.message == (
        "vehicle 1 runs PX4, the scenario says ArduCopter; vehicle 4 runs ArduCopter, the scenario says PX4."
    )
    assert "[[formation.vehicle]]" in caught.value.hint
    loads = build_loads(unnamed(mixed), NUMBERS, timed=False)
    assert [dict(load.parameters).keys() >= {"RTL_ALT"} for load in loads] == [True, False, True, False]


@pytest.mark.slow
def test_a_mixed_fleet_flies_one_formation_with_everything_on_board(mixed: Plan) -> None:
    held: dict[int, dict[str, float]] = {}

    def look(world: World, flight: object) -> None:
        for row, sysid in enumerate(mixed.sysids):
            params = world.vehicles[row]._params
            held[sysid] = {name: params[name] for name, _ in build[row].parameters}

    build = build_loads(mixed, NUMBERS, timed=False)
    flown = fly(mixed, safety=True, during=look)
    assert flown.error is None
    # An emulated PX4 may refuse its mode once at this pace: nothing keeps time from outrunning the stream before it.
    assert [event for event in flown.events if not event.what.startswith("reports: ")] == []
    assert flown.flight.held is not None
    assert set(flown.flight.held.digests) == {1, 2, 3, 4}
    assert {int(s.autopilot) for s in flown.flight.sessions.values()} == {3, 12}
    for load in build:
        assert held[load.sysid] == pytest.approx(dict(load.parameters), rel=1e-6)
    during = (flown.t_s > 2.0) & (flown.t_s < mixed.flight_s)
    off_m = np.linalg.norm(flown.places - flown.planned, axis=-1)[:, during]
    assert off_m.max() < 1.0
    assert flown.formation_error_m()[during].max() < 1.0
    returns = flown.flight.contingency.charge.returns
    assert returns == plan_returns(mixed, MIXED), "those of the autopilots that fly"


def test_missions_on_board_are_refused_for_the_vehicles_that_cannot_wait(mixed: Plan) -> None:
    flown = fly(mixed, mode=FlightMode.MISSION)
    assert isinstance(flown.error, PeerError)
    assert flown.error.message == (
        "missions cannot start together: a mission cannot wait until a time of day on vehicle 2 (PX4), vehicle 4 (PX4)."
    )
    assert flown.flight.held is None


@pytest.mark.slow
def test_the_commands(
    mixed: Plan, make_fleet: Callable[..., Fleet], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    skein = tmp_path / "mixed.skein"
    save_plan(mixed, verify(mixed), skein)
    fleet = make_fleet(mixed.scenario, one_port=True)
    link = f"udpout:{fleet.places[1][0].address}"

    def call(*arguments: object) -> tuple[int, dict[str, object]]:
        code = gcs([*map(str, arguments), "--json"])
        return code, json.loads(capsys.readouterr().out)

    code, told = call("show", skein)
    assert code == 0
    assert "ardupilot: 1, 3; px4: 2, 4" in json.dumps(told)
    code, told = call("upload", skein, "--untimed", "--to", tmp_path, "--link", link)
    assert code == 0, told
    names = {vehicle: {p["name"] for p in told["parameters"] if p["vehicle"] == vehicle} for vehicle in NUMBERS}
    assert all(("RTL_ALT" in names[vehicle]) == (number == 3) for vehicle, number in NUMBERS.items())
    code, told = call("diff", skein, "--untimed", "--link", link)
    assert (code, [line for lines in told["differences"].values() for line in lines]) == (0, [])

    async def boards() -> None:
        async with LinkedFleet(link).open() as ground:
            sessions = await ground.vehicles(mixed.sysids, 10.0)
            loads = build_loads(mixed, NUMBERS, timed=False)
            for load in loads:
                assert (await read_onboard(sessions[load.sysid])).differences(load) == []

    in_their_time(boards())


def test_a_flight_of_missions_is_refused_before_anything_is_computed(
    mixed: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    skein, flights = tmp_path / "mixed.skein", tmp_path / "flights"
    save_plan(mixed, verify(mixed), skein)
    assert gcs(["fly", str(skein), "--sim", "--mode", "mission", "--to", str(flights)]) == UsageError.exit_code
    assert "until a time of day on vehicle 2 (PX4), vehicle 4 (PX4)" in capsys.readouterr().err
    assert not flights.exists()


def test_missions_are_refused_as_soon_as_vehicles_say_that_they_cannot_wait(
    mixed: Plan, make_fleet: Callable[..., Fleet], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The scenario names no autopilot, as those of `gcs new`: the heartbeats tell it."""
    plan, skein = unnamed(mixed), tmp_path / "mixed.skein"
    save_plan(plan, verify(plan), skein)
    fleet = make_fleet(plan.scenario, one_port=True, autopilot="px4")
    link = f"udpout:{fleet.places[1][0].address}"
    flights = ["--to", str(tmp_path / "flights")]
    assert gcs(["fly", str(skein), "--link", link, "--mode", "mission", "--yes-arm", *flights]) == UsageError.exit_code
    said = capsys.readouterr().err
    assert "a mission cannot wait until a time of day on vehicle 1 (PX4), vehicle 2 (PX4)" in said
    assert "next: fly with --mode stream" in said
    assert all(vehicle.store.items(0) == () for vehicle in fleet._world.vehicles)


def test_another_fleet_than_the_scenarios_is_refused_before_anything_is_sent(
    mixed: Plan, make_fleet: Callable[..., Fleet], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    skein = tmp_path / "mixed.skein"
    save_plan(mixed, verify(mixed), skein)
    fleet = make_fleet(mixed.scenario, one_port=True, autopilot="ardupilot")
    code = gcs(["upload", str(skein), "--link", f"udpout:{fleet.places[1][0].address}"])
    said = capsys.readouterr().err
    assert code == PeerError.exit_code
    assert "vehicle 2 runs ArduCopter, the scenario says PX4" in said
    assert all(vehicle.store.items(0) == () for vehicle in fleet._world.vehicles)
