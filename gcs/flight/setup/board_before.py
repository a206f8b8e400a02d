"""What the vehicles of a flight had on board before it: shown, kept in the flight's folder, and given back after it."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

from gcs.link.session.load_before import LoadBefore, before_words, give_back, given_words, read_before, record_before
from gcs.link.session.upload_fleet import Holdings
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.link.session.vehicle_session import VehicleSession


class BoardBefore:
    """The loads before one flight; nothing until they are read."""

    def __init__(
        self,
        path: Path,
        plan_hash: str,
        kept: Callable[[str], AbstractContextManager[None]],
        say: Callable[[str], None],
    ) -> None:
        """`kept` makes a file that cannot be written a gap of the flight's record."""
        self._path, self._plan_hash, self._kept, self._say = path, plan_hash, kept, say
        self._before: tuple[LoadBefore, ...] = ()

    async def read(self, sessions: Mapping[int, VehicleSession], loads: Sequence[VehicleLoad]) -> None:
        """Read what the loads will replace, show and record it. Raises `PeerError`."""
        self._before = await read_before(sessions, loads, self._say)
        for line in before_words(self._before):
            self._say(f"on board now, given back after the flight: {line}")
        self._record({})

    def uploaded(self, held: Holdings) -> None:
        """Record what the upload has changed."""
        changes = {sysid: tuple(c for c in held.changes if c.sysid == sysid) for sysid in held.digests}
        self._before = tuple(replace(one, changes=changes[one.sysid]) for one in self._before)
        self._record(held.digests)

    async def give_back(self, sessions: Mapping[int, VehicleSession]) -> None:
        """Give it back. A failure is said, not raised: the flight is over."""
        missing = await give_back(sessions, self._before)
        for sentence in missing:
            self._say(f"WARNING: not everything was restored: {sentence}")
        if missing:
            self.say_how_to_restore()
        elif self._before:
            self._say(given_words(self._before))

    def say_how_to_restore(self) -> None:
        """Say how to give it back later."""
        if self._before:
            self._say(f"to give back what was on board before: gcs restore {self._path.parent}")

    def _record(self, digests: Mapping[int, str]) -> None:
        if self._before:
            with self._kept(self._path.name):
                record_before(self._path, self._plan_hash, digests, self._before)
