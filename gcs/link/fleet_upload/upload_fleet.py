"""A fleet is loaded all together, or not at all.

Knows: the order of things, and what a failure leaves behind. Does not know: sockets, plans but for their hash.

First every vehicle is asked for the parameters that are going to change; then all are sent their missions, fences and
rally points at once, read back and compared; then the parameters are set. Whoever fails ends it for all: what was sent
is cleared, parameters get their old values, and each vehicle's state is told. Only `Holdings` lets anybody start.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from gcs.errors import FlightError, GcsError, PeerError
from gcs.link.fleet_upload.vehicle_load import VehicleLoad
from gcs.link.microservices.parameter import Parameter, as_kind
from gcs.link.session.vehicle_api import Loadable
from gcs.mavlink import MissionType

T = TypeVar("T")
_SILENT_S = 4.0


@dataclass(frozen=True)
class ParameterChange:
    """One parameter of one vehicle, before and after."""

    sysid: int
    before: Parameter
    after: Parameter


@dataclass(frozen=True)
class Holdings:
    """Proof that every vehicle held its load of one plan when it was read back; `digests` by vehicle."""

    plan_hash: str
    digests: Mapping[int, str]
    changes: tuple[ParameterChange, ...] = ()

    def require(self, plan_hash: str, sysids: Sequence[int]) -> None:
        """Raises `FlightError` unless all these vehicles hold their load of this very plan."""
        missing = [sysid for sysid in sysids if sysid not in self.digests]
        if plan_hash != self.plan_hash or missing:
            who = ", ".join(map(str, missing)) if missing else "all"
            raise FlightError(
                f"nobody starts: vehicles without a verified mission of this plan: {who}.", hint="upload again"
            )


class UploadFailed(PeerError):
    """Nobody may start. `cause` is the first failure, `states` what each vehicle was left with."""

    def __init__(self, sysid: int, cause: GcsError, states: Mapping[int, str]) -> None:
        told = "; ".join(f"vehicle {s}: {state}" for s, state in sorted(states.items()))
        super().__init__(
            f"nothing may start, because of vehicle {sysid}: {cause.message} Left behind: {told}.", hint=cause.hint
        )
        self.sysid = sysid
        self.cause = cause
        self.states = dict(states)


@dataclass
class _Loading:
    """One vehicle on the way."""

    session: Loadable
    load: VehicleLoad
    changes: list[ParameterChange] = field(default_factory=list)
    touched: set[MissionType] = field(default_factory=set)
    wrote: bool = False


async def preview(sessions: Mapping[int, Loadable], loads: Sequence[VehicleLoad]) -> tuple[ParameterChange, ...]:
    """The parameters that an upload would change. Nothing is changed. Raises `PeerError`, `UsageError`."""
    found = await asyncio.gather(*(_changes(sessions[load.sysid], load) for load in loads))
    return tuple(change for changes in found for change in changes)


async def upload_fleet(
    sessions: Mapping[int, Loadable],
    loads: Sequence[VehicleLoad],
    plan_hash: str,
    on_step: Callable[[int, str], None] = lambda sysid, what: None,
) -> Holdings:
    """Load all vehicles at once; returns what each holds.

    `on_step(vehicle, what)` hears of progress. Raises `PeerError` before anything is sent where a vehicle is armed or
    does not know a parameter, and `UploadFailed` after everything sent was taken back. Cancelled, it takes back too.
    """
    every = [_Loading(sessions[load.sysid], load) for load in loads]
    for one in every:
        if one.session.armed:
            raise PeerError(
                f"vehicle {one.session.sysid} is armed; nothing is uploaded to a vehicle that may be flying.",
                hint="land and disarm it first",
            )
    try:
        before = await _all_or_first([_changes(one.session, one.load) for one in every], every)
    except _Failed as failed:
        raise failed.cause from None
    for one, changes in zip(every, before, strict=True):
        one.changes = changes
    try:
        await _all_or_first([_put(one, on_step) for one in every], every)
        await _all_or_first([_set(one, on_step) for one in every], every)
    except _Failed as failed:
        states = await _take_back(every)
        raise UploadFailed(failed.sysid, failed.cause, states) from failed.cause
    except asyncio.CancelledError:
        await _take_back(every)
        raise
    digests = {one.load.sysid: one.load.digest(plan_hash) for one in every}
    return Holdings(plan_hash, digests, tuple(change for one in every for change in one.changes))


async def restore(sessions: Mapping[int, Loadable], changes: Sequence[ParameterChange]) -> None:
    """Give every changed parameter its old value. Raises `PeerError`; the others are restored all the same."""
    by_vehicle: dict[int, list[Parameter]] = {}
    for change in changes:
        by_vehicle.setdefault(change.sysid, []).append(change.before)
    results = await asyncio.gather(
        *(sessions[sysid].write_parameters(old) for sysid, old in by_vehicle.items()), return_exceptions=True
    )
    for result in results:
        if isinstance(result, BaseException):
            raise result


class _Failed(Exception):
    def __init__(self, sysid: int, cause: GcsError) -> None:
        super().__init__(sysid)
        self.sysid = sysid
        self.cause = cause


async def _all_or_first(actions: Sequence[Awaitable[T]], every: Sequence[_Loading]) -> list[T]:
    """All results, or the first failure once all others have stopped."""
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


async def _changes(session: Loadable, load: VehicleLoad) -> list[ParameterChange]:
    wanted = dict(load.parameters)
    if not wanted:
        return []
    values = await session.read_parameters(tuple(wanted))
    changes = []
    for name, value in wanted.items():
        before = values[name]
        after = Parameter(name, as_kind(name, value, before.kind), before.kind)
        if after.value != before.value:
            changes.append(ParameterChange(session.sysid, before, after))
    return changes


async def _put(one: _Loading, on_step: Callable[[int, str], None]) -> None:
    session, mission = one.session, one.load.mission
    one.touched.add(MissionType.MISSION)
    await session.upload_mission(mission)
    on_step(session.sysid, f"mission of {len(mission.items)} items")
    for kind, items in one.load.extras:
        one.touched.add(kind)
        await session.deliver(items, kind)
        on_step(session.sysid, f"{kind.name.lower()} of {len(items)} items")


async def _set(one: _Loading, on_step: Callable[[int, str], None]) -> None:
    if one.changes:
        one.wrote = True
        await one.session.write_parameters([change.after for change in one.changes])
        on_step(one.session.sysid, f"{len(one.changes)} parameters")


async def _take_back(every: Sequence[_Loading]) -> dict[int, str]:
    """Clear what was sent, restore parameters; what each vehicle is left with, in words."""
    states = await asyncio.gather(*(asyncio.shield(_cleared(one)) for one in every))
    return {one.session.sysid: state for one, state in zip(every, states, strict=True)}


async def _cleared(one: _Loading) -> str:
    if not one.touched:
        return "as it was"
    if one.session.heartbeat_age_s() > _SILENT_S:
        return "silent; what it holds may be a mix of old and new: do not fly it"
    left = []
    for kind in sorted(one.touched):
        try:
            await one.session.deliver((), kind)
        except GcsError:
            left.append(f"its {kind.name.lower()} may be a mix of old and new: do not fly it")
    if one.wrote:
        try:
            await one.session.write_parameters([change.before for change in one.changes])
        except GcsError:
            left.append("its parameters may be changed")
    if left:
        return ", ".join(left)
    names = " and ".join(kind.name.lower() for kind in sorted(one.touched))
    return f"{names} cleared" + (", parameters as they were" if one.wrote else "")
