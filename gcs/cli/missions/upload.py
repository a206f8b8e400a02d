"""`gcs upload` and `gcs restore`: upload to all vehicles or to none; write old parameter values back."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.errors import counted

if TYPE_CHECKING:
    from gcs.cli.shared.plan_argument import Stopwatch
    from gcs.link.session.connection import Connection
    from gcs.link.session.upload_fleet import Holdings, ParameterChange
    from gcs.plan.trajectory.plan import Plan
    from gcs.types import JsonObject

FIND_S = 15.0


def upload(
    mission: shared.MissionArgument,
    link: shared.LinkOption = None,
    systems: shared.MapOption = None,
    missions_only: Annotated[
        bool, shared.option("Do not change fences, rally points and parameters.", "--missions-only")
    ] = False,
    dry_run: Annotated[bool, shared.option("Show which parameters would change; change nothing.", "--dry-run")] = False,
    to: Annotated[Path, shared.option("Folder for the record, which `gcs restore` reads.")] = Path("uploads"),
    signing_key_file: shared.KeyOption = None,
    backend: shared.BackendOption = "skein",
    transfer: shared.TransferOption = "auto",
    untimed: shared.UntimedOption = False,
    unverified: shared.UnverifiedOption = False,
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Upload missions, fences, rally points and parameters to all vehicles, read them back and compare.

    All vehicles or none: if one upload fails, everything uploaded is cleared again. The error then names the state of
    each vehicle.

    Examples: gcs upload missions/field --link udpin:127.0.0.1:14550

    gcs upload plans/field.skein --link tcp:10.0.0.5:5760 --map 1=7,2=8 --dry-run
    """
    from gcs.cli.shared.plan_argument import Stopwatch, plan_for
    from gcs.link.protocols.mission.strategy import sent_data
    from gcs.util.aio import Stoppable

    screen, watch = Screen(json=json), Stopwatch(BEGAN_S)
    known = shared.connection(link, systems, signing_key_file, transfer)
    watch.lap("start")
    plan, _ = plan_for(mission, screen, watch, unverified=unverified)
    how = {"timed": not untimed, "safety": not missions_only, "dry_run": dry_run}
    held, changes = Stoppable().run(_upload(plan, known, screen, watch, backend=backend, **how))
    record = None
    if held is not None:
        from gcs.cli.shared.console import to_json
        from gcs.util.atomic_write import atomic_write

        record = to / f"{datetime.now():%Y-%m-%d-%H%M%S}-{plan.scenario.name}.json"
        digests = {str(sysid): digest for sysid, digest in held.digests.items()}
        data = {"format": "skein-upload", "plan_hash": held.plan_hash, "digests": digests}
        atomic_write(record, to_json(data | {"parameters": [_change_data(one) for one in held.changes]}) + "\n")
        from rich.table import Table

        table = Table("vehicle", "mission sent", "why", title="missions on board, read back and equal")
        for sysid, way in sorted(held.sent_as.items()):
            table.add_row(str(sysid), way.transfer.value, way.reason)
        screen.show(table)
        have = counted(len(held.digests), "vehicle has its mission", "vehicles have their missions")
        screen.say(f"{have} of plan {plan.hash[:12]}; the read-back is equal")
        if held.changes:
            screen.say(f"to write the old parameter values back: gcs restore {record}")
    screen.say(f"time: {watch}")
    screen.result(
        {
            "plan_hash": plan.hash,
            "uploaded": held is not None,
            "digests": {} if held is None else {str(k): v for k, v in held.digests.items()},
            "missions": [] if held is None else sent_data(held.sent_as),
            "parameters": [_change_data(change) for change in changes],
            "record": record,
        }
    )
    return 0


