"""Find the export that a mission file came from, by the index beside it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from gcs.errors import FileFormatError
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.export.atomic_folder import INDEX, listed
from gcs.mission.formats.mission_file import MissionFile
from gcs.reading.bounded_file import EXPORT_INDEX, MISSION_FILE, read_file
from gcs.reading.bounded_json import read_json


def exported_from(missions: Sequence[MissionFile]) -> tuple[float | None, list[Finding]]:
    """The largest separation these files were exported for, and a warning for every file changed since.

    The separation is None for files that no export wrote.
    """
    required: list[float] = []
    changed: list[Finding] = []
    for folder in sorted({Path(m.source).parent for m in missions}):
        try:
            names = listed(folder / INDEX)
            separation = read_json(read_file(folder / INDEX, EXPORT_INDEX)).get("separation_min_m")
        except (OSError, ValueError, FileFormatError):
            continue  # not an export
        if isinstance(separation, float):
            required.append(separation)
        for mission in missions:
            path = Path(mission.source)
            if path.parent != folder or path.name not in names:
                continue
            if hashlib.sha256(read_file(path, MISSION_FILE)).hexdigest() != names[path.name]:
                message = "the file was changed after its export"
                changed.append(Finding(Rule.CHANGED, Level.WARNING, message, mission.source))
    return max(required, default=None), changed
