"""Landings in `gcs report`: in closed form, and of six real vehicles each."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from gcs.cli.main import run
from gcs.flight.assessment.comparison import LandingError, landing_errors
from gcs.plan.trajectory.plan import Plan
from tests.real_flights import unpacked

# Largest horizontal distance at touchdown and largest vertical deviation of six real vehicles, m. The former has the
# 2.3 m (PX4: 1.5 m) by which their setpoints were short, in other metres than those of their local frames.
SEEN = {
    "arducopter-4.5.6-follow-wind": (2.4, 1.0),
    "mixed-stream": (2.4, 2.9),
    "px4-1.17dev-stream": (2.4, 1.2),
}


def landed(
    plan: Plan, beside_m: float, above_m: float, *, below_m: float = 0.0, disarmed: bool = True, speed_mps: float = 0.0
) -> LandingError:
    """The landing of the first vehicle: 1 m/s down is expected, it is beside and above, at last `below_m` the point."""
    point, begin_s = plan.landing_points_ned_m[0], plan.phase("landing").start_s
    since_s = np.arange(-2.0, 13.0, 0.1)
    count = len(since_s)
    planned = point[2] - np.clip(10.0 - since_s, 0.0, 10.0)
    down = planned - above_m * (planned < point[2]) + below_m * (planned >= point[2])
    columns = {
        "sysid": np.full(count, plan.sysids[0]),
        "t_s": begin_s + since_s,
        "armed": since_s < 11.95 if disarmed else np.full(count, True),
        "north_m": np.full(count, point[0] + 0.6 * beside_m),
        "east_m": np.full(count, point[1] + 0.8 * beside_m),
        "down_m": down,
        "v_down_mps": np.full(count, speed_mps),
        "planned_down_m": planned,
    }
    return landing_errors(plan, pa.table(columns))[0]


def test_a_landing_has_a_distance_at_touchdown_and_a_deviation_on_the_way(simulation1_plan: Plan) -> None:
    found = landed(simulation1_plan, 0.5, 0.3)
    begin_s = simulation1_plan.phase("landing").start_s
    assert (found.horizontal_m, found.vertical_max_m) == pytest.approx((0.5, 0.3))
    assert found.touchdown_s == pytest.approx(begin_s + 11.9)
    assert (found.within(0.6), found.within(0.4)) == (True, False)


def test_ground_below_the_scenarios_is_no_error_of_the_descent(simulation1_plan: Plan) -> None:
    assert landed(simulation1_plan, 0.5, 0.3, below_m=2.0).vertical_max_m == pytest.approx(0.3)


def test_a_record_that_ends_at_rest_on_the_ground_ends_with_the_touchdown(simulation1_plan: Plan) -> None:
    """The flight ends with its last vehicle: no report follows."""
    assert landed(simulation1_plan, 0.5, 0.3, disarmed=False).horizontal_m == pytest.approx(0.5)
    for moving in (landed(simulation1_plan, 0.5, 0.3, disarmed=False, speed_mps=0.5), landed(simulation1_plan, 0, 0)):
        assert math.isnan(moving.horizontal_m) == (moving.within(1.0) is None)
    assert landed(simulation1_plan, 0.5, 0.3, disarmed=False, speed_mps=0.5).within(1.0) is None


def test_a_vehicle_that_landed_elsewhere_has_no_descent_to_compare(simulation1_plan: Plan) -> None:
    found = landed(simulation1_plan, 11.0, 0.3)
    assert found.horizontal_m == pytest.approx(11.0)
    assert math.isnan(found.vertical_max_m)
    unheard = landing_errors(simulation1_plan, pa.table({name: np.empty(0) for name in COLUMNS}))
    assert all(one.within(1.0) is None for one in unheard)


COLUMNS = ("sysid", "t_s", "armed", "north_m", "east_m", "down_m", "v_down_mps", "planned_down_m")


@pytest.mark.parametrize(
    "name", [name if name == "mixed-stream" else pytest.param(name, marks=pytest.mark.slow) for name in SEEN]
)
def test_the_report_tells_landings_by_themselves(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["report", str(unpacked(name, tmp_path)), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["landing_limit_m"] == 5.0
    landings = [vehicle["landing"] for vehicle in found["vehicles"]]
    assert [landing["ok"] for landing in landings] == [True] * 6
    beside_m, above_m = SEEN[name]
    assert 0.5 * beside_m < max(landing["horizontal_m"] for landing in landings) < beside_m
    assert 0.8 * above_m < max(landing["vertical_max_m"] for landing in landings) < above_m


@pytest.mark.slow
def test_vehicles_that_were_called_back_did_not_land_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = unpacked("arducopter-4.5.6-mission", tmp_path)
    assert run(["report", str(folder), "--json"]) == 0
    landings = [vehicle["landing"] for vehicle in json.loads(capsys.readouterr().out)["vehicles"]]
    nothing = {"touchdown_s": None, "horizontal_m": None, "vertical_max_m": None, "ok": None}
    assert [{key: landing[key] for key in nothing} for landing in landings] == [nothing] * 6
    assert run(["report", str(folder)]) == 0
    assert "not seen" in capsys.readouterr().out
