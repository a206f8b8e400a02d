"""Mistakes about places in metres, told about the keys in degrees that the file has in their place."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np

from gcs.frames import ned_to_geodetic
from gcs.scenario.degrees.place_mistakes import as_shown
from gcs.scenario.degrees.place_questions import degrees, shown
from gcs.scenario.degrees.to_metres import InDegrees, InMetres
from gcs.scenario.validation.mistakes import Mistake
from gcs.scenario.validation.slips.shown_values import dotted, plain
from gcs.scenario.validation.toml_lines import Key

_NUMBER = r"(-?[\d.]*\d)"
_HEIGHT = 2  # index in a position
_EARTH_M, _WIDER_M = 6.37e6, 0.05
_ROUNDING_M = 0.02  # of degrees with seven digits


def told_in_degrees(mistake: Mistake, found: InMetres) -> Mistake:
    """The mistake with the keys, the value and the next step that fit the file."""
    for place in found.places:
        remedy, text = _step(mistake.remedy, place), _text(mistake.text, place, mistake.key)
        mistake = dataclasses.replace(mistake, remedy=remedy, text=text)
        depth = len(place.table)
        if mistake.key[:depth] == place.table and mistake.key[depth : depth + 1] in [(n,) for n in place.keys.metres]:
            key = _key(mistake.key, place)
            mistake = dataclasses.replace(mistake, key=key, value=_value(place, key[depth:]))
    return mistake


def _key(key: Key, place: InDegrees) -> Key:
    """The key in the file for one in metres."""
    depth, keys = len(place.table), place.keys
    name, rest = key[depth], key[depth + 1 :]
    if keys.form == "position":
        return (*place.table, _height_key(place) if rest == (_HEIGHT,) else "position_deg")
    rest = rest if keys.form != "box" else ()
    return (*place.table, list(keys.degrees)[keys.metres.index(str(name))], *rest)


def _value(place: InDegrees, path: Key) -> Any:
    value: Any = place.values
    for part in path:
        value = value[part]
    return value if path[0] in (place.keys.heights or ()) else as_shown(value)


def _height_key(place: InDegrees) -> str:
    return next(name for name in place.keys.heights or () if name in place.values)


def _text(text: str, place: InDegrees, key: Key) -> str:
    """A text that names keys in metres: with those of the file."""
    for metres, other in zip(place.keys.metres, place.keys.degrees, strict=True):
        if place.keys.form == "box":
            text = text.replace(f"limits.{metres},", f"limits.{other}, {metres[:-2]}")
        elif key[: len(place.table)] == place.table:
            text = re.sub(rf"(?<![\w.]){metres}\b", other, text)
    return text


def _step(step: str, place: InDegrees) -> str:
    """A next step that sets keys in metres: with those of the file."""
    table, form = re.escape(dotted(place.table)), place.keys.form
    if form == "position":
        step = re.sub(rf"{table}\.position_m\[([012])\] to {_NUMBER}", lambda found: _moved(found, place), step)
    elif form == "box":
        step = re.sub(
            rf"{table}\.(north_m|east_m) to \[{_NUMBER}, {_NUMBER}\]", lambda found: _wider(found, place), step
        )
    return step


def _moved(found: re.Match[str], place: InDegrees) -> str:
    """The position with another coordinate, in degrees or as a height."""
    position, axis = np.array(place.metres["position_m"]), int(found[1])
    before, position[axis] = position[axis], float(found[2])
    if axis != _HEIGHT:
        position[axis] += np.sign(position[axis] - before) * _ROUNDING_M
    lat_deg, lon_deg, alt_amsl_m = map(float, ned_to_geodetic(position * [1.0, 1.0, -1.0], place.origin))
    table = dotted(place.table)
    if axis != _HEIGHT:
        return f"{table}.position_deg to {shown((lat_deg, lon_deg))}"
    height = _height_key(place)
    return f"{table}.{height} to {found[2] if height == 'height_m' else plain(alt_amsl_m)}"


def _wider(found: re.Match[str], place: InDegrees) -> str:
    """A range of the box in degrees that holds one in metres."""
    low, high = float(found[2]), float(found[3])
    # Parallels are curved and meridians meet, so that the box between them is narrower than at the origin.
    reach_m = max(abs(edge) for edge in (low, high, *place.metres["north_m"], *place.metres["east_m"]))
    room_m = _WIDER_M + reach_m**2 * abs(np.tan(np.radians(place.origin.lat_deg))) / _EARTH_M
    axis = place.keys.metres.index(found[1])
    ends = np.zeros((2, 3))
    ends[:, axis] = low - room_m, high + room_m
    range_deg = ned_to_geodetic(ends, place.origin)[axis]
    name = list(place.keys.degrees)[axis]
    return f"{dotted(place.table)}.{name} to [{degrees(float(range_deg[0]))}, {degrees(float(range_deg[1]))}]"
