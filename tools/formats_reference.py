"""Tables and lists of docs/formats.md, by order; `tools/reference.py` writes them."""

from __future__ import annotations

from gcs.flight.recording.tlog import FRAMES_MAX
from gcs.mission.drawings import xml_drawing
from gcs.mission.formats.foreign.oddities import Odd
from gcs.mission.formats.maps import geojson, kml
from gcs.mission.formats.plan_items import ITEMS_MAX
from gcs.mission.formats.registry import FLEET, FORMATS, Content, Format
from gcs.plan.trajectory.plan_file import ARRAYS
from gcs.reading.bounded_file import FILE_KINDS, in_mib
from gcs.reading.bounded_json import JSON_VALUES_MAX
from gcs.reading.bounded_parquet import ROWS_MAX
from gcs.reading.bounded_xml import XML_ELEMENTS_MAX
from gcs.scenario.environment.heightmap import PIXELS_MAX
from tools.markdown import table

LIMITS = f"""
- JSON has at most {JSON_VALUES_MAX:,} values, GeoJSON {geojson.VALUES_MAX:,}.
- A mission has at most {ITEMS_MAX:,} items.
- A KMZ unpacks to at most {in_mib(kml.LARGEST_BYTES)}. KML with entities is refused.
- A drawn KMZ unpacks to at most {in_mib(xml_drawing.UNPACKED_MAX_BYTES)}. Drawn XML has at most {XML_ELEMENTS_MAX:,}
  elements, and no document type.
- Parquet has at most {ROWS_MAX:,} rows.
- An elevation model has at most {PIXELS_MAX:,} pixels where the scenario is, and blocks of at most 256 MiB.
- `gcs replay` takes at most {FRAMES_MAX:,} frames; `gcs report` takes any number.
"""


def formats_reference() -> tuple[str, ...]:
    """Formats; what is read although other programs write it otherwise; limits; arrays of a plan file; contents."""
    sizes = ((kind.name, in_mib(kind.largest_bytes)) for kind in FILE_KINDS)
    arrays = (
        (f"`{name}`", f"`{kind.dtype}`", str(kind.dimensions), in_mib(kind.largest_bytes))
        for name, kind in ARRAYS.items()
    )
    contents = (
        (f"`{content.name}`", "each vehicle" if content.per_vehicle else "the formation", f"`{content}`")
        for content in Content
    )
    return (
        table(("name", "files", "what it is for", "content"), map(_cells, FORMATS)),
        "".join(f"- {odd}\n" for odd in Odd),
        table(("file", "largest size"), sizes) + LIMITS,
        table(("array", "type", "dimensions", "largest size"), arrays),
        table(("content", "one file for", "type"), contents),
    )


def _cells(row: Format) -> tuple[str, ...]:
    name = f"**`{row.name}`**" if row.default else f"`{row.name}`"
    stem = "uavN" if row.content.per_vehicle else FLEET
    files = " or ".join(f"`{stem}{suffix}`" for suffix in row.suffixes)
    return name, files, row.purpose, f"`{row.content.name}`"
