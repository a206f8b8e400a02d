"""A formation close up over its terrain: a perspective view with ground, tracks and vehicles.

Places are metres north, east and up. The image plane is vertical, so that a column of pixels is a vertical plane.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Terrain
from gcs.types import Array
from tools.pictures.scenery import colour

WIDTH, HEIGHT = 960, 540  # of the picture, in pixels
_DPI = 110
_NEAR_M, _FAR_M, _STEPS = 1.0, 3000.0, 1200
_HAZE_M = 1400.0  # at this distance the ground has lost 63 % of its colour
_HIGH_M = 55.0  # the colours of the ground end here
_CONTOUR_M = 5.0
_TRACK_S = 60.0
_SUN = np.array([0.45, -0.75, 0.62])  # north, east, up: the direction towards the sun
_SKY, _HORIZON = np.array([0.42, 0.62, 0.84]), np.array([0.90, 0.93, 0.95])
_COLOURS = ["#8ea383", "#a9b08c", "#c4b18e", "#b6a190", "#ddd7d1", "#ffffff"]
_GROUND = LinearSegmentedColormap.from_list("ground", _COLOURS)
_DARK = "#222222"
_HALO = [patheffects.withStroke(linewidth=3.0, foreground="white")]
_CIRCLE = np.stack([np.cos(a := np.linspace(0.0, 2.0 * np.pi, 33)), np.sin(a), 0.0 * a], axis=1)
_HUBS = np.array([(np.cos(a), np.sin(a), 0.0) for a in np.radians([45.0, 135.0, 225.0, 315.0])])


@dataclass(frozen=True)
class Camera:
    """A place, the azimuth of the view, focal length over picture width, and the horizon's share of the height."""

    place_m: Array
    azimuth_rad: float
    focal: float = 1.0
    horizon: float = 0.73

    def pixels(self, places_m: Array) -> tuple[Array, Array]:
        """Pixels (..., 2) from the lower left of places (..., 3), and their distances (...) along the view, in m."""
        north, east, up = np.moveaxis(places_m - self.place_m, -1, 0)
        ahead = north * np.cos(self.azimuth_rad) + east * np.sin(self.azimuth_rad)
        right = east * np.cos(self.azimuth_rad) - north * np.sin(self.azimuth_rad)
        scale = self.focal * WIDTH / np.maximum(ahead, 1e-3)
        return np.stack([0.5 * WIDTH + scale * right, self.horizon * HEIGHT + scale * up], axis=-1), ahead


def camera_near(plan: Plan, t_s: float, ahead_left_up_m: tuple[float, float, float], turn_deg: float = 0.0) -> Camera:
    """A camera so far from the formation's middle at `t_s`; it looks there, then turns to the right."""
    ahead_m, left_m, up_m = ahead_left_up_m
    state = plan.states(np.array([t_s]))[plan.leader, 0]
    cos, sin = state[3:5] / np.linalg.norm(state[3:5])
    middle = _places_m(plan, np.array([t_s]))[:, 0].mean(axis=0)
    place = middle + np.array([ahead_m * cos + left_m * sin, ahead_m * sin - left_m * cos, up_m])
    north, east, _ = middle - place
    return Camera(place, float(np.arctan2(east, north) + np.radians(turn_deg)))


def draw_view(plan: Plan, t_s: float, camera: Camera, size: float = 2.4, samples: int = 2) -> Figure:
    """The formation at `t_s` after a minute of track; vehicles `size` times their own; `samples`² rays a pixel."""
    figure = Figure(figsize=(WIDTH / _DPI, HEIGHT / _DPI))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(ground_image(plan.scenario.terrain, camera, samples), extent=(0, WIDTH, 0, HEIGHT), origin="lower")
    axes.set(xlim=(0, WIDTH), ylim=(0, HEIGHT))
    axes.axis("off")
    _draw_tracks(axes, plan, camera, t_s)
    _draw_vehicles(axes, plan, camera, t_s, size)
    return figure


def ground_image(terrain: Terrain, camera: Camera, samples: int = 1) -> Array:
    """Ground and sky (HEIGHT, WIDTH, 3), from below to above: each ray takes the first ground that it meets."""
    right_m = (np.arange(WIDTH * samples) + 0.5) / (samples * camera.focal * WIDTH) - 0.5 / camera.focal
    ray = ((np.arange(HEIGHT * samples) + 0.5) / samples - camera.horizon * HEIGHT) / (camera.focal * WIDTH)
    ahead = np.geomspace(_NEAR_M, _FAR_M, _STEPS)
    right = right_m[:, None] * ahead
    cos, sin = np.cos(camera.azimuth_rad), np.sin(camera.azimuth_rad)
    north = camera.place_m[0] + ahead * cos - right * sin
    east = camera.place_m[1] + ahead * sin + right * cos
    height = ground_height_m(terrain, north, east)
    paint = _paint(terrain, north, east, height, ahead)
    slope = (height - camera.place_m[2]) / ahead
    seen = np.maximum.accumulate(slope, axis=1)
    blue = np.clip(ray / float(ray[-1]), 0.0, 1.0)[:, None]
    sky = _HORIZON * (1.0 - blue) + _SKY * blue
    image = np.empty((len(ray), len(right_m), 3))
    for column in range(len(right_m)):
        first = np.clip(np.searchsorted(seen[column], ray), 1, _STEPS - 1)
        rise = slope[column, first] - slope[column, first - 1]
        share = np.clip((ray - slope[column, first - 1]) / np.maximum(rise, 1e-9), 0.0, 1.0)[:, None]
        met = paint[column, first - 1] * (1.0 - share) + paint[column, first] * share
        image[:, column] = np.where((ray <= seen[column, -1])[:, None], met, sky)
    return np.asarray(image.reshape(HEIGHT, samples, WIDTH, samples, 3).mean(axis=(1, 3)))


