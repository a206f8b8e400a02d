"""Vehicle types in files: presets and one's own, usable in any scenario, checked for physical sense."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.errors import ScenarioError
from gcs.frames import Origin
from gcs.scenario.schema.vehicle_types import preset_file, presets
from gcs.scenario.sources.load import load_scenario, load_vehicle
from gcs.scenario.sources.template import scenario_text

QUAD = preset_file("quad500").read_text()


def write(folder: Path, vehicle: str, more: str = "") -> Path:
    text = scenario_text(folder / "first", Origin(47.0, 8.0, 400.0)).replace('"quad500"', f'"{vehicle}"')
    (folder / "scenario.toml").write_text(text + more)
    return folder


COMFORT = ("accel_max_mps2", "jerk_max_mps3")  # the missions of the same vehicles have no such limits


def test_presets_are_those_of_the_missions(repo_root: Path) -> None:
    assert presets() == ("f150", "quad500")
    for name, mission in (("f150", "simulation1"), ("quad500", "field")):
        scenario, kind = load_scenario(repo_root / "missions" / mission), load_vehicle(preset_file(name))
        assert kind.vehicle == scenario.vehicle
        limits = {key: value for key, value in kind.limits.model_dump().items() if key not in COMFORT}
        assert limits == {key: value for key, value in scenario.limits.model_dump().items() if key in limits}


def test_a_type_may_give_a_comfortable_motion_and_the_papers_vehicle_gives_none() -> None:
    quad, paper = (load_vehicle(preset_file(name)).limits for name in ("quad500", "f150"))
    assert (quad.accel_max_mps2, quad.jerk_max_mps3) == (2.0, 2.0)
    assert (paper.accel_max_mps2, paper.jerk_max_mps3) == (None, None)


def test_a_scenario_takes_what_it_does_not_say_from_its_vehicle(tmp_path: Path) -> None:
    scenario = load_scenario(write(tmp_path, "f150", "\n[vehicle]\nmass_kg = 0.4\n"))
    assert (scenario.vehicle.mass_kg, scenario.vehicle.arm_m) == (0.4, 0.075)
    assert scenario.limits.speed_ned_mps == (5.0, 5.0, 2.0)
    assert scenario.limits.height_m == (0.0, 40.0)
    assert scenario.mission.autopilot == "ardupilot"


def test_a_vehicle_of_ones_own(tmp_path: Path) -> None:
    own = QUAD.replace('autopilot = "ardupilot"', 'autopilot = "px4"').replace("mass_kg = 2.0", "mass_kg = 2.5")
    (tmp_path / "big.toml").write_text(own)
    scenario = load_scenario(write(tmp_path, "big.toml"))
    assert (scenario.vehicle.mass_kg, scenario.mission.autopilot) == (2.5, "px4")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("mass_kg = 2.0", "mass_kg = 4.5", r"big.toml:\d+: limits.thrust_N = \[4.0, 38.0\]: cannot hover"),
        (
            "yaw_moment_Nm = 0.08",
            "yaw_moment_Nm = 2.0",
            r"big.toml:\d+: limits.yaw_moment_Nm = 2.0: more than the rotors give: .* U4, yawing, reaches 0.313 ",
        ),
        (
            "rotor_max_radps = 1070.0",
            "rotor_max_radps = 800.0",
            r"vehicle.rotor_max_radps = 800.0: too slow: four rotors",
        ),
        (
            "arm_m = 0.25",
            "arm_m = -1.0",
            r"big.toml:\d+: vehicle.arm_m = -1.0: must be a number from 0.001 to 10 \(l, centre to rotor",
        ),
        ("[limits]", "[limit]", r"limit: unknown key; the nearest known one is limits"),
        ("[limits]", "[limits]\nnorth_m = [0.0, 1.0]", r"limits.north_m: unknown key"),
        (
            "rotor_radius_m = 0.127",
            "rotor_radius_m = 0.18",
            r"big.toml:\d+: vehicle.power.rotor_radius_m = 0.18: propellers touch: .* 0.354 m apart",
        ),
        (
            "rotor_max_radps = 1070.0",
            "rotor_max_radps = 3000.0",
            r"vehicle.power.rotor_radius_m = 0.127: blade tips faster than sound: 381 m/s",
        ),
        ("battery_Wh = 76.96", "battery_Wh = 700.0", r"big.toml:\d+: .*battery_Wh = 700.0: heavier than the vehicle"),
        ("figure_of_merit = 0.55", "figure_of_merit = 1.2", r"big.toml:\d+: vehicle.power.figure_of_merit = 1.2"),
        ("figure_of_merit = 0.55", "", r"vehicle.power.figure_of_merit: missing"),
        ("mass_kg = 2.0", "mass_kg = ", r"big.toml:\d+: not TOML"),
    ],
)
def test_what_makes_no_sense_is_told_with_the_vehicles_own_line(tmp_path: Path, old: str, new: str, told: str) -> None:
    (tmp_path / "big.toml").write_text(QUAD.replace(old, new))
    with pytest.raises(ScenarioError, match=told):
        load_scenario(write(tmp_path, "big.toml"))


def test_a_type_that_is_not_there_says_which_are(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match='vehicle_type = "f15": is neither a vehicle type nor a file') as caught:
        load_scenario(write(tmp_path, "f15"))
    assert 'write vehicle_type = "f150"' in caught.value.hint
    with pytest.raises(ScenarioError) as caught:
        load_scenario(write(tmp_path, "iris"))
    assert "name a preset (f150, quad500), or a file" in caught.value.hint
