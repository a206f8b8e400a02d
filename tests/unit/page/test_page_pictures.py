"""What a page draws beside tracks, in a real Chromium: coverage as it grows, bands of missions, a map, side views."""

from __future__ import annotations

import struct
import threading
import zlib
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from gcs.flight.assessment.flown_coverage import flown_coverage
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.scene.plan_scene import scene_of_plan
from gcs.flight.scene.predicted_band import band_of
from gcs.flight.scene.recording_scene import scene_of_recording
from gcs.flight.scene.scene_json import band_json, picture_json, scene_json
from gcs.flight.scene.scene_model import FlightPicture, SceneKind, VehiclePicture
from gcs.page.page_feed import PageFeed
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.places import SurveyTable
from tests.browser import CHROMIUM, WHY_NOT, Browser
from tests.real_flights import plan_of
from tests.unit.flight.scene.test_scene import NAME, recording_of
from tests.unit.page.test_page_in_browser import at, browser, cell, page_of, shown

__all__ = ["browser", "shown"]
pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason=WHY_NOT)]


@pytest.fixture(scope="module")
def plan() -> Plan:
    return plan_of(NAME)


def surveyed(plan: Plan) -> Plan:
    """The same flight over an area with a hole."""
    places = plan.states(np.linspace(30.0, 50.0, 50))[..., POSITION]
    (north, east), wide = np.median(places[..., :2], axis=(0, 1)), 40.0
    ring = tuple((north + a * wide, east + b * wide) for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1)))
    hole = {"polygon_m": [(north + 5 * a + 20, east + 5 * b) for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))]}
    table = SurveyTable.model_validate({"swath_m": 6.0, "polygon_m": ring, "hole": [hole]})
    return replace(plan, scenario=plan.scenario.model_copy(update={"survey": table}))


def test_the_area_of_a_survey_is_seen_as_far_as_it_was_flown(plan: Plan, shown: Browser) -> None:
    over = surveyed(plan)
    recording = replace(recording_of(over), plan=over)
    with page_of(scene_of_recording(recording, 0.0, 79.5), shown):
        for t_s in (10.0, 60.0, 79.0):
            at(shown, t_s)
            tracks = {
                one.sysid: (one.t_s[one.t_s <= t_s], one.position_ned_m[one.t_s <= t_s]) for one in recording.tracks
            }
            exact = flown_coverage(over, tracks)
            assert exact is not None
            assert shown.value(f"skein.world.survey.share({t_s})") == pytest.approx(exact.share, abs=0.02)
            assert shown.value("document.querySelector('.seen').textContent").endswith("% of the area seen")
        assert shown.value("skein.world.survey.share(79) > skein.world.survey.share(10)")
        assert shown.value("skein.world.survey.rings.length") == 2
        cells = np.array(shown.value("skein.world.survey.cells"))
        hole = np.array(over.scenario.survey.hole[0].polygon_m) if over.scenario.survey else np.empty((0, 2))
        assert len(cells) > 1000 and not ((cells > hole.min(axis=0)) & (cells < hole.max(axis=0))).all(axis=1).any()


def test_a_replay_shows_the_band_of_missions_and_who_was_outside(plan: Plan, shown: Browser) -> None:
    """The third vehicle flies farther aside than the band is wide, from 20 s on."""
    tracks, recording = PredictedTracks.of_plan(plan), recording_of(plan, aside_m=0.0)
    third = recording.tracks[2]
    aside_m = np.where(third.t_s[:, None] > 20.0, [0.0, tracks.band_m + 2.0, 0.0], 0.0)
    third = replace(third, position_ned_m=third.position_ned_m + aside_m)
    flown = (*recording.tracks[:2], third, *recording.tracks[3:])
    recording = replace(recording, tracks=flown, predicted=tracks)
    with page_of(scene_of_recording(recording, 0.0, 79.5), shown):
        at(shown, 40.0)
        assert [cell(shown, sysid, "band") for sysid in plan.sysids][1:4] == ["in", "! out", "in"]
        for row, sysid in enumerate(plan.sysids):
            found = np.array(shown.value(f"skein.world.band.places({row}, 40)"))
            times = 40.0 + tracks.band_s[row] * np.linspace(-1.0, 1.0, 7)
            assert found == pytest.approx(tracks.places([row], times[None])[0], abs=0.1), sysid
        at(shown, 79.0)


