"""Operational intents of ASTM F3548-21: the details with their volumes in space and time, as JSON."""

import json
from datetime import UTC, datetime

from implicitdict import ImplicitDict, StringBasedDateTime
from uas_standards.astm.f3548.v21.api import (
    Altitude,
    LatLngPoint,
    OperationalIntentDetails,
    Polygon,
    Time,
    Volume3D,
    Volume4D,
)

from gcs.errors import FileFormatError
from gcs.mission.formats.flight_volume import FlightVolume, OperationalIntent
from gcs.util.bounded_file import read_json


def write_operational_intent(intent: OperationalIntent) -> str:
    """The text of a file: `OperationalIntentDetails`, which a service supplier takes, without a priority."""
    volumes = [
        Volume4D(
            volume=Volume3D(
                outline_polygon=Polygon(vertices=[LatLngPoint(lat=lat, lng=lng) for lat, lng in one.corners_deg]),
                altitude_lower=Altitude(value=one.lower_w84_m),
                altitude_upper=Altitude(value=one.upper_w84_m),
            ),
            time_start=Time(value=StringBasedDateTime(_text(one.start))),
            time_end=Time(value=StringBasedDateTime(_text(one.end))),
        )
        for one in intent.volumes
    ]
    return json.dumps(OperationalIntentDetails(volumes=volumes, off_nominal_volumes=[]), indent=1) + "\n"


def read_operational_intent(data: bytes, source: str) -> OperationalIntent:
    """The volumes of a file, polygons only. Raises `FileFormatError`."""
    try:
        details = ImplicitDict.parse(read_json(data), OperationalIntentDetails)
        return OperationalIntent(tuple(_read(volume) for volume in details.volumes or ()))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        text = f"{source}: is no operational intent of polygons: {str(error)[:200]}."
        raise FileFormatError(text, hint="export it again") from error


def _read(given: Volume4D) -> FlightVolume:
    corners = tuple((float(one.lat), float(one.lng)) for one in given.volume.outline_polygon.vertices)
    low, high = (float(one.value) for one in (given.volume.altitude_lower, given.volume.altitude_upper))
    start, end = (one.value.datetime.astimezone(UTC) for one in (given.time_start, given.time_end))
    return FlightVolume(corners, low, high, start, end)


def _text(instant: datetime) -> str:
    whole = instant.astimezone(UTC)
    return f"{whole:%Y-%m-%dT%H:%M:%S}.{whole.microsecond // 1000:03d}Z"
