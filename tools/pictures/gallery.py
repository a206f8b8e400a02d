"""One of each kind of picture that `gcs show`, `gcs fly` and `gcs replay` draw, for docs/gallery.md."""

import lzma
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import gcs
from gcs.flight.plots.figure_file import save
from gcs.flight.plots.flight_plot import draw_formation, draw_map, shown_s
from gcs.flight.plots.overview_plot import draw_plan, draw_scenario
from gcs.flight.plots.replay_plot import draw_recording
from gcs.flight.plots.tracks_view import draw_tracks
from gcs.flight.recording.load_recording import load_recording
from gcs.physics.states import POSITION

_STEP_S = 0.25
_SHADES = 240  # of a picture's palette: half of the file
_SCENARIO = """
schema_version = 1
name = "line"
title = "four quadrotors in a line"
vehicle_type = "quad500"
origin = { lat_deg = 47.39, lon_deg = 8.54, alt_amsl_m = 430.0 }
time = { flight_s = 120.0 }
start = { position_m = [0.0, 0.0, 12.0], roll_pitch_yaw_deg = [0.0, 0.0, 45.0] }
end = { position_m = [280.0, 280.0, 12.0], roll_pitch_yaw_deg = [0.0, 0.0, 45.0] }
wind = { speed_mps = 4.0, from_deg = 300.0 }
no_fly = [
  { polygon_m = [[120.0, 130.0], [170.0, 120.0], [165.0, 175.0], [140.0, 165.0], [122.0, 180.0]] },
  { north_m = 200.0, east_m = 270.0, radius_m = 20.0, moves = [[0, 0, 0], [60, 30, -10]] },
]

[limits]
north_m = [-140.0, 410.0]
east_m = [-130.0, 420.0]
height_m = [0.0, 40.0]
clearance_min_m = 5.0
separation_min_m = 4.0

[formation]
count = 4
start_shape = "line"
shape = [{ name = "line", generator = "line", spacing_m = 8.0, heading_deg = 45.0 }]
"""


def write_gallery(root: Path, folder: Path) -> Iterator[Path]:
    """Draw a scenario, a plan that changes its shape, and a recorded flight of six PX4 vehicles."""
    with tempfile.TemporaryDirectory() as name:
        there = Path(name)
        (there / "scenario.toml").write_text(_SCENARIO, encoding="utf-8")
        yield _written(draw_scenario(gcs.load_scenario(there)), folder / "scenario.png")
        plan = gcs.make_plan(gcs.load_scenario(root / "missions" / "changes"))
        t_s = np.arange(plan.t_start_s, plan.t_end_s, _STEP_S)
        places = plan.states(t_s)[..., POSITION]
        yield _written(draw_plan(plan), folder / "plan.png")
        yield _written(draw_tracks(plan.scenario, plan.sysids, t_s, places, plan.moves), folder / "tracks.png")
        yield _written(draw_formation(plan.scenario, plan.sysids, t_s, places, shown_s(plan)), folder / "formation.png")
        for path in (root / "tests/recorded/flights/px4-1.17dev-stream").iterdir():
            if path.suffix == ".xz":
                (there / path.stem).write_bytes(lzma.decompress(path.read_bytes()))
            else:
                shutil.copyfile(path, there / path.name)
        recording = load_recording(there).recording
        yield _written(draw_recording(recording, *recording.span_s), folder / "replay.png")
        assert recording.plan is not None
        t_s = np.arange(*recording.span_s, _STEP_S)
        planned = recording.planned(t_s)
        below = None if planned is None else planned[0]
        flown = draw_map(recording.plan.scenario, recording.sysids, t_s, recording.at(t_s)[0], below)
        yield _written(flown, folder / "map.png")


def _written(figure: Any, path: Path) -> Path:
    save(figure, path)
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(_SHADES)
    small.save(path, optimize=True)
    return path