def test_a_flight_under_way_shows_the_band_once_it_is_known(plan: Plan, shown: Browser) -> None:
    scene = scene_of_plan(plan, SceneKind.FLIGHT)
    vehicles = tuple(
        VehiclePicture(
            sysid, (*map(float, place),), 0.5, 7.0, "AUTO", True, 3.0, 0.1, 0.0, 0.3, 20.0, 1, 5.0, sysid != 3
        )
        for sysid, place in zip(plan.sysids, plan.states(np.array([50.0]))[:, 0, POSITION], strict=True)
    )
    first = picture_json(FlightPicture(50.0, "flying: mission", vehicles, 5.0, (1, 2), 0.4))
    with page_of(scene, shown, first) as feed:
        assert not shown.value("document.querySelector('.fleet').innerText.includes('band')")
        feed.put("band", band_json(band_of(PredictedTracks.of_plan(plan), plan, scene.t_s)))
        feed.show(first)
        shown.until("skein.world.band && skein.table.rows.get(3).row.innerText.includes('! out')")
        assert cell(shown, 2, "band") == "in"
        needed = scene.needed_pct
        if needed is not None:
            words = cell(shown, 2, "battery")
            assert words == f"! 3 ({np.interp(50.0, scene.t_s, needed[1]):.0f})"


TILE_RGB = (20, 60, 200)


def tile() -> bytes:
    """A picture of 4 by 4 pixels of one colour, as PNG."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = (b"\0" + bytes(TILE_RGB) * 4) * 4
    head = struct.pack(">IIBBBBB", 4, 4, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


@pytest.fixture
def tiles() -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """The address of a server of map tiles, and what it is asked for, with who asks."""
    asked: list[tuple[str, str]] = []

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append((self.path, self.headers.get("Referer", "")))
            self.send_response(200)
            self.send_header("Content-Type", "image/png")
            self.send_header("Access-Control-Allow-Origin", "*")
            self.end_headers()
            self.wfile.write(tile())

        def log_message(self, format: str, *given: object) -> None:  # noqa: A002
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/{{z}}/{{x}}/{{y}}.png", asked
        server.shutdown()


def test_a_map_is_laid_under_the_scene_where_an_address_is_given(
    plan: Plan, shown: Browser, tmp_path: Path, tiles: tuple[str, list[tuple[str, str]]]
) -> None:
    url, asked = tiles
    scene = scene_of_plan(plan)
    with PageFeed(scene_json(scene), tiles=url) as feed:
        shown.go(feed.url)
        shown.until("skein.world.markers.size && skein.world.ground.material.map")
        shown.until("document.querySelector('.owner').textContent === 'map: 127.0.0.1'")
        shown.value("skein.look('above')")
        at(shown, 0.0)
        shown.value("new Promise((done) => setTimeout(done, 1000))")
        assert asked and not any(feed.url.partition("token=")[2] in who for _, who in asked), "no token leaves"
        origin = plan.scenario.origin
        zoom = int(asked[0][0].split("/")[1])
        x = (origin.lon_deg + 180.0) / 360.0 * 2**zoom
        y = (1.0 - np.arcsinh(np.tan(np.radians(origin.lat_deg))) / np.pi) / 2.0 * 2**zoom
        assert f"/{zoom}/{int(x)}/{int(y)}.png" in {path for path, _ in asked}, "the tile under the origin"
        red, green, blue = shown.value("""(() => {
            const { map } = skein.world.ground.material;
            return [...map.image.getContext('2d').getImageData(8, 8, 1, 1).data].slice(0, 3); })()""")
        assert (red, green, blue) == TILE_RGB
        shown.go("about:blank")


def test_the_side_view_is_level_and_shows_all_and_the_nearest_two_are_found(plan: Plan, shown: Browser) -> None:
    recording = recording_of(plan)
    scene = scene_of_recording(recording, 0.0, 79.5)
    with page_of(scene, shown):
        at(shown, 15.0)
        shown.press("s")
        at(shown, 15.0)
        up = shown.value(
            "(() => { const { camera, controls } = skein.world; const way = camera.position.clone()"
            ".sub(controls.target).normalize(); return way.z; })()"
        )
        assert abs(up) < 0.1
        far = shown.value(
            "Math.max(...[...skein.world.markers.values()].map((one) => {"
            " const seen = one.clone().project(skein.world.camera);"
            " return Math.max(Math.abs(seen.x), Math.abs(seen.y)); }))"
        )
        assert far < 1.0, "all are in sight"
        shown.press("w")
        curve = next(one for one in scene.curves if one.name == "least separation")
        assert curve.flown is not None
        aloft = np.array(
            [
                any(p.begin_s <= t < p.end_s and p.name not in ("takeoff", "landing") for p in scene.phases)
                for t in scene.t_s
            ]
        )
        least_m = np.nanmin(np.where(aloft, curve.flown, np.nan))
        found = int(np.argmin(np.abs(scene.t_s - shown.value("skein.t"))))
        assert aloft[found] and curve.flown[found] == pytest.approx(least_m, abs=1e-4)
        assert int(shown.value("skein.world.view")) == curve.vehicles[found, 0]
