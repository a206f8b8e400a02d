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
@pytest.mark.parametrize("number", [None, signal.SIGSTOP, signal.SIGKILL], ids=["shown", "frozen", "killed"])
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


def _whole(opener: urllib.request.OpenerDirector, address: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(opener.open(f"{address}scene").read())
    return found
