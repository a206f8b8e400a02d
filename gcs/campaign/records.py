"""The folder of a campaign: what it is, its design, and the results that are known, each file whole or not there.

    campaign.json       what was asked for, the plan's hash and the version of Skein
    design.parquet      one row for each flight
    parts/*.parquet     results, one row for each flight that ended; which flights stand in one part means nothing

What is left to fly is the design less the results. A process that is killed loses at most the rows that it had not
yet written, and these flights are flown again.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from uuid import uuid4

import pyarrow as pa
import pyarrow.parquet as pq

from gcs.errors import FileFormatError, UsageError
from gcs.types import JsonObject
from gcs.util.atomic_write import atomic_write
from gcs.util.bounded_file import RECORD_FILE, UPLOAD_RECORD, read_file, read_json
from gcs.util.bounded_parquet import open_parquet

CAMPAIGN, DESIGN, PARTS = "campaign.json", "design.parquet", "parts"
INDEX, OUTCOME = "index", "outcome"
INFRASTRUCTURE = "infrastructure"  # outcome of a flight that the machine, not the vehicles, ended: it flies again
_NEW_FOLDER = "write the campaign to another folder with --to"

MARGIN, TEXT = "_margin", "_text"  # ends of the columns of a criterion's margin, and of a fault as an option
_OF_FAULT = re.compile(r"(fault\d+)(_\w+)")

Row = dict[str, Any]  # values by column


def margins(row: Row) -> dict[str, float | None]:
    """Return the margin of each criterion; None for a flight that was not judged by it."""
    return {name.removesuffix(MARGIN): value for name, value in row.items() if name.endswith(MARGIN)}


def of_fault(column: str) -> tuple[str, str]:
    """Return the fault that a column describes, and what the column has of it: `fault1`, `_vehicle`; else empty."""
    found = _OF_FAULT.fullmatch(column)
    return (found[1], found[2]) if found else ("", "")


class CampaignFolder:
    """The files of one campaign."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def begin(self, asked: JsonObject, design: Iterable[Row]) -> None:
        """Write what is asked for and the design, or go on with what is there.

        `asked` holds all that decides the results: options, `plan_hash`, `version`. Raises UsageError if the folder
        has a campaign that differs in one of them, and FileFormatError for a folder that is none.
        """
        rows = list(design)
        if (self.path / CAMPAIGN).exists():
            known = self.asked()
            differs = [key for key in {**known, **asked} if known.get(key) != asked.get(key)]
            if differs:
                key = sorted(differs)[0]
                raise UsageError(
                    f"{self.path} has a campaign with another {key}: {known.get(key)}, not {asked.get(key)}",
                    hint=_NEW_FOLDER,
                )
            if self.design() != rows:
                raise UsageError(f"{self.path} has a campaign with another design", hint=_NEW_FOLDER)
            return
        if self.path.exists() and any(self.path.iterdir()):
            raise UsageError(f"{self.path} has other files and no {CAMPAIGN}", hint=_NEW_FOLDER)
        _write(self.path / DESIGN, rows)
        atomic_write(self.path / CAMPAIGN, json.dumps(asked, indent=2) + "\n")  # last: with it the folder is complete

    def asked(self) -> JsonObject:
        """Return what `campaign.json` has. Raises FileFormatError."""
        file = self.path / CAMPAIGN
        data = read_file(file, UPLOAD_RECORD, hint="name the folder of a campaign")
        try:
            found = read_json(data)
            if not isinstance(found, dict):
                raise ValueError("it has no keys")
        except ValueError as problem:
            raise FileFormatError(f"{file} does not describe a campaign: {problem}.") from None
        return found

    def design(self) -> list[Row]:
        """Return the rows of the design, in the order of their index. Raises FileFormatError."""
        rows: list[Row] = _read(self.path / DESIGN).to_pylist()
        return rows

    def add(self, rows: Iterable[Row]) -> None:
        """Write the results of some flights as a part of its own. Raises OSError of the file system."""
        if held := list(rows):
            _write(self.path / PARTS / f"{uuid4().hex}.parquet", held)

    def results(self) -> list[Row]:
        """Return one row for each flight that ended, in the order of the design. Raises FileFormatError.

        A flight that stands in several parts counts once: with its result rather than with a failure of the machine.
        """
        parts = [_read(file) for file in sorted((self.path / PARTS).glob("*.parquet"))]
        if not parts:
            return []
        rows = pa.concat_tables(parts, promote_options="permissive").to_pylist()
        found: dict[int, Row] = {}
        for row in sorted(rows, key=lambda row: bool(row[OUTCOME] == INFRASTRUCTURE)):
            found.setdefault(row[INDEX], row)
        return [found[index] for index in sorted(found)]

    def left(self) -> list[Row]:
        """Return the rows of the design without a result; a failure of the machine is none. Raises FileFormatError."""
        done = {row[INDEX] for row in self.results() if row[OUTCOME] != INFRASTRUCTURE}
        return [row for row in self.design() if row[INDEX] not in done]


def _write(path: Path, rows: list[Row]) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.table({name: pa.array([row.get(name) for row in rows]) for name in names})
    written = io.BytesIO()
    pq.write_table(table, written, compression="zstd", write_page_checksum=True)
    atomic_write(path, written.getvalue())


def _read(path: Path) -> pa.Table:
    try:
        return open_parquet(read_file(path, RECORD_FILE, hint="name the folder of a campaign")).read()
    except (OSError, ValueError, pa.ArrowException) as problem:
        hint = "delete it: its flights are flown again" if path.parent.name == PARTS else _NEW_FOLDER
        raise FileFormatError(f"{path} is not a table of flights: {problem}.", hint=hint) from None
