"""The upload to all vehicles at once: all of them, or none.

First every vehicle reports the parameters that will change. Then all receive their missions, fences and rally points at
once, which are read back and compared; then the parameters are set. If one vehicle fails, the upload ends for all: sent
items are cleared, parameters get their old values, and the error gives the state of each vehicle. Only `Holdings`
allows a flight to start.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, TypeVar

from gcs.errors import FlightError, GcsError, PeerError, counted
from gcs.link.protocols.mission.strategy import SentAs
from gcs.link.session.load_before import SILENT_S, ParameterChange, parameter_changes
from gcs.link.session.vehicle_api import Loadable
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.mavlink import MissionType
from gcs.mission.model import MissionItem
from gcs.util.aio import each

T = TypeVar("T")


@dataclass(frozen=True)
class Holdings:
    """Proof that the load of one plan was read back from every vehicle. `digests` are by vehicle."""

    plan_hash: str
    digests: Mapping[int, str]
    changes: tuple[ParameterChange, ...] = ()
    sent_as: Mapping[int, SentAs] = field(default_factory=dict)  # how each mission went, by vehicle

    def require(self, plan_hash: str, sysids: Sequence[int]) -> None:
        """Raise `FlightError` unless all these vehicles have their load of this plan on board."""
        missing = [sysid for sysid in sysids if sysid not in self.digests]
        if plan_hash != self.plan_hash or missing:
            named = ", ".join(map(str, missing)) if missing else "all"
            raise FlightError(
                f"no vehicle may start. Vehicles without a verified mission of this plan: {named}.", hint="upload again"
            )


class UploadFailed(PeerError):
    """The upload failed, and no vehicle may start. `cause` is the first failure, `states` what is on board now."""

    def __init__(self, sysid: int, cause: GcsError, states: Mapping[int, str]) -> None:
        on_board = "; ".join(f"vehicle {s}: {state}" for s, state in sorted(states.items()))
        super().__init__(
            f"no vehicle may start, because of vehicle {sysid}: {cause.message} On board now: {on_board}.",
            hint=cause.hint,
        )
        self.sysid = sysid
        self.cause = cause
        self.states = dict(states)


@dataclass
class _Loading:
    session: Loadable
    load: VehicleLoad
    changes: list[ParameterChange] = field(default_factory=list)
    touched: set[MissionType] = field(default_factory=set)
    wrote: bool = False


async def preview(sessions: Mapping[int, Loadable], loads: Sequence[VehicleLoad]) -> tuple[ParameterChange, ...]:
    """Return the parameters that an upload would change; change nothing. Raises `PeerError`."""
    found = await asyncio.gather(*(parameter_changes(sessions[load.sysid], load) for load in loads))
    return tuple(change for changes, _ in found for change in changes)


async def upload_fleet(
    sessions: Mapping[int, Loadable],
    loads: Sequence[VehicleLoad],
    plan_hash: str,
    on_step: Callable[[int, str], None] = lambda sysid, what: None,
) -> Holdings:
    """Upload to all vehicles at once; return the proof of what is on board.

    `on_step(vehicle, what)` reports progress. Raises `PeerError` before the first upload if a vehicle is armed, does
    not know a parameter or cannot hold its value. Raises `UploadFailed` after the upload was rolled back. A cancelled
    upload is rolled back too.
    """
    every = [_Loading(sessions[load.sysid], load) for load in loads]
    for one in every:
        if one.session.armed:
            raise PeerError(
                f"vehicle {one.session.sysid} is armed, and may be in flight: no upload.",
                hint="land and disarm it, then upload again",
            )
    try:
        before = await _all_or_first([parameter_changes(one.session, one.load) for one in every], every)
    except _Failed as failed:
        raise failed.cause from None
    for one, (changes, _) in zip(every, before, strict=True):
        one.changes = changes
    try:
        await _all_or_first([_upload(one, on_step) for one in every], every)
        await _all_or_first([_set(one, on_step) for one in every], every)
    except _Failed as failed:
        states = await _roll_back(every)
        raise UploadFailed(failed.sysid, failed.cause, states) from failed.cause
    except asyncio.CancelledError:
        await _roll_back(every)
        raise
    digests = {one.load.sysid: one.load.digest(plan_hash) for one in every}
    sent_as = {one.load.sysid: one.session.sent_as for one in every if one.session.sent_as is not None}
    return Holdings(plan_hash, digests, tuple(change for one in every for change in one.changes), sent_as)


class _Failed(Exception):
    def __init__(self, sysid: int, cause: GcsError) -> None:
        super().__init__(sysid)
        self.sysid = sysid
        self.cause = cause


async def _all_or_first(actions: Sequence[Awaitable[T]], every: Sequence[_Loading]) -> list[T]:
    """Return all results. Raises the first failure after the other actions have stopped."""
    tasks = [asyncio.ensure_future(action) for action in actions]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    for one, task in zip(every, tasks, strict=True):
        if task in done and not task.cancelled():
            error = task.exception()
            if isinstance(error, GcsError):
                raise _Failed(one.session.sysid, error)
            if error is not None:
                raise error
    return [task.result() for task in tasks]


async def _upload(one: _Loading, on_step: Callable[[int, str], None]) -> None:
    session, mission = one.session, one.load.mission
    one.touched.add(MissionType.MISSION)
    await session.upload_mission(mission)
    on_step(
        session.sysid,
        f"mission of {counted(len(mission.items), 'item')}" + (f", {way}" if (way := session.sent_as) else ""),
    )
    for kind, items in one.load.extras:
        one.touched.add(kind)
        await session.upload_items(items, kind)
        on_step(session.sysid, f"{kind.name.lower()} of {counted(len(items), 'item')}")


async def _set(one: _Loading, on_step: Callable[[int, str], None]) -> None:
    if one.changes:
        one.wrote = True
        await one.session.write_parameters([change.after for change in one.changes])
        on_step(one.session.sysid, counted(len(one.changes), "parameter"))


async def _roll_back(every: Sequence[_Loading]) -> dict[int, str]:
    states = await asyncio.gather(*(asyncio.shield(_roll_back_one(one)) for one in every))
    return {one.session.sysid: state for one, state in zip(every, states, strict=True)}


async def _roll_back_one(one: _Loading) -> str:
    if not one.touched:
        return "unchanged"
    if one.session.heartbeat_age_s() > SILENT_S:
        return "no heartbeat, its items may be a mix of old and new: do not fly it"
    problems = []
    for kind in sorted(one.touched):
        try:
            await one.session.upload_items((), kind)
        except GcsError:
            problems.append(f"its {kind.name.lower()} may be a mix of old and new: do not fly it")
    if one.wrote:
        try:
            await one.session.write_parameters([change.before for change in one.changes])
        except GcsError:
            problems.append("its parameters may be changed")
    if problems:
        return ", ".join(problems)
    names = " and ".join(kind.name.lower() for kind in sorted(one.touched))
    return f"{names} cleared" + (", parameters restored" if one.wrote else "")


class ItemChanger(Protocol):
    """One vehicle on a link that replaces items of its mission."""

    async def replace_items(self, items: Mapping[int, MissionItem], *, look_first: bool = False) -> None:
        """Replace items of the mission on board, by their index without home; read them back and compare."""


async def change_items(
    sessions: Mapping[int, ItemChanger],
    held: Holdings,
    loads: Sequence[VehicleLoad],
    indices: Mapping[int, Sequence[int]],
    *,
    look_first: bool = False,
) -> Holdings:
    """Replace the items with these indices, by vehicle; return the new proof of what is on board.

    `loads` are the loads to have, which differ from those of `held` in these items only. With `look_first` items that
    are on board already are not sent. Raises the first `PeerError` after the other vehicles have stopped: each of these
    items is then the old one or the new one.
    """

    async def change(load: VehicleLoad) -> None:
        items = {index: load.mission.items[index] for index in indices[load.sysid]}
        await sessions[load.sysid].replace_items(items, look_first=look_first)

    await each(loads, change)
    return replace(held, digests={load.sysid: load.digest(held.plan_hash) for load in loads})
