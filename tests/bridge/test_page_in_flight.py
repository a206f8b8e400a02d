"""`gcs fly --sim --page`: the page has the flight's pictures and events, and the flight needs no page."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import World, WorldOptions
from tests.fleets import free_port, running_fleet
from tests.kept import GCS

ADDRESS = re.compile(r"page: (http://127\.0\.0\.1:\d+/)\?token=[\w-]+")


def page_of(command: int) -> int:
    """The process id of the page that a command has started."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            is_page = b"gcs.page.page_process" in (entry / "cmdline").read_bytes()
        except (OSError, ValueError):
            continue
        if parent == command and is_page:
            return int(entry.name)
    raise AssertionError("no page")


@pytest.mark.slow
@pytest.mark.parametrize(
    "number",
    [pytest.param(None, marks=pytest.mark.long), signal.SIGSTOP, pytest.param(signal.SIGKILL, marks=pytest.mark.long)],
    ids=["shown", "frozen", "killed"],
)
def test_a_flight_is_shown_and_goes_on_without_its_page(
    hop: Plan, hop_skein: Path, tmp_path: Path, number: signal.Signals | None
) -> None:
    flown = [*GCS, "fly", str(hop_skein), "--sim", "--speedup", "5", "--page", "--to", str(tmp_path)]
    said: list[str] = []
    with subprocess.Popen(flown, stdout=subprocess.PIPE, text=True) as command:
        assert command.stdout is not None

        def read_until(is_there: Callable[[str], Any]) -> str:
            while not is_there(said[-1] if said else ""):
                said.append(command.stdout.readline())  # type: ignore[union-attr]
                assert said[-1], f"it ended: {said}"
            return said[-1]

        found = ADDRESS.search(read_until(ADDRESS.search))
        assert found is not None
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        opener.open(found[0].removeprefix("page: ")).read()
        read_until(lambda line: "flying: t =" in line)
        end_s = time.monotonic() + 60.0
        while not (pictures := [one for one in _whole(opener, found[1])["pictures"] if (one["t_s"] or 0.0) > 1.0]):
            assert time.monotonic() < end_s, "no picture of the flight"
        if number is not None:
            os.kill(page_of(command.pid), number)
        said.append(command.stdout.read())
        assert command.wait() == 0, said
    assert ("the page has ended; the flight goes on without it" in said[-1]) == (number is signal.SIGKILL)
    picture = pictures[-1]
    planned = hop.states(np.array([picture["t_s"]]))[:, 0, POSITION]
    reported = np.array([vehicle["place_ned_m"] for vehicle in picture["vehicles"]])
    assert np.linalg.norm(reported - planned, axis=1).max() < 2.0
    assert [vehicle["mode"] for vehicle in picture["vehicles"]] == ["GUIDED"] * len(hop.sysids)


@pytest.mark.slow
def test_the_word_typed_on_the_page_arms_and_the_log_has_every_alarm_of_an_autopilot(
    hop: Plan, hop_skein: Path, tmp_path: Path
) -> None:
    """No input at the terminal, and the page says GO: a wrong word arms nothing, and no word before it is asked for."""
    port = free_port()
    options = WorldOptions(links=(call(port),), speedup=10.0)
    with running_fleet(hop.scenario, options) as fleet:
        arm_on_page(fleet, f"udpin:127.0.0.1:{port}", hop_skein, tmp_path)
    (folder,) = [one for one in tmp_path.iterdir() if one.is_dir()]
    events = (folder / "events.jsonl").read_text()
    assert "may be armed, confirmed by the page at 127.0.0.1" in events


