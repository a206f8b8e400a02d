"""The folders of the flights that a campaign keeps whole: all that did not hold, and the worst of every criterion."""

from __future__ import annotations

import io
import shutil
import zipfile
from collections.abc import Iterable
from pathlib import Path

from gcs.campaign.campaign_flight import HELD, KeepRule
from gcs.campaign.records import INDEX, INFRASTRUCTURE, OUTCOME, Row, margins

FLIGHTS = "flights"
_UNDER_WAY = ".part"


class KeptFlights:
    """The folder `flights` of a campaign. `worst` flights are kept per criterion."""

    def __init__(self, campaign: Path, rows: Iterable[Row], worst: int) -> None:
        """`rows` are the results known so far."""
        self._folder, self._worst = campaign / FLIGHTS, worst
        self._least: dict[str, list[tuple[float, int]]] = {}  # the worst margins of each criterion, the least first
        self._not_held: set[int] = set()
        for row in rows:
            self._note(row)

    @property
    def rule(self) -> KeepRule:
        """What a flight that now begins must be kept for. Later ones are stricter: no flight is left out wrongly."""
        full = {name: least[-1][0] for name, least in self._least.items() if len(least) == self._worst}
        return KeepRule(full)

    def path(self, index: int) -> Path:
        """The folder of a flight."""
        return self._folder / f"{index:06d}"

    def add(self, row: Row, folder_zip: bytes | None) -> None:
        """Count a result, and keep its folder if it is among the worst now."""
        self._note(row)
        if folder_zip is not None and row[INDEX] in self._wanted():
            self._unpack(row[INDEX], folder_zip)

    def tidy(self) -> None:
        """Remove folders that are no longer wanted, and those not written whole.

        Only when all rows are on disk: after a crash, the rows that are there must find their folders.
        """
        wanted = {self.path(index).name for index in self._wanted()}
        for one in self._folder.iterdir() if self._folder.is_dir() else ():
            if one.name not in wanted:
                shutil.rmtree(one, ignore_errors=True)

    def _note(self, row: Row) -> None:
        if row[OUTCOME] == INFRASTRUCTURE:
            return
        if row[OUTCOME] != HELD:
            self._not_held.add(row[INDEX])
        for name, value in margins(row).items():
            if value is not None:
                # The index decides between equals, so that the order of the results does not.
                least = sorted({*self._least.get(name, []), (value, row[INDEX])})
                self._least[name] = least[: self._worst]

    def _wanted(self) -> set[int]:
        return self._not_held | {index for least in self._least.values() for _, index in least}

    def _unpack(self, index: int, folder_zip: bytes) -> None:
        part, whole = self._folder / f"{index:06d}{_UNDER_WAY}", self.path(index)
        for old in (part, whole):
            shutil.rmtree(old, ignore_errors=True)
        part.mkdir(parents=True)
        with zipfile.ZipFile(io.BytesIO(folder_zip)) as archive:
            archive.extractall(part)
        part.replace(whole)
