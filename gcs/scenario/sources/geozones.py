"""Geozones of authorities, as files of ED-269 and ED-318 (JSON) have them: areas, heights, times and restrictions.

Nothing is decided here: what a file leaves out is None. A file that cannot be read to its end is refused, because a
zone that is not understood may be the one that is entered.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from gcs.errors import FileFormatError
from gcs.util.bounded_file import GEOZONE_FILE, as_utf8, read_file, read_json

_NAME_MAX = 60
_UNSEEN = re.compile(r"[^ -~\u00a1-\u024f\u0370-\u05ff]+")
_MARK = b"\xef\xbb\xbf"
_DEPTH_MAX = 8  # of collections in collections
_RING_LEAST = 3
_FEET = ("FT", "FEET", "FOOT")
_METRES = ("M", "METRE", "METER", "METRES", "METERS")
FT_M = 0.3048

Corner = tuple[float, float]  # latitude, longitude, degrees


@dataclass(frozen=True)
class ZoneLimit:
    """The lower or upper limit of a volume, in the unit of the volume; without a reference where none is known."""

    value: float
    reference: str  # AMSL, AGL, WGS84; else what the file has


@dataclass(frozen=True)
class ZoneVolume:
    """A polygon, or a disk about its only corner, between two limits."""

    corners: tuple[Corner, ...]
    radius_m: float | None
    lower: ZoneLimit | None
    upper: ZoneLimit | None
    unit_m: float | None  # of the limits; None where the file does not name a known one


@dataclass(frozen=True)
class ZonePeriod:
    """When a zone holds: from and until, UTC, None without an end; `schedule` of hours and days within them."""

    start: datetime | None
    end: datetime | None
    schedule: bool = False


@dataclass(frozen=True)
class Geozone:
    """One zone of a file. Without periods it holds at all times."""

    label: str  # as sentences call it
    identifier: str
    restriction: str
    volumes: tuple[ZoneVolume, ...]
    periods: tuple[ZonePeriod, ...]
    without_area: bool = False  # parts of its geometry are points or lines


def read_geozones(file: Path) -> tuple[Geozone, ...]:
    """The zones of a file of ED-269 or ED-318. Raises `FileFormatError`, which names the zone."""
    data = read_file(file, GEOZONE_FILE, hint="name a file of geozones; a path is relative to the scenario's folder")
    try:
        document = read_json(as_utf8(data).removeprefix(_MARK))
        if not isinstance(document, dict) or not isinstance(document.get("features"), list):
            raise ValueError('has no list "features", which ED-269 and ED-318 have')
        read = _ed318 if document.get("type") == "FeatureCollection" else _ed269
        return tuple(_named(number, one, read) for number, one in enumerate(document["features"], start=1))
    except (ValueError, RecursionError) as error:
        text = f"{file.name}: {str(error)[:300]}."
        raise FileFormatError(text, hint="correct it there, or get the file again", reason=text) from error


_Reader = Callable[[str, str, dict[str, object]], Geozone]  # of a feature, with its label and identifier


def _named(number: int, feature: object, read: _Reader) -> Geozone:
    label = f"zone {number}"
    if not isinstance(feature, dict):
        raise ValueError(f"{label} is no object")
    about = feature.get("properties") if read is _ed318 else feature
    if not isinstance(about, dict):
        raise ValueError(f'{label} has no "properties"')
    identifier = about.get("identifier")
    shown = _tidy(identifier) if isinstance(identifier, str) else ""
    label += f" ({shown})" * bool(shown)
    try:
        return read(label, shown, feature)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{label}: {error}") from error


def _ed269(label: str, identifier: str, feature: dict[str, object]) -> Geozone:
    volumes = []
    for volume in _list(feature, "geometry"):
        if not isinstance(volume, dict) or not isinstance(place := volume.get("horizontalProjection"), dict):
            raise ValueError('a volume has no "horizontalProjection"')
        rows = ("lowerLimit", "lowerVerticalReference"), ("upperLimit", "upperVerticalReference")
        lower, upper = (_limit(volume, *names) for names in rows)
        unit_m = _unit_m(volume.get("uomDimensions"))
        if place.get("type") == "Circle":
            centre, radius_m = _corner(place.get("center")), _radius_m(place.get("radius"))
            volumes.append(ZoneVolume((centre,), radius_m, lower, upper, unit_m))
        elif place.get("type") == "Polygon":
            volumes.append(ZoneVolume(_ring(_list(place, "coordinates")), None, lower, upper, unit_m))
        else:
            raise ValueError(f"'{_tidy(place.get('type'))}' is neither Circle nor Polygon")
    if not volumes:
        raise ValueError("has no volume")
    periods = tuple(_period(one) for one in _optional_list(feature, "applicability"))
    return Geozone(label, identifier, _tidy(feature.get("restriction")), tuple(volumes), periods)


def _ed318(label: str, identifier: str, feature: dict[str, object]) -> Geozone:
    about = feature["properties"]
    assert isinstance(about, dict)  # `_named` has looked
    parts = [*_parts(feature.get("geometry"))]
    volumes = tuple(part for part in parts if part is not None)
    periods = tuple(_period(one) for one in _optional_list(about, "limitedApplicability"))
    return Geozone(label, identifier, _tidy(about.get("type")), volumes, periods, len(volumes) < len(parts))


def _parts(geometry: object, layer: object = None, depth: int = 0) -> Iterator[ZoneVolume | None]:
    """The volumes of a geometry of GeoJSON, None for each part without an area."""
    if not isinstance(geometry, dict):
        raise ValueError("has no geometry")
    layer = geometry.get("layer", layer)
    kind = geometry.get("type")
    if kind == "GeometryCollection":
        if depth == _DEPTH_MAX:
            raise ValueError("collections are nested too deeply")
        for one in _list(geometry, "geometries"):
            yield from _parts(one, layer, depth + 1)
        return
    if layer is not None and not isinstance(layer, dict):
        raise ValueError('"layer" is no object')
    layer = layer or {}
    heights = (
        _limit(layer, "lower", "lowerReference"),
        _limit(layer, "upper", "upperReference"),
        _unit_m(layer.get("uom")),
    )
    coordinates = _list(geometry, "coordinates")
    if kind == "Polygon":
        yield ZoneVolume(_ring(coordinates), None, *heights)
    elif kind == "MultiPolygon":
        for rings in coordinates:
            yield ZoneVolume(_ring(rings), None, *heights)
    elif kind == "Point" and isinstance(extent := geometry.get("extent"), dict):
        yield ZoneVolume((_corner(coordinates),), _radius_m(extent.get("radius")), *heights)
    elif kind in ("Point", "MultiPoint", "LineString", "MultiLineString"):
        yield None
    else:
        raise ValueError(f"geometry of the unknown type '{_tidy(kind)}'")


def _limit(volume: dict[str, object], key: str, reference: str) -> ZoneLimit | None:
    value = volume.get(key)
    if value is None:
        return None
    return ZoneLimit(_number(value, key), _tidy(volume.get(reference)).upper())


def _unit_m(name: object) -> float | None:
    text = str(name).upper()
    return 1.0 if text in _METRES else FT_M if text in _FEET else None


def _period(period: object) -> ZonePeriod:
    if not isinstance(period, dict):
        raise ValueError("a period of its applicability is no object")
    if str(period.get("permanent")).upper() == "YES":
        return ZonePeriod(None, None)
    start, end = (_instant(period.get(key), key) for key in ("startDateTime", "endDateTime"))
    return ZonePeriod(start, end, bool(period.get("schedule")))


def _instant(text: object, key: str) -> datetime | None:
    if text is None:
        return None
    try:
        return utc_of(text)
    except ValueError as error:
        raise ValueError(f"{key} '{_tidy(text)}' {error}") from error


def utc_of(text: object) -> datetime:
    """The instant that a text of ISO 8601 names. Raises ValueError, also for one without its time zone."""
    try:
        found = datetime.fromisoformat(text if isinstance(text, str) else "")
    except ValueError:
        raise ValueError("is no time as 2026-11-28T10:00:00Z is one") from None
    if found.tzinfo is None:
        raise ValueError("has no time zone; end it with Z for UTC")
    return found.astimezone(UTC)


def _ring(rings: object) -> tuple[Corner, ...]:
    """The outer ring of a polygon: a hole in a zone stays closed, as a zone of a scenario has none."""
    if not isinstance(rings, list) or not rings or not isinstance(rings[0], list):
        raise ValueError("a polygon is no list of rings")
    corners = [_corner(one) for one in rings[0]]
    if corners[0:1] == corners[-1:]:
        corners = corners[:-1]
    if len(set(corners)) < _RING_LEAST:
        raise ValueError(f"a polygon has {len(set(corners))} corners; it needs {_RING_LEAST}")
    return tuple(corners)


def _corner(position: object) -> Corner:
    if not isinstance(position, list) or len(position) < 2:
        raise ValueError("a place is not [longitude, latitude]")
    lon_deg, lat_deg = (_number(value, "a coordinate") for value in position[:2])
    if abs(lat_deg) > 90.0 or abs(lon_deg) > 360.0:
        swapped = "; longitude comes first" if abs(lon_deg) <= 90.0 else ""
        raise ValueError(f"longitude {lon_deg:g}, latitude {lat_deg:g} is no place on Earth{swapped}")
    return lat_deg, lon_deg


def _radius_m(value: object) -> float:
    radius_m = _number(value, "the radius of a circle")
    if radius_m <= 0.0:
        raise ValueError(f"the radius of a circle is {radius_m:g}")
    return radius_m


def _number(value: object, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{what} is no number: '{_tidy(value)}'")
    return float(value)


def _list(table: dict[str, object], key: str) -> list[object]:
    found = table.get(key)
    if not isinstance(found, list):
        raise ValueError(f'has no list "{key}"')
    return found


def _optional_list(table: dict[str, object], key: str) -> list[object]:
    return [] if table.get(key) is None else _list(table, key)


def _tidy(text: object) -> str:
    return _UNSEEN.sub(" ", str("" if text is None else text)[: 4 * _NAME_MAX]).strip()[:_NAME_MAX]
