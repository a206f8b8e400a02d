"""What a campaign is asked to fly: options and TOML files, the conditions of a row, and addresses of schedulers."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

from gcs.campaign.campaign_cluster import version_problem
from gcs.campaign.campaign_flight import emulated
from gcs.campaign.campaign_options import CampaignOptions, read_design
from gcs.campaign.cluster_address import CERTIFICATES, Cluster, refuse_open_scheduler
from gcs.campaign.design import draw
from gcs.campaign.varied_plan import refuse_unknown_keys, varied_keys, varied_scenario
from gcs.errors import FileFormatError, UsageError
from gcs.scenario.sources.load import load_scenario


def test_a_row_becomes_the_conditions_of_a_flight() -> None:
    row = {"index": 3, "seed": 9, "wind_mps": 2.5, "wind_from_deg": 270.0, "gusts": "light", "loss": 0.1}
    found = emulated(row | {"fault1": 1.0, "fault1_text": "2:die@7.5", "fault2": 0.0, "fault2_text": ""})
    assert (found.speedup, found.seed, found.wind, found.gusts) == ("max", 9, "2.5@270.0", "light")
    assert found.faults == ("2:die@7.5", "all:loss=0.1")
    assert emulated({"index": 0, "seed": 1, "gusts": "none", "loss": 0.0}).gusts is None
    assert emulated({"index": 0, "seed": 1, "gusts": "none", "loss": 0.0}).faults == ()


def test_options_of_a_file_and_of_a_record_are_the_same(tmp_path: Path) -> None:
    file = tmp_path / "d.toml"
    file.write_text('flights = 12\nwind = "0..6@any"\nfaults = ["5%:any:die@any"]\nmode = "mission"\nuntil = "2%"\n')
    asked = CampaignOptions.of(read_design(file) | {"flights": 13})
    assert (asked.flights, asked.width, asked.keeping.mode) == (13, 0.02, "mission")
    assert [one.name for one in asked.factors] == ["wind_mps", "wind_from_deg"]
    file.write_text("flights = \n")
    with pytest.raises(FileFormatError, match="not a TOML file"):
        read_design(file)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"flight": 3}, "flight"),
        ({"flights": 0}, "at least 1 flight"),
        ({"flights": "many"}, "flights"),
        ({"wind": "3"}, "no direction"),
        ({"until": "0%"}, "not a width"),
        ({"until": "1..2%"}, "not a width"),
        ({"loss": "0..2"}, "not shares"),
        ({"vary": ("vehicle.mass_kg",)}, "not a key"),
        ({"vary": ("mass=1..2",)}, "not a key"),
        ({"follow": True, "mode": "mission"}, "setpoint stream"),
    ],
)
def test_options_that_mean_nothing_are_refused(given: dict[str, object], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        CampaignOptions.of(given)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "tcp://localhost:8786", "tcp://[::1]:8786"])
def test_a_scheduler_of_this_machine_is_used(address: str) -> None:
    refuse_open_scheduler(Cluster(scheduler=address))


@pytest.mark.parametrize("address", ["tcp://192.168.1.5:8786", "tcp://cluster:8786", "tcp://0.0.0.0:8786"])
def test_an_open_scheduler_is_refused_unless_it_is_asked_for(address: str) -> None:
    with pytest.raises(UsageError, match="runs any code") as refused:
        refuse_open_scheduler(Cluster(scheduler=address))
    assert "--open-scheduler" in refused.value.hint
    refuse_open_scheduler(Cluster(scheduler=address, open_scheduler=True))


def test_certificates_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="needs certificates"):
        refuse_open_scheduler(Cluster(scheduler="tls://host:8786"))
    with pytest.raises(UsageError, match=r"no ca\.pem"):
        refuse_open_scheduler(Cluster(scheduler="tls://host:8786", certificates=tmp_path))
    for name in CERTIFICATES:
        (tmp_path / name).touch()
    refuse_open_scheduler(Cluster(scheduler="tls://host:8786", certificates=tmp_path))


@pytest.mark.parametrize("address", ["host", "tcp://host", "http://host:1", "tls://host:99999", "tcp://:8786", ""])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(UsageError, match="not an address"):
        refuse_open_scheduler(Cluster(scheduler=address))


def test_options_that_do_not_go_together_are_refused(tmp_path: Path) -> None:
    for cluster in (Cluster(2, "tcp://127.0.0.1:1"), Cluster(certificates=tmp_path), Cluster(open_scheduler=True)):
        with pytest.raises(UsageError):
            refuse_open_scheduler(cluster)


def test_varied_values_are_factors_of_keys_that_the_scenario_has(repo_root: Path) -> None:
    scenario = load_scenario(repo_root / "missions" / "field")
    asked = CampaignOptions(3, vary=("vehicle.mass_kg=1.8..2.4", "limits.roll_pitch_yaw_deg.0=20,21"))
    refuse_unknown_keys(scenario, (one.name for one in asked.factors))
    row = draw(asked.factors, (), 7, 1)[0]
    found = varied_scenario(scenario, varied_keys(row))
    assert 1.8 < found.vehicle.mass_kg == row["vehicle.mass_kg"] < 2.4
    assert found.limits.roll_pitch_yaw_deg[0] == row["limits.roll_pitch_yaw_deg.0"]
    for key in ("vehicle.weight_kg", "limits.roll_pitch_yaw_deg.3", "vehicle.mass_kg.x"):
        with pytest.raises(UsageError, match="no such key"):
            refuse_unknown_keys(scenario, (key,))


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (version("skein-gcs"), ""),
        ("0.0.9", "it has Skein 0.0.9, this machine has"),
        (PackageNotFoundError("skein-gcs"), "Skein is not installed there"),
        (OSError("gone"), "it does not tell its version of Skein: gone"),
    ],
)
def test_a_worker_with_no_or_another_skein_is_told(found: object, said: str) -> None:
    assert version_problem(found).startswith(said)
    assert bool(version_problem(found)) == bool(said)
