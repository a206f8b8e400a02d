"""Atomic folder replacement: the new folder is filled beside the old one and swapped in when complete.

A folder that holds any file which no export wrote is not replaced.
"""

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from gcs.errors import FileFormatError, UsageError
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.formats.mission_file import MissionFile
from gcs.util.bounded_file import EXPORT_INDEX, MISSION_FILE, read_file, read_json

INDEX = "index.json"
FORMAT = "skein-export"


class Folder:
    """A folder while it is filled; `sha256` lists the hash of each file by name."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.sha256: dict[str, str] = {}

    def write(self, name: str, data: str | bytes) -> None:
        """Add a file (text as UTF-8) and list it."""
        data = data.encode() if isinstance(data, str) else data
        self.sha256[name] = hashlib.sha256(data).hexdigest()
        self._write(name, data)

    def write_index(self, document: dict[str, object]) -> None:
        """Add the index, which does not list itself."""
        self._write(INDEX, (json.dumps({"format": FORMAT, **document}, indent=2) + "\n").encode())

    def _write(self, name: str, data: bytes) -> None:
        with (self.path / name).open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())


@contextmanager
def replaced(folder: Path) -> Iterator[Folder]:
    """Yield a folder to fill. It replaces `folder` when the block ends without an error; else the old one stays.

    Raises `UsageError` before it writes, if the folder holds a file that no export wrote. Raises OSError as the file
    system does.
    """
    folder = folder.resolve()
    refuse_foreign(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
    try:
        new, old = beside / "new", beside / "old"
        new.mkdir()
        yield Folder(new)
        if folder.exists():
            folder.rename(old)
        try:
            new.rename(folder)
        except OSError:
            if old.exists():
                old.rename(folder)
            raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def listed(index: Path) -> dict[str, str]:
    """The files and hashes in an index. Raises `FileFormatError` if the file is not an index."""
    try:
        document = read_json(read_file(index, EXPORT_INDEX))
        if document["format"] != FORMAT:
            raise ValueError(f"format is {document['format']!r}")
        return {str(name): str(digest) for name, digest in document["sha256"].items()}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileFormatError(f"{index}: not the index of an export.", hint="choose another folder") from error


def refuse_foreign(folder: Path) -> None:
    """Raise `UsageError` if the folder holds a file that no export wrote."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise UsageError(f"{folder} is a file; an export needs a folder.", hint="choose another folder")
    names = {p.name for p in folder.iterdir()}
    if not names:
        return
    known: set[str] = set()
    if INDEX in names:
        known = {INDEX, *listed(folder / INDEX)}
    if foreign := sorted(names - known):
        text = f"{folder} holds files that no export wrote: {', '.join(foreign[:5])}."
        raise UsageError(text, hint="choose another folder, or move these files out of it")


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
