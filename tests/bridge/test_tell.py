"""`gcs tell` beside `gcs fly`: a zone that comes up, a refusal, and the flight's folder, report and replay after it."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import gcs
from gcs.cli.main import run
from gcs.flight.recording.flight_folder import PLAN, later_plans, read_events, read_flown_plan
from gcs.flight.setup.order_socket import NAME
from gcs.plan.plan_file import load_plan, save_plan
from tests.kept import GCS

pytestmark = pytest.mark.slow


def test_a_flight_takes_orders_from_a_second_terminal(
    hop_skein: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flights, middle_m = tmp_path / "flights", gcs.load_plan(hop_skein)[0].leader_trajectory.state(20.0)
    zone = f"{middle_m[0]:.1f},{middle_m[1] + 1.0:.1f},3"

    def tell(*words: str) -> int:
        return run(["tell", *words, "--to", str(flights)])

    assert tell("hold") == 2
    assert "no flight under way" in capsys.readouterr().err
    command = [*GCS, "fly", str(hop_skein), "--sim", "--speedup", "1", "--to", str(flights)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as flight:
        try:
            assert flight.stdout is not None
            said = []
            for line in flight.stdout:
                said.append(line)
                if line.startswith(tuple(f"flying: t = {second} " for second in range(5))):
                    break
            assert tell("avoid", zone) == 0
            assert "a new plan is flown from t = " in capsys.readouterr().out
            assert tell("shape", "heart") == 9
            assert 'no shape "heart"' in capsys.readouterr().err
            said += flight.stdout.readlines()
        except BaseException:
            flight.kill()
            raise
    assert flight.returncode == 0, "".join(said)
    (folder,) = flights.iterdir()
    assert not (folder / NAME).exists()
    (later,) = later_plans(folder)
    _, report = load_plan(later)
    assert report.ok
    flown = read_flown_plan(folder)
    asked = [event for event in read_events(folder / "events.jsonl") if "were asked to avoid" in event.what]
    assert asked[0].data == {
        "order": f"avoid 3 m around ({zone.replace(',3', '').replace(',', ', ')})",
        "by": "gcs tell",
    }
    truth = gcs.load_truth(folder)
    t_s = truth.t_s(json.loads((folder / "flight.json").read_text())["t0_unix_s"])
    during = (t_s > flown.zones_since_s[0]) & (t_s < flown.landing_s)
    assert flown.zone_distances_m(t_s[during], truth.named.position_ned_m[:, during]).min() > 0.0
    first_plan, _ = gcs.load_plan(folder / PLAN)
    assert np.isinf(first_plan.zone_distances_m(np.array([5.0]))).all()
    for command in (["report", str(folder)], ["replay", str(folder), "--picture", str(tmp_path / "flight.svg")]):
        done = subprocess.run([*GCS, *command], capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr


def test_the_returns_of_a_plan_file_are_at_hand_in_the_flight(
    hop: gcs.Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flights, file = tmp_path / "flights", tmp_path / "hop.skein"
    prepared = gcs.prepare_returns(hop, 5.0)
    save_plan(hop, gcs.verify(hop), file, prepared)
    command = [*GCS, "fly", str(file), "--sim", "--speedup", "1", "--to", str(flights)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as flight:
        try:
            assert flight.stdout is not None
            said = []
            for line in flight.stdout:
                said.append(line)
                if line.startswith(tuple(f"flying: t = {second} " for second in range(2, 6))):
                    break
            assert run(["tell", "home", "--to", str(flights)]) == 0
            assert "prepared before the flight" in capsys.readouterr().out
            said += flight.stdout.readlines()
        except BaseException:
            flight.kill()
            raise
    assert flight.returncode == 0, "".join(said)
    (folder,) = flights.iterdir()
    (later,) = later_plans(folder)
    plan, report = load_plan(later)
    assert report.ok
    assert plan.t_start_s in [one.begins_s for one in prepared.returns]
    truth = gcs.load_truth(folder)
    np.testing.assert_allclose(truth.named.position_ned_m[:, -1, :2], hop.pads_ned_m[:, :2], atol=0.5)
