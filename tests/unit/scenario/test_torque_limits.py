"""Limits of U_2..U_4: forces on the arm or moments, one of the two, with one meaning; the older key is read."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from gcs.errors import ScenarioError
from gcs.plan.ocp.problem import control_bounds
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.values.si import physical_limits, quadrotor, torque_limits

FORCE, MOMENT, YAW = (
    "roll_pitch_force_N = [0.0501, 0.0501]",
    "roll_pitch_moment_Nm = [0.0501, 0.0501]",
    "yaw_moment_Nm = 0.0209",
)


@pytest.fixture
def written(tmp_path: Path, repo_root: Path) -> Any:
    """Loads simulation1 with other lines for the limits of U_2..U_4."""
    text = (repo_root / "missions/simulation1/scenario.toml").read_text(encoding="utf-8")
    text = re.sub(r"^roll_pitch_force_N.*\nyaw_moment_Nm.*\n", "@\n", text, flags=re.M)

    def load(*lines: str) -> Scenario:
        (tmp_path / "scenario.toml").write_text(text.replace("@", "\n".join(lines)), encoding="utf-8")
        return load_scenario(tmp_path)

    return load


def most(scenario: Scenario) -> tuple[float, float, float]:
    return torque_limits(scenario.limits, scenario.vehicle.arm_m)


def test_a_moment_is_a_force_times_the_arm(written: Any) -> None:
    """Table 1: an arm of 0.075 m and 0.0219 kg m²; 0.0501 N m turn it by 2.29 rad/s², 0.0501 N by 0.172 rad/s²."""
    assert most(written(FORCE, YAW)) == (0.0501, 0.0501, 0.0209)
    assert most(written(MOMENT, YAW)) == pytest.approx((0.668, 0.668, 0.0209))
    for lines, turn_radps2 in ((FORCE, 0.17158), (MOMENT, 2.28767)):
        scenario = written(lines, YAW)
        assert physical_limits(quadrotor(scenario), scenario.limits).tilt_accel_radps2 == pytest.approx(
            turn_radps2, rel=1e-4
        )
        assert control_bounds(scenario)[1][1:] == pytest.approx(most(scenario))


def test_the_older_key_means_forces_and_a_moment(written: Any) -> None:
    assert most(written("torque = [0.0501, 0.04, 0.0209]")) == (0.0501, 0.04, 0.0209)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ((), "limits: lacks the limits of U_2 and U_3. Give one of roll_pitch_force_N, roll_pitch_moment_Nm"),
        ((FORCE, MOMENT, YAW), "roll_pitch_moment_Nm = [0.0501, 0.0501]: stands beside roll_pitch_force_N"),
        ((FORCE, YAW, "torque = [1.0, 1.0, 1.0]"), "limits.torque = [1.0, 1.0, 1.0]: stands beside roll_pitch_force_N"),
        ((YAW, "torque = [0.1, 0.1, 0.01]"), "limits.yaw_moment_Nm = 0.0209: stands beside torque"),
        ((MOMENT,), "limits.yaw_moment_Nm: missing; it must be a number > 0"),
        (("roll_pitch_moment_Nm = [0.0501, 0.5]", YAW), "limits.roll_pitch_moment_Nm[1] = 0.5: more than the rotors"),
        (("torque = [0.05, 9.0, 0.02]",), "limits.torque[1] = 9.0: more than the rotors give"),
        (("roll_pitch_moment = [0.0501, 0.5]", YAW), "the nearest known one is roll_pitch_moment_Nm"),
    ],
)
def test_exactly_one_reading_is_given(written: Any, lines: tuple[str, ...], told: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        written(*lines)
    assert told in f"{caught.value.message}. {caught.value.hint[0].upper()}{caught.value.hint[1:]}"


@pytest.mark.parametrize("own", [MOMENT, "torque = [0.668, 0.668, 0.0209]"])
def test_a_scenario_replaces_the_reading_of_its_vehicle_type(tmp_path: Path, repo_root: Path, own: str) -> None:
    text = (repo_root / "missions/simulation1/scenario.toml").read_text(encoding="utf-8")
    text = re.sub(r"^\[vehicle\].*?(?=^\[limits\])", "", text, flags=re.M | re.S)
    text = re.sub(r"^roll_pitch_force_N.*\nyaw_moment_Nm.*\n", f"{own}\n", text, flags=re.M)
    text = text.replace('name = "simulation1"', 'name = "simulation1"\nvehicle_type = "f150"')
    (tmp_path / "scenario.toml").write_text(text, encoding="utf-8")
    assert most(load_scenario(tmp_path)) == pytest.approx((0.668, 0.668, 0.0209))
