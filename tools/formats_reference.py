"""Every export format as a page, docs/formats.md; `tools/reference.py` writes it."""

from __future__ import annotations

from gcs.flight.recording.tlog import FRAMES_MAX
from gcs.mission.drawings import kml_drawing
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
from tools.markdown import rows, table

FOREIGN = """
## Files of other programs

`gcs check` finds the format from the first line that counts, whatever the suffix. It reads, besides the formats above:

- tables of version 100 and 120 (`QGC WPL`),
- MAVProxy's list of fence points: lines of latitude and longitude; the return point, the vertices, the first again,
- MAVProxy's list of rally points: `RALLY` lines with latitude, longitude and altitude above home,
- QGroundControl's `.mission` of version 1.0 and 2.

Files are read as generously as MAVProxy and QGroundControl read them. Each oddity is a warning (`format`) with its file
and line. Equal ones in a file are one warning with the first line and their number.

"""
REFUSED = """
What could fly otherwise than it is written is refused with its line: a position that is missing or not on Earth, text
where a number must be, a jump to a number that is not exactly one item, a fence whose last point does not repeat the
first vertex, a rally altitude that is not above home, complex items.
"""
LIMITS = """
## Limits of files that are read

Files of others are checked before they are read: the exit code is 6, of a scenario 3, of a key or a fault file 2. The
error states the value and the limit. Only regular files are read, no pipes and no devices; a signing key may come from
a pipe. Numbers must be finite.

| file | largest size |
| --- | --- |
"""
FURTHER = f"""
- JSON has at most {JSON_VALUES_MAX:,} values, GeoJSON {geojson.VALUES_MAX:,}.
- A mission has at most {ITEMS_MAX:,} items.
- A KMZ unpacks to at most {in_mib(kml.LARGEST_BYTES)}. KML with entities is refused.
- A drawn KMZ unpacks to at most {in_mib(kml_drawing.UNPACKED_MAX_BYTES)}. Drawn XML has at most {XML_ELEMENTS_MAX:,}
  elements, and no document type.
- Parquet has at most {ROWS_MAX:,} rows.
- An elevation model has at most {PIXELS_MAX:,} pixels where the scenario is, and blocks of at most 256 MiB.
- `gcs replay` takes at most {FRAMES_MAX:,} frames; `gcs report` takes any number.

A plan file (`.skein`) is an archive with these arrays and no other member. Its checksum shows damage. It proves nothing
about the writer, so every command that leads to vehicles or files verifies the plan again.

| array | type | dimensions | largest size |
| --- | --- | --- | --- |
"""
CONTENTS = """
## Contents

The content of a format is what its writer is given and its reader returns. `RALLY` is a list of rally points.

| content | one file for | type |
| --- | --- | --- |
"""


def formats_reference() -> str:
    """Formats, what is read although other programs write it otherwise, limits, contents."""
    sizes = ((kind.name, in_mib(kind.largest_bytes)) for kind in FILE_KINDS)
    arrays = (
        (f"`{name}`", f"`{kind.dtype}`", str(kind.dimensions), in_mib(kind.largest_bytes))
        for name, kind in ARRAYS.items()
    )
    contents = (
        (f"`{content.name}`", "each vehicle" if content.per_vehicle else "the formation", f"`{content}`")
        for content in Content
    )
    foreign = FOREIGN + "".join(f"- {odd}\n" for odd in Odd) + REFUSED
    limits = LIMITS + rows(sizes) + FURTHER + rows(arrays)
    formats = table(("name", "files", "what it is for", "content"), map(_cells, FORMATS))
    return formats + foreign + limits + CONTENTS + rows(contents)


def _cells(row: Format) -> tuple[str, ...]:
    name = f"**`{row.name}`**" if row.default else f"`{row.name}`"
    stem = "uavN" if row.content.per_vehicle else FLEET
    files = " or ".join(f"`{stem}{suffix}`" for suffix in row.suffixes)
    return name, files, row.purpose, f"`{row.content.name}`"