def arm_on_page(fleet: World, link: str, hop_skein: Path, tmp_path: Path) -> None:
    """Fly, type the word on the page, and land by Ctrl-C."""
    line = [*GCS, "fly", str(hop_skein), "--link", link, "--page", "--to", str(tmp_path)]
    env = {**os.environ, "PYTHONUNBUFFERED": "1"}
    quiet = subprocess.DEVNULL
    with subprocess.Popen(line, stdin=quiet, stdout=subprocess.PIPE, text=True, env=env) as command:
        assert command.stdout is not None
        said: list[str] = []

        def read_until(words: str) -> str:
            while words not in (said[-1] if said else ""):
                said.append(command.stdout.readline())  # type: ignore[union-attr]
                assert said[-1], f"it ended: {said}"
            return said[-1]

        try:
            found = ADDRESS.search(read_until("page: http"))
            assert found is not None
            opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
            opener.open(found[0].removeprefix("page: ")).read()
            assert _asked(opener, found[1], {"word": "arm"})["may"] is False, "nothing was checked yet"
            read_until("the word can be typed on the page")
            end_s = time.monotonic() + 60.0
            while "question" not in (board := _whole(opener, found[1])["board"]):
                assert time.monotonic() < end_s
            assert board["checks"]["title"] == "GO" and len(board["checks"]["rows"]) >= 3 * 10
            assert "This arms and flies 3 vehicles" in board["question"]
            assert _asked(opener, found[1], {"word": "yes"}) == answer_of("not armed: the word is 'arm'", may=False)
            assert not fleet.vehicles[0].autopilot.armed
            assert _asked(opener, found[1], {"word": "arm"}) == answer_of("confirmed", may=True)
            read_until("flying: ")
            fleet.vehicles[1]._queue_text(2, "Potential Thrust Loss (3)")
            fleet.vehicles[2]._queue_text(4, "Something that no table has")
            end_s, alarms = time.monotonic() + 60.0, set[tuple[int, str]]()
            while (
                not {
                    (2, "reports: CRITICAL: Potential Thrust Loss (3)"),
                    (3, "reports: WARNING: Something that no table has"),
                }
                <= alarms
            ):
                assert time.monotonic() < end_s, alarms
                events = _whole(opener, found[1])["events"]
                alarms = {(one["sysid"], one["text"].partition(". ")[0]) for one in events if one["is_bad"]}
            command.send_signal(signal.SIGINT)
            command.communicate(timeout=600.0)
        finally:
            command.kill()


@pytest.mark.slow
def test_a_page_that_is_kept_shows_verdict_and_files_until_ctrl_c(hop_skein: Path, tmp_path: Path) -> None:
    line = [*GCS, "fly", str(hop_skein), "--sim", "--speedup", "10", "--page", "--page-keep", "--to", str(tmp_path)]
    env = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=env) as command:
        assert command.stdout is not None
        try:
            found = None
            while "the page stays" not in (said := command.stdout.readline()):
                assert said, "it ended"
                found = found or ADDRESS.search(said)
            assert found is not None
            opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
            opener.open(found[0].removeprefix("page: ")).read()
            whole = _whole(opener, found[1])
            report, curves = whole["board"]["report"], {one["name"]: one for one in whole["scene"]["curves"]}
            assert whole["scene"]["kind"] == "replay" and curves["least separation"]["true"] is not None
            assert report["outcome"] == "flight ok" and {"report.md", "map.png"} <= {*report["files"]}
            assert len(report["criteria"]) >= 6 and not any(one["is_bad"] for one in report["criteria"])
            assert opener.open(f"{found[1]}files/map.png").read(8) == b"\x89PNG\r\n\x1a\n"
            assert _asked(opener, found[1], {"order": "land"})["text"] == "not given: the flight is over"
            command.send_signal(signal.SIGINT)
            begin_s = time.monotonic()
            command.communicate(timeout=60.0)
            assert command.returncode == 0 and time.monotonic() - begin_s < 10.0
        finally:
            command.kill()


def _asked(opener: urllib.request.OpenerDirector, address: str, message: dict[str, Any]) -> dict[str, Any]:
    origin = {"Origin": address.rstrip("/")}
    found: dict[str, Any] = json.loads(
        opener.open(urllib.request.Request(f"{address}orders", json.dumps(message).encode(), origin)).read()
    )
    return {name: found[name] for name in ("text", "may")}


def answer_of(text: str, *, may: bool) -> dict[str, Any]:
    return {"text": text, "may": may}


def _whole(opener: urllib.request.OpenerDirector, address: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(opener.open(f"{address}scene").read())
    return found
