"""Scenes and pictures as JSON: arrays are base64 of little-endian numbers, so that a browser reads them at once."""

import base64
import dataclasses
import json
import math

import numpy as np
from numpy.typing import NDArray

from gcs.flight.scene.scene_model import FlightPicture, Happening, PlannedBand, Scene
from gcs.types import Array


def scene_json(scene: Scene) -> bytes:
    """Return the scene as one JSON object; the keys are the names of its fields, NaN is null."""
    return to_bytes(_plain(scene))


def picture_json(picture: FlightPicture) -> bytes:
    """Return the picture as one JSON object, likewise."""
    return to_bytes(_plain(picture))


def band_json(band: PlannedBand) -> object:
    """Return the band as plain values, likewise."""
    return _plain(band)


def way_json(places_ned_m: Array) -> object:
    """Return tracks (V, N, 3) as plain values, likewise."""
    return _plain(places_ned_m)


def event_json(event: Happening) -> bytes:
    """Return the event as one JSON object, likewise."""
    return to_bytes(_plain(event))


def to_bytes(data: object) -> bytes:
    """Return plain values as compact JSON. Raises ValueError on NaN and infinity."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).encode()


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        return _array(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {each.name: _plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, tuple | list):
        return [_plain(one) for one in value]
    if isinstance(value, dict):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _array(values: NDArray[np.generic]) -> dict[str, object]:
    form = "f4" if values.dtype.kind == "f" else "i2" if np.abs(values).max(initial=0) < 2**15 else "i4"
    data = np.ascontiguousarray(values, dtype=f"<{form}").tobytes()
    return {form: base64.b64encode(data).decode(), "shape": list(values.shape)}
