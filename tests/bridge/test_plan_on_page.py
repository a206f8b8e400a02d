"""A zone drawn on the page: the plan round it is proposed with its cost, accepted, flown, and shown."""

from __future__ import annotations

import json
import re
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gcs.flight.assessment.judge import load_truth
from gcs.flight.recording.flight_folder import read_flown_plan
from gcs.flight.recording.flight_state import read_flight_state
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from tests.browser import CHROMIUM, WHY_NOT, Browser
from tests.kept import GCS

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason=WHY_NOT)]
ADDRESS = re.compile(r"page: (http://127\.0\.0\.1:\d+/\?token=[\w-]+)")
CHANGED = "document.querySelector('.changed')"
SAID = f"{CHANGED}.querySelector('output:last-child').textContent"
RADIUS_M = 3.0


def pixel(page: Browser, north_m: float, east_m: float) -> tuple[float, float]:
    """Where a place on the ground is seen in the window."""
    north, east = float(north_m), float(east_m)
    x, y = page.value(
        f"(({{ world }}) => {{ const seen = world.at([{north}, {east}, -world.heightAt({north}, {east})])"
        ".project(world.camera); const box = world.renderer.domElement.getBoundingClientRect();"
        " return [box.left + (seen.x + 1) * world.width / 2, box.top + (1 - seen.y) * world.height / 2]; })(skein)"
    )
    return x, y


def draw(page: Browser, centre_m: tuple[float, float], radius_m: float) -> None:
    """Draw a zone with the mouse."""
    page.value(f"{CHANGED}.querySelector('.draw').click()")
    page.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    at, edge = pixel(page, *centre_m), pixel(page, centre_m[0], centre_m[1] + radius_m)
    button = {"button": "left", "buttons": 1, "clickCount": 1}
    page.call("Input.dispatchMouseEvent", type="mousePressed", x=at[0], y=at[1], **button)
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=edge[0], y=edge[1], **button)
    page.call("Input.dispatchMouseEvent", type="mouseReleased", x=edge[0], y=edge[1], **button)


def test_a_zone_drawn_on_the_page_is_flown_round_once_its_plan_is_accepted_and_the_nearest_two_are_found(
    hop: Plan, hop_skein: Path, tmp_path: Path
) -> None:
    north_m, east_m = (float(metres) for metres in hop.leader_trajectory.state(20.0)[:2])
    flown = [*GCS, "fly", str(hop_skein), "--sim", "--speedup", "1", "--page", "--page-keep", "--to", str(tmp_path)]
    with (
        subprocess.Popen(flown, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as command,
        Browser() as page,
    ):
        assert command.stdout is not None
        try:
            found = None
            while found is None:
                line = command.stdout.readline()
                assert line, "it ended"
                found = ADDRESS.search(line)
            page.go(found[1])
            page.until("skein.scene.newest.t_s > 2", 120.0)
            draw(page, (north_m, east_m + 1.0), RADIUS_M)
            page.until(f"!{CHANGED}.querySelector('.proposal').hidden", 60.0)
            words = page.value(f"{CHANGED}.querySelector('.proposal p').textContent")
            assert re.match(r"avoid [\d.]+ m around \(.*\): verified; a plan from t = [\d.]+ s on, landing ", words)
            assert "least separation" in words and "way of the longest" in words
            assert page.value("skein.changes.drawing.ways.length") == len(hop.sysids)
            assert page.value("document.activeElement.className") == "drop", "Enter flies no plan"
            assert page.value("skein.scene.zones.length") == 1, "nothing is flown yet but the plan within its fence"
            events = next(tmp_path.iterdir()) / "events.jsonl"
            assert "asked to" not in (events.read_text() if events.exists() else "")
            page.value(f"{CHANGED}.querySelector('.accept').focus()")
            page.press("Enter")
            page.until(f"{SAID}.startsWith('a new plan is flown from t = ')", 60.0)
            page.until("skein.scene.zones.length === 2", 60.0)
            page.until("skein.scene.kind === 'replay' && !document.querySelector('.report').hidden", 200.0)
            page.value("document.querySelector('.nearest').click()")
            nearest = page.value("document.querySelector('.found').textContent")
            assert page.elsewhere() == [] and page.said == []
            page.go("about:blank")
            command.send_signal(signal.SIGINT)
            said = command.communicate(timeout=60.0)[0]
            assert command.returncode == 0, said
        finally:
            command.kill()
    (folder,) = [one for one in tmp_path.iterdir() if one.is_dir()]
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    (asked,) = [one["data"] for one in events if "asked to" in one["what"]]
    assert asked["by"] == "the page at 127.0.0.1" and asked["order"] in words
    (zone,) = read_flown_plan(folder).scenario.no_fly
    assert zone.north_m == pytest.approx(north_m, abs=0.4) and zone.east_m == pytest.approx(east_m + 1.0, abs=0.4)
    (change,) = [one["data"]["begins_t_s"] for one in events if one["what"].startswith("fly a new plan")]
    truth = load_truth(folder / "truth.npz")
    places = truth.states[..., POSITION]
    assert change < 18.0
    away_m = np.linalg.norm(places[..., :2] - (zone.north_m, zone.east_m), axis=-1).min() - zone.radius_m
    assert away_m > 0.0
    (least_m,) = re.findall(
        r"^vehicles \d, \d: ([\d.]+) m at [\d.]+ s, -?\d+ m north, -?\d+ m east, \d+ m high$", nearest
    )
    t_s = truth.t_s(read_flight_state(folder).t0_unix_s or 0.0)
    chosen = (t_s > 0.0) & (t_s < hop.landing_s)
    assert float(least_m) == pytest.approx(hop.separations_m(t_s[chosen], places[:, chosen]).min(), abs=0.05), (
        "the true one"
    )
