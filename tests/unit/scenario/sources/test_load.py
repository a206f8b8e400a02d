"""Loading: the bundled mission as the paper has it, and every mistake told at once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from pydantic import ValidationError

from gcs.errors import ScenarioError
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario

Broken = Callable[..., str]


@pytest.fixture
def broken(tmp_path: Path, repo_root: Path) -> Broken:
    """The error text of simulation1 with some passages replaced."""

    def load(*changes: tuple[str, str]) -> str:
        text = (repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8")
        for old, new in changes:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        (tmp_path / "scenario.toml").write_text(text, encoding="utf-8")
        with pytest.raises(ScenarioError) as caught:
            load_scenario(tmp_path)
        told = caught.value.message.replace(str(tmp_path), "HERE")
        return told if "\n" in told else f"{told}. {caught.value.hint}"

    return load


def test_simulation1_is_the_papers(simulation1: Scenario) -> None:
    s = simulation1
    assert s.time.flight_s == 275.0
    assert (s.vehicle.mass_kg, s.vehicle.arm_m, s.vehicle.inertia_kgm2) == (0.5, 0.075, (0.0219, 0.0219, 0.0366))
    assert (s.vehicle.thrust_coeff_Ns2, s.vehicle.moment_coeff_Nms2) == (1.105e-5, 1.779e-7)
    assert (s.limits.thrust_N, s.limits.roll_pitch_force_N) == ((0.0, 5.2), (0.0501, 0.0501))
    assert s.limits.yaw_moment_Nm == 0.0209
    assert s.objective.weights == (0.8, 0.1, 0.1)
    assert s.end.position_m == (1200.0, 1000.0, 2.0)
    assert len(s.formation.vehicle) == 6
    assert len(s.terrain.mountains.north_m) == 7


def test_folder_and_file_are_the_same(repo_root: Path, simulation1: Scenario) -> None:
    assert load_scenario(repo_root / "missions" / "simulation1" / "scenario.toml") == simulation1


def test_a_scenario_cannot_be_changed(simulation1: Scenario) -> None:
    with pytest.raises(ValidationError):
        simulation1.time.flight_s = 1.0  # type: ignore[misc]


def test_all_mistakes_are_told_at_once_with_line_key_value_and_range(broken: Broken) -> None:
    told = broken(
        ("lat_deg = 47.397742", "lat_deg = 95.0"),
        ("flight_s = 275.0", "flight_s = true"),
        ("clearance_min_m = 0.5", "clearance_mim_m = 0.5"),
        ("north_m = [0.0, 1500.0]", "north_m = [1500.0, 0.0]"),
        ("position_m = [1.0, 0.5, 3.0]", 'position_m = ["a", 0.5, 3.0]'),
        ('grade = "rtk"', 'grade = "rtx"'),
        ("e = 1.0\n", "e = nan\n"),
        ("velocity_mps = [0.0, 0.0, 0.0]", "velocity_mps = [0.0, 0.0]"),
        ("mass_kg = 0.5", "# mass_kg = 0.5"),
        ("height_ref_m = 20.0", "gravity_mps2 = 9.8"),
        # Tables that are right in themselves are still compared with each other.
        ("\nseparation_min_m = 0.3", "\nseparation_min_m = 0.3\nsurprise = 1"),
        ("run_up_m = 25.0", "run_up_m = 100.0"),
    ).splitlines()
    expected = [
        "HERE/scenario.toml has 12 mistakes",
        "scenario.toml:10: origin.lat_deg = 95.0: must be a number from -85 to 85 (WGS-84 latitude, degrees)",
        "scenario.toml:15: time.flight_s = true: must be a number from 0.01 to 7200",
        "scenario.toml:17: vehicle.mass_kg: missing; it must be a number from 0.001 to 1000 (m, kg)",
        "scenario.toml:35: limits.north_m = [1500.0, 0.0]: must be [low, high] with low < high",
        "scenario.toml:46: limits.clearance_mim_m: unknown key; the nearest known one is clearance_min_m",
        "scenario.toml:56: terrain.ripple.e = nan: must be a number",
        "end.velocity_mps = [0.0, 0.0]: has too few values; it must be a list of 3",
        "objective.gravity_mps2: unknown key here; it belongs to [vehicle]",
        'formation.vehicle[3].position_m[0] = "a": must be a number',
        "ground_phases.run_up_m = 100.0: cannot bring a vehicle from rest to 2.83 m/s in run_up_s = 20 s",
        'sensors.grade = "rtx": must be one of "rtk", "gnss"',
        "judge.surprise: unknown key; known ones are separation_min_m, arrival_time_s",
    ]
    assert len(told) == len(expected)
    for line, part in zip(told, expected, strict=True):
        assert part in line


def test_text_is_not_a_number(broken: Broken) -> None:
    told = broken(("mass_kg = 0.5", 'mass_kg = "0.5"'))
    assert told.endswith(': vehicle.mass_kg = "0.5": must be a number, without quotes. write mass_kg = 0.5')
    assert "\n" not in told


def test_whole_numbers_are_numbers(tmp_path: Path, repo_root: Path) -> None:
    text = (repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8")
    (tmp_path / "scenario.toml").write_text(text.replace("flight_s = 275.0", "flight_s = 275"), encoding="utf-8")
    assert load_scenario(tmp_path).time.flight_s == 275.0


def test_lists_of_mountains_are_equally_long(broken: Broken) -> None:
    told = broken(("spread_east_m = [50.0, ", "spread_east_m = ["))
    assert "terrain.mountains: lists must be equally long" in told
    assert "north_m 7" in told
    assert "spread_east_m 6" in told


def test_the_leader_is_one_of_the_vehicles(broken: Broken) -> None:
    told = broken(("leader = 1\n", "leader = 7\n"))
    assert "scenario.toml:91: formation.leader = 7: is not the sysid of a vehicle; there are 1, 2, 3, 4, 5, 6" in told
    told = broken(("sysid = 2\n", "sysid = 3\n"))
    assert "scenario.toml:102: formation.vehicle[2].sysid = 3: is the sysid of vehicle[1] already" in told


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"a = 1\nb = = 2\n", "scenario.toml:2: not TOML: no value of TOML stands here"),
        (b'a = 1\n\nb = "x', "scenario.toml:3: not TOML: text is not closed"),
        (b"a = 1\n\xff\n", "scenario.toml:2: not UTF-8 text"),
    ],
)
def test_syntax_errors_name_file_and_line(tmp_path: Path, text: bytes, message: str) -> None:
    (tmp_path / "scenario.toml").write_bytes(text)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(tmp_path)
    assert message in caught.value.message
    assert caught.value.hint


def test_a_missing_mission_comes_with_those_nearby(repo_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(repo_root)
    for wrong in ("missions/simulaton1", "missions", "simulaton1", "missions/simulation1/nope.toml"):
        with pytest.raises(ScenarioError) as caught:
            load_scenario(Path(wrong))
        assert wrong in caught.value.message
        assert "missions/simulation1" in caught.value.hint


def test_a_missing_mission_far_from_any(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(tmp_path / "a" / "b")
    assert caught.value.hint == (
        "name a folder with a scenario.toml, a scenario file, or one that comes with Skein: changes, circuit, field, "
        "gap, hundred, ridge, simulation1, simulation2, survey, terminal_weighting"
    )


def test_a_bare_name_means_the_bundled_mission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_scenario("simulation1").title.startswith("Simulation 1")
    assert load_scenario("ridge").terrain.relief is not None  # the elevation model beside it is found too
    with pytest.raises(ScenarioError, match="there is no mission at"):
        load_scenario("missions/simulation1")  # a path


def test_a_folder_of_that_name_in_the_working_directory_comes_first(
    tmp_path: Path, repo_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "simulation1").mkdir()
    with pytest.raises(ScenarioError, match=r"simulation1 has no scenario\.toml"):
        load_scenario("simulation1")
    text = (repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8")
    (tmp_path / "simulation1" / "scenario.toml").write_text(
        text.replace('"Simulation 1', '"My own', 1), encoding="utf-8"
    )
    assert load_scenario("simulation1").title.startswith("My own")


def test_an_elevation_model_is_read_from_beside_the_scenario_or_missed(tmp_path: Path, repo_root: Path) -> None:
    ridge = repo_root / "missions" / "ridge"
    relief = load_scenario(ridge).terrain.relief
    assert relief is not None and relief.spacing_m == pytest.approx(10.0, rel=0.001)
    text = (ridge / "scenario.toml").read_text()
    (tmp_path / "scenario.toml").write_text(text)
    with pytest.raises(ScenarioError) as missed:
        load_scenario(tmp_path)
    told = 'terrain.dem.file = "ridge.tif": cannot be read as an elevation model: No such file or directory.'
    assert missed.value.message.startswith(f"{tmp_path / 'scenario.toml'}:") and told in missed.value.message
    assert missed.value.reason.startswith(told)  # without the file, for a text that has none
    (tmp_path / "ridge.tif").write_bytes((ridge / "ridge.tif").read_bytes())
    (tmp_path / "scenario.toml").write_text(text.replace("north_m = [-20.0, 720.0]", "north_m = [-20.0, 2720.0]"))
    with pytest.raises(ScenarioError, match=r"too small: it covers .* needs -35 to 2735 m north"):
        load_scenario(tmp_path)


def test_an_elevation_model_and_mountains_disagree(broken: Broken) -> None:
    told = broken(("[terrain.mountains]", '[terrain.dem]\nfile = "x.tif"\n\n[terrain.mountains]'))
    assert "terrain.dem: is the whole ground. remove ripple and mountains" in told


def test_what_was_read_travels_with_the_scenario(tmp_path: Path, repo_root: Path) -> None:
    """A plan, or the file that a simulator is given, needs the elevation model no more."""
    scenario = load_scenario(repo_root / "missions" / "ridge")
    (tmp_path / "scenario.json").write_text(scenario.model_dump_json())
    assert load_scenario(tmp_path / "scenario.json") == scenario
