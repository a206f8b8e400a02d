"""Rewrites errors in the file's own degree keys."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np

from gcs.frames import ned_to_geodetic
from gcs.scenario.degrees.to_metres import InDegrees, InMetres
from gcs.scenario.mistakes.mistake import Mistake, degrees, dotted, plain
from gcs.scenario.validation.toml_lines import Key

_NUMBER = r"(-?[\d.]*\d)"
_RANGE = re.compile(r"Write \[[-\d., e+]+\]$")  # in metres
_HEIGHT = 2  # index in a position
_EARTH_M, _WIDER_M = 6.37e6, 0.05
_ROUNDING_M = 0.02  # of degrees with seven digits


def in_degree_keys(mistake: Mistake, found: InMetres) -> Mistake:
    """The mistake with the keys, the value and the next step that fit the file."""
    for place in found.places:
        mistake = dataclasses.replace(
            mistake, remedy=_step(mistake.remedy, place), text=_text(mistake.text, place, mistake.key)
        )
        depth = len(place.table)
        if mistake.key[:depth] == place.table and mistake.key[depth : depth + 1] in [(n,) for n in place.keys.metres]:
            path = _path(mistake.key[depth:], place)
            value: Any = place.values
            for part in path:
                value = value[part]
            mistake = dataclasses.replace(mistake, key=(*place.table, *path), value=value)
    return mistake


def _path(metres: Key, place: InDegrees) -> Key:
    """The key of a table in the file for one in metres."""
    (name, *rest), keys = metres, place.keys
    if keys.form == "position":
        return (_height_key(place) if rest == [_HEIGHT] else "position_deg",)
    return (list(keys.degrees)[keys.metres.index(str(name))], *(rest if keys.form != "box" else ()))


def _height_key(place: InDegrees) -> str:
    return next(name for name in place.keys.heights or () if name in place.values)


def _text(text: str, place: InDegrees, key: Key) -> str:
    """A text that names keys in metres: with those of the file."""
    for metres, other in zip(place.keys.metres, place.keys.degrees, strict=True):
        if place.keys.form == "box":
            text = text.replace(f"limits.{metres},", f"limits.{other}, {metres[:-2]}")
            if key == (*place.table, metres):
                text = _RANGE.sub("Exchange the two numbers", text)
        elif key[: len(place.table)] == place.table:
            text = re.sub(rf"(?<![\w.]){metres}\b", other, text)
    return text


def _step(step: str, place: InDegrees) -> str:
    """A next step that sets keys in metres: with those of the file."""
    table = re.escape(dotted(place.table))
    if place.keys.form == "position":
        pattern = rf"(?<={table}\.)position_m\[([012])\] to {_NUMBER}"
        return re.sub(pattern, lambda found: _moved(place, int(found[1]), float(found[2])), step)
    pattern = rf"(?<={table}\.)(north_m|east_m) to \[{_NUMBER}, {_NUMBER}\]"
    return re.sub(pattern, lambda found: _wider(place, found[1], float(found[2]), float(found[3])), step)


def _moved(place: InDegrees, axis: int, to_m: float) -> str:
    """The position with another coordinate, in degrees or as a height."""
    position = np.array(place.metres["position_m"])
    position[axis] = to_m + (np.sign(to_m - position[axis]) * _ROUNDING_M if axis != _HEIGHT else 0.0)
    lat_deg, lon_deg, alt_amsl_m = map(float, ned_to_geodetic(position * [1.0, 1.0, -1.0], place.origin))
    if axis != _HEIGHT:
        return f"position_deg to [{degrees(lat_deg)}, {degrees(lon_deg)}]"
    height = _height_key(place)
    return f"{height} to {plain(to_m if height == 'height_m' else alt_amsl_m)}"


def _wider(place: InDegrees, name: str, low_m: float, high_m: float) -> str:
    """A range of the box in degrees that holds one in metres."""
    # Parallels are curved and meridians meet, so that the box between them is narrower than at the origin.
    reach_m = max(map(abs, (low_m, high_m, *place.metres["north_m"], *place.metres["east_m"])))
    room_m = _WIDER_M + reach_m**2 * abs(np.tan(np.radians(place.origin.lat_deg))) / _EARTH_M
    ends, axis = np.zeros((2, 3)), place.keys.metres.index(name)
    ends[:, axis] = low_m - room_m, high_m + room_m
    low_deg, high_deg = map(float, ned_to_geodetic(ends, place.origin)[axis])
    return f"{[*place.keys.degrees][axis]} to [{degrees(low_deg)}, {degrees(high_deg)}]"
