"""GO means that it can arm: vehicles whose own arming checks fail are a no-go, in their own words."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.cli.main import run as gcs
from gcs.plan.trajectory.plan import Plan
from tests.fleets import StillFleet, free_port, still_commands


@pytest.mark.parametrize(
    ("autopilot", "from_s", "said"),
    [
        ("ardupilot", 0.0, "PreArm: Accels inconsistent"),
        # its bit is about its mode; its texts come at 30 s
        pytest.param("px4", 29.3, "Preflight Fail: Accel 0 uncalibrated", marks=pytest.mark.slow),
    ],
)
def test_a_vehicle_that_fails_its_own_checks_is_a_no_go(
    hop: Plan,
    hop_skein: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    autopilot: str,
    from_s: float,
    said: str,
) -> None:
    port = free_port()
    fleet = StillFleet(hop.scenario, links=[f"udpout:127.0.0.1:{port}"], autopilot=autopilot, faults=["2:fail-checks"])
    with still_commands(), fleet:
        fleet.wait_until(lambda: fleet._world.t_s >= from_s)
        link = f"udpin:127.0.0.1:{port}"
        assert gcs(["fly", str(hop_skein), "--link", link, "--yes-arm", "--to", str(tmp_path)]) == 9
        assert f"no-go: vehicle 2: can arm: {said} (required: yes)" in capsys.readouterr().err
        assert not any(vehicle.autopilot.armed for vehicle in fleet._world.vehicles)


def test_a_mission_is_not_flown_with_other_parameters_than_its_times_assume(
    hop: Plan, hop_skein: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_port()
    with still_commands(), StillFleet(hop.scenario, links=[f"udpout:127.0.0.1:{port}"]) as fleet:
        fleet._world.vehicles[1]._params.change("WPNAV_ACCEL", 150.0)
        words = [str(hop_skein), "--link", f"udpin:127.0.0.1:{port}"]
        assert gcs(["upload", *words, "--dry-run"]) == 0
        told = " ".join("".join(capsys.readouterr()).split())
        assert told.count("vehicle 2 will not keep its times: WPNAV_ACCEL is 150, assumed 250") == 1
        assert gcs(["fly", *words, "--mode", "mission", "--yes-arm", "--to", str(tmp_path)]) == 9
        told = capsys.readouterr().err
        assert "no-go: vehicle 2: timing: WPNAV_ACCEL is 150, assumed 250 (required: as the times of" in told
        assert "fly with --mode stream" in told
