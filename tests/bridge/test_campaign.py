"""Campaigns on real workers: killed workers, a killed driver, Ctrl-C, and a scheduler with TLS and two workers."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

import gcs
from gcs.campaign.campaign_flight import MACHINE
from gcs.campaign.records import PARTS, CampaignFolder
from gcs.scenario.sources.load import load_scenario
from tests.bridge.flying import step_aside
from tests.kept import GCS

FLIGHTS = 10
HOW = ("--seed", "7", "--wind", "0..4@any", "--gusts", "light,moderate", "--fault", "40%:any:die@any", "--worst", "1")
LONG_S = 1200.0  # on a machine that does much else


@pytest.fixture(scope="module")
def plan_file(repo_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("campaign") / "step.skein"
    plan = gcs.make_plan(step_aside(load_scenario(repo_root / "missions" / "field")))
    gcs.save_plan(plan, gcs.verify(plan), file)
    return file


def command(plan_file: Path, to: Path, *more: str, flights: int = FLIGHTS) -> list[str]:
    return [*GCS, "campaign", str(plan_file), "--flights", str(flights), *HOW, "--to", str(to), *more]


@contextmanager
def driver(line: list[str]) -> Iterator[subprocess.Popen[str]]:
    """A process in a group of its own, as a shell has it, which is killed in the end."""
    process = subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_until(true: Callable[[], object], limit_s: float = LONG_S) -> None:
    end_s = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < end_s, "it took too long"
        time.sleep(0.2)


def parts(folder: Path) -> list[Path]:
    return list((folder / PARTS).glob("*.parquet"))


def table(folder: Path) -> list[dict[str, Any]]:
    rows = CampaignFolder(folder).results()
    return [{name: value for name, value in row.items() if name not in MACHINE} for row in rows]


def whole_flights(folder: Path) -> list[str]:
    return sorted(one.name for one in (folder / "flights").iterdir())


def processes_of(driver: subprocess.Popen[str]) -> list[psutil.Process]:
    return list(psutil.Process(driver.pid).children(recursive=True))


def all_gone(processes: list[psutil.Process]) -> bool:
    return not any(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in processes)


def workers_of(processes: list[psutil.Process]) -> list[psutil.Process]:
    found = []
    for one in processes:
        with suppress(psutil.NoSuchProcess):  # vehicles come and go
            if "spawn_main" in " ".join(one.cmdline()):
                found.append(one)
    return found


@pytest.fixture(scope="module")
def undisturbed(plan_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    to = tmp_path_factory.mktemp("undisturbed") / "c"
    done = subprocess.run(
        command(plan_file, to, "--workers", "1", "--json"), capture_output=True, text=True, timeout=LONG_S, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    said = json.loads(done.stdout)
    assert said["complete"] is True
    assert said["ended"] == FLIGHTS
    return to


@pytest.mark.long
def test_killed_workers_and_a_killed_driver_change_nothing(plan_file: Path, undisturbed: Path, tmp_path: Path) -> None:
    to = tmp_path / "c"
    with driver(command(plan_file, to, "--workers", "2")) as first:
        wait_until(lambda: parts(to) or first.poll() is not None)
        assert first.poll() is None, first.communicate()[0]
        every = processes_of(first)
        first.send_signal(signal.SIGSTOP)  # else it may end before the second one has begun
        again = subprocess.run(command(plan_file, to), capture_output=True, text=True, timeout=LONG_S, check=False)
        first.send_signal(signal.SIGCONT)
        assert again.returncode == 2
        assert "another process flies the campaign" in again.stderr
        workers_of(every)[0].kill()
        count = len(parts(to))
        wait_until(lambda: len(parts(to)) > count)
        every += processes_of(first)
        first.kill()
        first.wait()
    wait_until(lambda: all_gone(every), 30.0)
    known = {row["index"] for row in table(to)}
    assert 0 < len(known) < FLIGHTS
    done = subprocess.run(
        command(plan_file, to, "--workers", "2"), capture_output=True, text=True, timeout=LONG_S, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert table(to) == table(undisturbed)
    assert whole_flights(to) == whole_flights(undisturbed)
    refused = subprocess.run(
        command(plan_file, to, flights=9), capture_output=True, text=True, timeout=LONG_S, check=False
    )
    assert refused.returncode == 2
    assert "another flights" in refused.stderr


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(plan_file: Path, tmp_path: Path) -> None:
    to = tmp_path / "c"
    with driver(command(plan_file, to, "--workers", "2", flights=50)) as process:
        wait_until(lambda: parts(to) or process.poll() is not None)
        every = processes_of(process)
        os.killpg(process.pid, signal.SIGINT)
        said = process.communicate(timeout=30.0)[0]
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert table(to)
    wait_until(lambda: all_gone(every), 15.0)


@pytest.mark.long
def test_kept_flights_are_flown_again_and_replayed(undisturbed: Path) -> None:
    worst = next(row["index"] for row in table(undisturbed) if row["outcome"] == "held")
    folder = undisturbed / "flights" / (whole_flights(undisturbed)[0] if worst is None else f"{worst:06d}")
    if not folder.is_dir():
        folder = undisturbed / "flights" / whole_flights(undisturbed)[0]
    for line in (["refly", str(folder), "--speedup", "max"], ["replay", str(folder), "--json"]):
        done = subprocess.run([*GCS, *line], capture_output=True, text=True, timeout=LONG_S, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
def test_the_cluster_of_the_page_flies_the_same(
    repo_root: Path, plan_file: Path, undisturbed: Path, tmp_path: Path
) -> None:
    page = (repo_root / "docs" / "campaigns.md").read_text()
    blocks = re.findall(r"^```sh\n(.*?)^```$", page, re.M | re.S)
    certificates = next(block for block in blocks if "openssl" in block)
    subprocess.run(["sh", "-ec", certificates], cwd=tmp_path, check=True, capture_output=True, timeout=60.0)
    lines = next(block for block in blocks if "dask scheduler" in block).splitlines()
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        port = str(held.getsockname()[1])
    settings = "\n".join(line for line in lines if line.startswith(("TLS", "export")))
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    with ExitStack() as stack:
        for begin in ("dask scheduler", "dask worker"):
            line = next(line for line in lines if line.startswith(begin)).replace("8786", port)
            process = subprocess.Popen(
                ["sh", "-ec", f"{settings}\nexec {line}"],
                cwd=tmp_path,
                env=environment,
                stderr=subprocess.STDOUT,
                stdout=(tmp_path / f"{begin}.log").open("wb"),
                start_new_session=True,
            )
            stack.callback(process.wait)
            stack.callback(process.terminate)
        log = tmp_path / "dask scheduler.log"
        wait_until(lambda: log.read_text().count("Register worker") >= 2, 120.0)
        at = ["--scheduler", f"tls://127.0.0.1:{port}", "--tls", str(tmp_path / "tls")]
        done = subprocess.run(
            command(plan_file, tmp_path / "c", *at), capture_output=True, text=True, timeout=LONG_S, check=False
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "on 2 workers" in done.stdout
    assert table(tmp_path / "c") == table(undisturbed)


@pytest.mark.slow
def test_the_first_command_of_the_page_is_read(repo_root: Path, tmp_path: Path) -> None:
    """It flies for hours: here it is stopped as soon as its workers are there."""
    page = (repo_root / "docs" / "campaigns.md").read_text()
    block = next(block for block in re.findall(r"^```sh\n(.*?)^```$", page, re.M | re.S))
    words = block.replace("\\\n", " ").splitlines()[0].split("#")[0].replace("'", "").split()
    shutil.copytree(repo_root / "missions" / "field", tmp_path / "field")
    words = [*GCS, *words[1:-1], str(tmp_path / "c")]
    with driver(words) as process:
        assert process.stdout is not None
        said = []
        for line in process.stdout:
            said.append(line)
            if "flying 1000 flights" in line:
                break
        assert "flying 1000 flights" in said[-1], "".join(said)
        os.killpg(process.pid, signal.SIGINT)
        process.communicate(timeout=30.0)
