"""What was on vehicles before an upload: old parameters and items, which are read, recorded and given back."""

import asyncio
import json
import struct
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import TypeAdapter

from gcs.autopilots.parameter_names import in_units_of
from gcs.autopilots.traits import link_behaviour
from gcs.errors import FileFormatError, GcsError, PeerError, PeerTimeout, UsageError, counted
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.parameter_transfer import Parameter, as_kind
from gcs.link.session.vehicle_api import Loadable
from gcs.link.session.vehicle_load import VehicleLoad, packed
from gcs.mavlink import MissionType
from gcs.mission.model import Home, MissionItem, VehicleMission
from gcs.types import JsonObject
from gcs.util.atomic_write import atomic_write
from gcs.util.bounded_file import UPLOAD_RECORD, read_file, read_json

SILENT_S = 4.0  # a vehicle whose last heartbeat is older gets nothing
_FORMAT = "skein-upload"
_HINT = "name a file that `gcs upload` wrote, or the folder of a flight"
_WORDS = {
    MissionType.MISSION: ("mission of {}", "item", "items", "no mission"),
    MissionType.FENCE: ("fence of {}", "item", "items", "no fence"),
    MissionType.RALLY: ("{}", "rally point", "rally points", "no rally points"),
}


@dataclass(frozen=True)
class ParameterChange:
    """One parameter of one vehicle, before and after the upload."""

    sysid: int
    before: Parameter
    after: Parameter

    @property
    def difference(self) -> str:
        """The values required by a load and on board, in words."""
        return f"parameter {self.before.name} required {self.after.value:g}, on board {self.before.value:g}"


@dataclass(frozen=True)
class LoadBefore:
    """What one vehicle had before an upload.

    `items` are those of the types that the upload replaces, without home; `same` the types that it leaves as they are.
    `unread` has the reason by type. `fence` is the parameter that switches the fence on, where the upload sets it.
    """

    sysid: int
    autopilot: int
    changes: tuple[ParameterChange, ...] = ()
    items: Mapping[MissionType, tuple[MissionItem, ...]] = field(default_factory=dict)
    same: frozenset[MissionType] = frozenset()
    unread: Mapping[MissionType, str] = field(default_factory=dict)
    fence: Parameter | None = None

    def __str__(self) -> str:
        parts = [part_words(kind, len(items)) + (" (as planned)" if kind in self.same else "")
                 for kind, items in self.items.items()]  # fmt: skip
        parts += [f"{kind.name.lower()} not read: {reason}" for kind, reason in self.unread.items()]
        return ", ".join(parts) + ("" if self.fence is None else f", {self.fence.name} {self.fence.value:g}")

    def data(self) -> JsonObject:
        """Return what was there as plain values, for `--json`: the number of items by type."""
        return {
            "vehicle": self.sysid,
            **{kind.name.lower(): len(items) for kind, items in self.items.items()},
            **{kind.name.lower(): None for kind in self.unread},
            "as_planned": sorted(kind.name.lower() for kind in self.same),
            "fence_enabled": None if self.fence is None else bool(self.fence.value),
        }


_BEFORE = TypeAdapter(tuple[LoadBefore, ...])


def part_words(kind: MissionType, count: int) -> str:
    """Return a part of a load in words: "mission of 12 items", "no fence"."""
    text, one, many, none = _WORDS[kind]
    return text.format(counted(count, one, many)) if count else none


def before_words(before: Iterable[LoadBefore]) -> list[str]:
    """Return a line for all vehicles that had the same: "vehicles 1, 2: mission of 12 items, no fence"."""
    by_words: dict[str, list[str]] = {}
    for one in before:
        by_words.setdefault(str(one), []).append(str(one.sysid))
    return [f"vehicle{'s' * (len(ids) > 1)} {', '.join(ids)}: {words}" for words, ids in by_words.items()]


async def parameter_changes(session: Loadable, load: VehicleLoad) -> tuple[list[ParameterChange], dict[str, Parameter]]:
    """Return the parameters that a load changes, and those that it sets as they are now. Raises `PeerError`."""
    wanted = dict(load.parameters)
    if not wanted:
        return [], {}
    values = await session.read_parameters(tuple(wanted))
    changes = []
    for name, value in wanted.items():
        before = values[name]
        own = in_units_of(session.autopilot, before.name, name, value)
        try:
            after = Parameter(before.name, as_kind(before.name, own, before.kind), before.kind)
            as_kind(before.name, before.value, before.kind)  # else it could not be restored
        except UsageError as error:
            raise PeerError(f"vehicle {session.sysid} reports {before}. {error.message}") from None
        if after.value != before.value:
            changes.append(ParameterChange(session.sysid, before, after))
    return changes, values


async def read_before(
    sessions: Mapping[int, Loadable], loads: Sequence[VehicleLoad], say: Callable[[str], None] = lambda _: None
) -> tuple[LoadBefore, ...]:
    """Return what every vehicle has of the parts of its load; change nothing.

    `say` reports what takes time. Items that cannot be read are `unread`. Raises `PeerError` for parameters.
    """
    return tuple(await asyncio.gather(*(_read(sessions[load.sysid], load, say) for load in loads)))


