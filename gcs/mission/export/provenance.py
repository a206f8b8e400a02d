"""Where mission files come from: the index beside them, if an export wrote them.

Knows: the index, hashes. Does not know: missions' contents.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from gcs.errors import FileFormatError
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.export.atomic_folder import INDEX, listed
from gcs.mission.formats.mission_file import MissionFile


def exported_from(missions: Sequence[MissionFile]) -> tuple[float | None, list[Finding]]:
    """The separation that the exports of these files were made for, and a finding for every file changed since."""
    asked: list[float] = []
    changed: list[Finding] = []
    for folder in sorted({Path(m.source).parent for m in missions}):
        try:
            names = listed(folder / INDEX)
            separation = json.loads((folder / INDEX).read_bytes()).get("separation_min_m")
        except (OSError, FileFormatError):
            continue  # made by somebody else
        if isinstance(separation, float):
            asked.append(separation)
        for mission in missions:
            path = Path(mission.source)
            if path.parent != folder or path.name not in names:
                continue
            if hashlib.sha256(path.read_bytes()).hexdigest() != names[path.name]:
                message = "the file was changed after it was exported"
                changed.append(Finding(Rule.CHANGED, Level.WARNING, message, mission.source))
    return max(asked, default=None), changed