def restore(
    record: Annotated[Path, shared.argument("Record that `gcs upload` wrote.", "RECORD")],
    link: shared.LinkOption = None,
    systems: shared.MapOption = None,
    signing_key_file: shared.KeyOption = None,
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Write back the parameter values from before an upload.

    Examples: gcs restore uploads/2026-11-21-161530-field.json --link udpin:127.0.0.1:14550
    """
    from gcs.util.aio import Stoppable

    screen = Screen(json=json)
    changes = read_record(record)
    known = shared.connection(link, systems, signing_key_file)

    async def put_back() -> None:
        from gcs.link.session.upload_fleet import restore as put

        async with known.open() as fleet:
            sysids = {change.sysid for change in changes}
            await put(await fleet.vehicles(sysids, FIND_S, systems=known.systems), changes)

    Stoppable().run(put_back())
    screen.say(counted(len(changes), "parameter has its old value", "parameters have their old values"))
    screen.result({"restored": len(changes)})
    return 0


async def _upload(
    plan: Plan,
    known: Connection,
    screen: Screen,
    watch: Stopwatch,
    *,
    backend: str,
    timed: bool,
    safety: bool,
    dry_run: bool,
) -> tuple[Holdings | None, tuple[ParameterChange, ...]]:
    from gcs.autopilots.parameter_names import reason_for
    from gcs.flight.setup.build_loads import loads_built_aside
    from gcs.link.session.upload_fleet import preview, upload_fleet

    async with known.open_backend(backend) as fleet:
        sessions = await fleet.vehicles(plan.sysids, FIND_S, systems=known.systems)
        watch.lap("find")
        autopilots = {sysid: s.autopilot for sysid, s in sessions.items()}
        loads = await loads_built_aside(plan, autopilots, timed=timed, safety=safety, warn=screen.warn)
        watch.lap("missions")
        changes = await preview(sessions, loads)
        why = {(c.sysid, c.before.name): reason_for(autopilots[c.sysid], c.before.name) for c in changes}
        _show(screen, changes, why)
        watch.lap("parameters")
        if dry_run:
            return None, changes
        held = await upload_fleet(
            sessions, loads, plan.hash, lambda sysid, what: screen.say(f"vehicle {sysid} has its {what}")
        )
        fleet.check()
        watch.lap("upload")
        return held, held.changes


def _show(screen: Screen, changes: tuple[ParameterChange, ...], why: dict[tuple[int, str], str]) -> None:
    if not changes:
        return
    from rich.table import Table

    table = Table("vehicle", "parameter", "old", "new", "why", title="parameters that change")
    for change in changes:
        before, after = f"{change.before.value:g}", f"{change.after.value:g}"
        table.add_row(str(change.sysid), change.before.name, before, after, why[change.sysid, change.before.name])
    screen.show(table)


def _change_data(change: ParameterChange) -> JsonObject:
    before, after = change.before, change.after
    return {
        "vehicle": change.sysid,
        "name": before.name,
        "before": before.value,
        "after": after.value,
        "type": before.kind,
    }


def read_record(path: Path) -> tuple[ParameterChange, ...]:
    """The parameters that an upload changed, from its record. Raises `FileFormatError`."""
    from gcs.errors import FileFormatError
    from gcs.link.protocols.parameter_transfer import Parameter
    from gcs.link.session.upload_fleet import ParameterChange
    from gcs.util.bounded_file import UPLOAD_RECORD, read_file, read_json

    hint = "name a file that `gcs upload` wrote"
    try:
        data = read_json(read_file(path, UPLOAD_RECORD, hint=hint))
        if data["format"] != "skein-upload":
            raise ValueError(data["format"])
        found = []
        for row in data["parameters"]:
            name, kind = str(row["name"]), int(row["type"])
            before, after = (Parameter(name, row[key], kind) for key in ("before", "after"))
            if not all(isinstance(p.value, int | float) for p in (before, after)):
                raise TypeError(name)
            found.append(ParameterChange(int(row["vehicle"]), before, after))
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise FileFormatError(f"{path}: not the record of an upload.", hint=hint) from error
    return tuple(found)