def _paint(terrain: Terrain, north: Array, east: Array, height: Array, ahead: Array) -> Array:
    """Colours (..., 3) of the ground by height, with light, contour lines and haze."""
    step_m = np.maximum(0.01 * ahead, 0.5)  # a slope over pixels, or ripples far away would flicker
    to_north = ground_height_m(terrain, north + step_m, east) - ground_height_m(terrain, north - step_m, east)
    to_east = ground_height_m(terrain, north, east + step_m) - ground_height_m(terrain, north, east - step_m)
    normal = np.stack([-to_north, -to_east, np.broadcast_to(2.0 * step_m, to_north.shape)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = 0.50 + 0.68 * np.clip(normal @ (_SUN / np.linalg.norm(_SUN)), 0.0, 1.0)
    change = np.abs(np.gradient(height, axis=0)) + np.abs(np.gradient(height, axis=1)) + 1e-9
    off = np.abs((height / _CONTOUR_M + 0.5) % 1.0 - 0.5) * _CONTOUR_M
    line = np.clip(1.5 - off / change, 0.0, 1.0) * (height > 0.5 * _CONTOUR_M)
    light *= 1.0 - 0.22 * line * np.exp(-ahead / 300.0)
    clear = np.exp(-ahead / _HAZE_M)[:, None]
    bare = np.asarray(_GROUND(np.clip(height / _HIGH_M, 0.0, 1.0)))[..., :3] * light[..., None]
    return np.asarray(np.clip(bare * clear + _HORIZON * (1.0 - clear), 0.0, 1.0))


def hidden(terrain: Terrain, camera: Camera, places_m: Array) -> Array:
    """Whether ground stands between the camera and each of places (N, 3): (N,)."""
    share = np.linspace(0.02, 0.995, 200)[:, None, None]
    line = camera.place_m + share * (places_m - camera.place_m)
    return np.asarray((ground_height_m(terrain, line[..., 0], line[..., 1]) > line[..., 2]).any(axis=0))


def _places_m(plan: Plan, t_s: Array) -> Array:
    """Positions (V, N, 3) north, east and up."""
    return np.asarray(plan.states(t_s)[..., POSITION] * (1.0, 1.0, -1.0))


def _draw_tracks(axes: Any, plan: Plan, camera: Camera, t_s: float) -> None:
    """The last minute of every vehicle, thinner with the distance."""
    t = t_s + 0.02 - np.geomspace(0.02, _TRACK_S, 401)
    for row, track in enumerate(_places_m(plan, t)):
        pixels, ahead = camera.pixels(track)
        pixels[hidden(plan.scenario.terrain, camera, track)] = np.nan
        for first in range(0, len(t) - 1, 4):
            width = float(np.clip(20.0 / ahead[first], 0.9, 5.0))
            axes.plot(*pixels[first : first + 5].T, color=colour(row), lw=width, solid_capstyle="round", zorder=2.0)


def _draw_vehicles(axes: Any, plan: Plan, camera: Camera, t_s: float, size: float) -> None:
    """Far ones first: a cross of arms, four discs and the number."""
    states = plan.states(np.array([t_s]))[:, 0]
    places = _places_m(plan, np.array([t_s]))[:, 0]
    vehicle = plan.scenario.vehicle
    arm_m = size * vehicle.arm_m
    disc_m = size * vehicle.power.rotor_radius_m if vehicle.power else 0.5 * arm_m
    for order, row in enumerate(np.argsort(-camera.pixels(places)[1])):
        attitude = Rotation.from_euler("ZYX", states[row, 8:5:-1]).as_matrix()
        seen = partial(_seen, camera, places[row], attitude)
        _draw_vehicle(axes, seen, arm_m, disc_m, colour(int(row)), 3.0 + 0.1 * order)
        above = seen(np.array([0.0, 0.0, -1.1 * arm_m]))
        style = {"ha": "center", "fontsize": 11, "weight": "bold", "path_effects": _HALO, "zorder": 9.0}
        axes.annotate(str(plan.sysids[row]), above, color=colour(int(row)), **style)


def _seen(camera: Camera, place_m: Array, attitude: Array, body_m: Array) -> Array:
    """Pixels of points of a vehicle, forward, right and down from its middle."""
    return camera.pixels(place_m + body_m @ attitude.T * (1.0, 1.0, -1.0))[0]


def _draw_vehicle(axes: Any, seen: Any, arm_m: float, disc_m: float, paint: str, zorder: float) -> None:
    hubs = arm_m * _HUBS
    for arm in (hubs[::2], hubs[1::2]):
        axes.plot(*seen(arm).T, color=_DARK, lw=4.5, solid_capstyle="round", zorder=zorder)
    axes.fill(*seen(0.45 * arm_m * _CIRCLE).T, fc=_DARK, ec=paint, lw=1.5, zorder=zorder + 0.01)
    for hub in hubs:
        top = hub + np.array([0.0, 0.0, -0.25 * arm_m])
        axes.plot(*seen(np.stack([hub, top])).T, color=_DARK, lw=3.0, zorder=zorder + 0.02)
        axes.fill(*seen(top + disc_m * _CIRCLE).T, fc=paint, ec="white", lw=1.0, alpha=0.85, zorder=zorder + 0.03)
