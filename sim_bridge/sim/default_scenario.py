"""Default scenarios: a grid of vehicles on level ground, and any scenario with another number of vehicles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcs.errors import UsageError
from gcs.scenario.load import load_scenario
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.dynamics.body.presets import FIELD

SPACING_M = 5.0
_FAR_M = 2000.0
_HOVER_M = 10.0


def scenario_for(scenario: Scenario | Path | str | None, vehicles: int | None) -> Scenario:
    """Return the given, loaded or default scenario with `vehicles` vehicles, if that number is given.

    A smaller number takes the first vehicles of the scenario; a larger one places them on a grid. Raises
    `ScenarioError` or `UsageError`.
    """
    if vehicles is not None and vehicles < 1:
        raise UsageError(f"a fleet needs at least 1 vehicle, not {vehicles}.", hint="set vehicles to 1 or more")
    if scenario is None:
        return plain_scenario(6 if vehicles is None else vehicles)
    known = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    if vehicles is None or vehicles == len(known.formation.sysids):
        return known
    data = known.model_dump(mode="json")
    listed = data["formation"]["vehicle"]
    if vehicles < len(listed):
        data["formation"] = {"leader": listed[0]["sysid"], "vehicle": listed[:vehicles]}
    else:
        data["formation"] = _grid(vehicles)
    return Scenario.model_validate(data)


def plain_scenario(vehicles: int) -> Scenario:
    """Return a scenario of `field` vehicles with RTK-grade receivers, `SPACING_M` apart, on level ground."""
    body = FIELD.quadrotor
    data: dict[str, Any] = {
        "schema_version": 1,
        "name": "plain",
        "origin": {"lat_deg": -35.363262, "lon_deg": 149.165237, "alt_amsl_m": 584.0},
        "time": {"flight_s": 60.0},
        "vehicle": {
            "name": FIELD.name,
            **{name: getattr(body, name) for name in type(body).__dataclass_fields__ if name != "wind"},
        },
        "limits": {
            "north_m": [-_FAR_M, _FAR_M],
            "east_m": [-_FAR_M, _FAR_M],
            "height_m": [0.0, 120.0],
            "speed_ned_mps": [10.0, 10.0, 2.5],
            "roll_pitch_yaw_deg": [25.0, 25.0, 180.0],
            "rates_degps": [45.0, 45.0, 30.0],
            "thrust_N": [4.0, FIELD.limits.thrust_N],
            "roll_pitch_force_N": list(FIELD.limits.torque[:2]),
            "yaw_moment_Nm": FIELD.limits.torque[2],
            "clearance_min_m": 0.0,
            "load_factor_max": 0.3,
            "separation_min_m": 1.0,
        },
        "start": {"position_m": [0.0, 0.0, _HOVER_M]},
        "end": {"position_m": [50.0, 0.0, _HOVER_M]},
        "objective": {
            "weights": [1.0, 0.0, 0.0],
            "terminal_weight": "1/(tf-t+0.5)",
            "heading_ref_deg": 0.0,
            "height_ref_m": _HOVER_M,
        },
        "formation": _grid(vehicles),
        "ground_phases": {"takeoff_s": 10.0, "landing_s": 20.0},
        "sensors": {"grade": "rtk"},
        "judge": {"separation_min_m": 1.0, "arrival_position_m": 2.0, "position_rms_m": 2.0},
    }
    return Scenario.model_validate(data)


def _grid(vehicles: int) -> dict[str, Any]:
    shape = {"name": "grid", "generator": "grid", "spacing_m": SPACING_M}
    return {"leader": 1, "count": vehicles, "start_shape": "grid", "shape": [shape]}