async def _read(session: Loadable, load: VehicleLoad, say: Callable[[str], None]) -> LoadBefore:
    changes, values = await parameter_changes(session, load)
    items: dict[MissionType, tuple[MissionItem, ...]] = {}
    unread: dict[MissionType, str] = {}
    same, silent = set(), ""
    for kind, new in ((MissionType.MISSION, load.mission.items), *load.extras):
        try:
            if silent:
                raise PeerError(silent)
            found = await session.download(kind)  # one round trip where there is none
        except PeerError as error:
            unread[kind] = error.message.rstrip(".")
            silent = error.message if isinstance(error, PeerTimeout) else silent
            continue
        items[kind] = found = found[int(session.home_is_item_0 and kind is MissionType.MISSION) :]
        if found:
            say(f"vehicle {session.sysid}: read its {part_words(kind, len(found))}")
        if not compare_missions(new, found, autopilot=session.autopilot):
            same.add(kind)
    fence = values.get(link_behaviour(session.autopilot).fence_parameter)
    return LoadBefore(session.sysid, session.autopilot, tuple(changes), items, frozenset(same), unread, fence)


async def give_back(sessions: Mapping[int, Loadable], before: Iterable[LoadBefore]) -> tuple[str, ...]:
    """Give all vehicles at once what they had; return what could not be given back, one sentence for each vehicle.

    An armed vehicle keeps its mission, fence and rally points: they may be in use.
    """
    found = await asyncio.gather(*(_give_back(sessions[one.sysid], one) for one in before))
    return tuple(sentence for sentence in found if sentence)


async def _give_back(session: Loadable, before: LoadBefore) -> str:
    kept: dict[str, list[str]] = {}  # what is not given back, by the reason

    async def attempt(what: Sequence[str], work: Awaitable[object]) -> bool:
        try:
            await work
        except GcsError as error:
            kept.setdefault(error.message.rstrip("."), []).extend(what)
            return False
        return True

    def name(change: ParameterChange) -> str:
        return f"{change.before.name} {change.before.value:g} (now {change.after.value:g})"

    items = [(kind, old) for kind, old in before.items.items() if kind not in before.same]
    words = {kind: part_words(kind, len(one)) for kind, one in items}
    for kind, reason in before.unread.items():
        kept[f"not read before the upload: {reason}"] = [kind.name.lower()]
    silent_s = session.heartbeat_age_s()
    if silent_s > SILENT_S:
        reason = "it is not there" if silent_s == float("inf") else f"its last heartbeat is {silent_s:.0f} s old"
        kept.setdefault(reason, []).extend([*map(name, before.changes), *words.values()])
        return _sentence(session.sysid, kept)
    if before.changes:
        try:
            await session.write_parameters([change.before for change in before.changes])
        except GcsError:  # which of them?
            await asyncio.gather(
                *(attempt([name(one)], session.write_parameters([one.before])) for one in before.changes)
            )
    for kind, old in items:
        if session.armed:
            kept.setdefault("it is armed", []).append(words[kind])
        elif kind is MissionType.MISSION and old:
            home = await session.home() or Home(0.0, 0.0, 0.0)  # a vehicle keeps its own
            mission = VehicleMission(before.sysid, home, old, (None,) * len(old))
            await attempt([words[kind]], session.upload_mission(mission))
        else:
            await attempt([words[kind]], session.upload_items(old, kind))
    return _sentence(session.sysid, kept)


def _sentence(sysid: int, kept: Mapping[str, Sequence[str]]) -> str:
    parts = "; ".join(f"{', '.join(what)} ({reason})" for reason, what in kept.items() if what)
    return f"vehicle {sysid} did not get back {parts}" if parts else ""


def given_words(before: Sequence[LoadBefore]) -> str:
    """Return what a restore gives back, in words."""
    changes = sum(len(one.changes) for one in before)
    replaced = sum(any(kind not in one.same for kind in one.items) for one in before)
    return f"{counted(changes, 'parameter')} restored, and the items on board of {counted(replaced, 'vehicle')}"


def change_data(change: ParameterChange) -> JsonObject:
    """Return a change as plain values."""
    before, after = change.before, change.after
    values = {"before": before.value, "after": after.value, "type": before.kind}
    return {"vehicle": change.sysid, "name": before.name, **values}


def record_before(path: Path, plan_hash: str, digests: Mapping[int, str], before: Sequence[LoadBefore]) -> None:
    """Write what vehicles had before an upload. NaN of an item is NaN, which JSON lacks. Raises `OSError`."""
    rows = _BEFORE.dump_python(tuple(before), mode="json")
    record = {"format": _FORMAT, "plan_hash": plan_hash, "digests": dict(digests), "before": rows}
    atomic_write(path, json.dumps(record) + "\n")


def recorded_before(path: Path) -> tuple[LoadBefore, ...]:
    """Return what vehicles had before an upload, from its record; older records have parameters alone.

    Raises `FileFormatError`.
    """
    try:
        data = read_json(read_file(path, UPLOAD_RECORD, hint=_HINT), not_finite=True)
        if data["format"] != _FORMAT:
            raise ValueError(data["format"])
        changes: dict[int, list[JsonObject]] = {}
        for row in data.get("parameters", ()):
            sides = ({"name": row["name"], "kind": row["type"], "value": row[key]} for key in ("before", "after"))
            change = dict(zip(("before", "after"), sides, strict=True))
            changes.setdefault(int(row["vehicle"]), []).append({"sysid": row["vehicle"], **change})
        older = [{"sysid": sysid, "autopilot": 0, "changes": rows} for sysid, rows in changes.items()]
        found = _BEFORE.validate_python(data.get("before", older))
        for one in found:
            packed([item for items in one.items.values() for item in items])  # else no vehicle can have had them
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, struct.error) as error:
        raise FileFormatError(f"{path}: not the record of an upload.", hint=_HINT) from error
    return found
