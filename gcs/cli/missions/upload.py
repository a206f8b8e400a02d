"""`gcs upload` and `gcs restore`: upload to all vehicles or to none; give back what was on board before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.errors import GcsError, PeerError, counted

if TYPE_CHECKING:
    from gcs.cli.shared.plan_argument import Stopwatch
    from gcs.link.session.connection import Connection
    from gcs.link.session.load_before import LoadBefore, ParameterChange
    from gcs.link.session.upload_fleet import Holdings
    from gcs.plan.trajectory.plan import Plan

FIND_S = 15.0
_SETTLE_S = 3.0  # once one vehicle is heard, for the others


def upload(
    mission: shared.MissionArgument,
    link: shared.LinkOption = None,
    systems: shared.MapOption = None,
    missions_only: Annotated[
        bool, shared.option("Do not change fences, rally points and parameters.", "--missions-only")
    ] = False,
    dry_run: Annotated[
        bool, shared.option("Show what is on board and what would change; change nothing.", "--dry-run")
    ] = False,
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

    Examples: gcs upload field --link udpin:127.0.0.1:14550

    gcs upload plans/field.skein --link tcp:10.0.0.5:5760 --map 1=7,2=8 --dry-run
    """
    from gcs.cli.shared.plan_argument import Accepts, Stopwatch, plan_for
    from gcs.link.protocols.mission.strategy import sent_data
    from gcs.link.session.load_before import change_data
    from gcs.util.aio import Stoppable

    screen, watch = Screen(json=json), Stopwatch(BEGAN_S)
    known = shared.connection(link, systems, signing_key_file, transfer)
    watch.lap("start")
    plan, _ = plan_for(mission, screen, watch, Accepts(unverified))
    record = None if dry_run else to / f"{datetime.now():%Y-%m-%d-%H%M%S}-{plan.scenario.name}.json"
    wanted = _Upload(plan, known, backend, timed=not untimed, safety=not missions_only, record=record)
    held, before = Stoppable().run(_upload(wanted, screen, watch))
    if held is not None:
        from rich.table import Table

        table = Table("vehicle", "mission sent", "why", title="missions on board, read back and equal")
        for sysid, way in sorted(held.sent_as.items()):
            table.add_row(str(sysid), way.transfer.value, way.reason)
        screen.show(table)
        have = counted(len(held.digests), "vehicle has its mission", "vehicles have their missions")
        screen.say(f"{have} of plan {plan.hash[:12]}; the read-back is equal")
        screen.say(f"to give back what was on board before: gcs restore {record}")
    screen.say(f"time: {watch}")
    screen.result(
        {
            "plan_hash": plan.hash,
            "uploaded": held is not None,
            "digests": {} if held is None else {str(k): v for k, v in held.digests.items()},
            "missions": [] if held is None else sent_data(held.sent_as),
            "parameters": [change_data(change) for one in before for change in one.changes],
            "before": [one.data() for one in before],
            "record": record,
        }
    )
    return 0


def restore(
    record: Annotated[Path, shared.argument("Record that `gcs upload` wrote, or the folder of a flight.", "RECORD")],
    link: shared.LinkOption = None,
    systems: shared.MapOption = None,
    signing_key_file: shared.KeyOption = None,
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Give back what was on board before an upload: parameters, missions, fences and rally points.

    A vehicle that is not there, or armed, is named with what it did not get back.

    Examples: gcs restore uploads/2026-11-21-161530-field.json --link udpin:127.0.0.1:14550

    gcs restore flights/2026-11-21-161530-field
    """
    from gcs.flight.recording.flight_folder import BEFORE
    from gcs.link.session.load_before import given_words, recorded_before
    from gcs.util.aio import Stoppable

    screen = Screen(json=json)
    before = recorded_before(record / BEFORE if record.is_dir() else record)
    known = shared.connection(link, systems, signing_key_file)
    missing = Stoppable().run(_give_back(known, before))
    if missing:
        raise PeerError("; ".join(missing) + ".", hint="run it again once they are there, disarmed and heard")
    screen.say(given_words(before))
    screen.result({"restored": sum(len(one.changes) for one in before), "before": [one.data() for one in before]})
    return 0


async def _give_back(known: Connection, before: Sequence[LoadBefore]) -> tuple[str, ...]:
    """Give back what is in a record, also if some of its vehicles are not there; return what is missing."""
    from gcs.link.session.load_before import give_back

    async with known.open() as fleet:
        kinds = {one.sysid: one.autopilot for one in before}
        sessions = await fleet.vehicles_left(kinds, FIND_S, settle_s=_SETTLE_S, systems=known.systems)
        fleet.check()
        return await give_back(sessions, before)


@dataclass(frozen=True)
class _Upload:
    """What goes on board, and over which links. Without a `record` of what was there before, nothing is changed."""

    plan: Plan
    known: Connection
    backend: str
    timed: bool
    safety: bool
    record: Path | None


async def _upload(wanted: _Upload, screen: Screen, watch: Stopwatch) -> tuple[Holdings | None, tuple[LoadBefore, ...]]:
    from gcs.autopilots.parameter_names import reason_for
    from gcs.flight.setup.build_loads import loads_built_aside
    from gcs.flight.setup.timing_check import timing_check
    from gcs.link.session.load_before import before_words, read_before, record_before
    from gcs.link.session.upload_fleet import upload_fleet

    plan, known = wanted.plan, wanted.known
    async with known.open_backend(wanted.backend) as fleet:
        sessions = await fleet.vehicles(plan.sysids, FIND_S, systems=known.systems)
        watch.lap("find")
        autopilots = {sysid: s.autopilot for sysid, s in sessions.items()}
        loads = await loads_built_aside(plan, autopilots, timed=wanted.timed, safety=wanted.safety, warn=screen.warn)
        watch.lap("missions")
        before = await read_before(sessions, loads, screen.say)
        changes = [change for one in before for change in one.changes]
        why = {(c.sysid, c.before.name): reason_for(autopilots[c.sysid], c.before.name) for c in changes}
        for line in before_words(before):
            screen.say(f"on board now, {line}")
        _show(screen, changes, why)
        for load in loads if wanted.timed else ():
            check = await timing_check(sessions[load.sysid], load)
            if not check.ok:
                screen.warn(f"vehicle {check.sysid} will not keep its times: {check.measured}")
        watch.lap("on board before")
        if (record := wanted.record) is None:
            return None, before
        record_before(record, plan.hash, {}, before)
        try:
            held = await upload_fleet(
                sessions, loads, plan.hash, lambda sysid, what: screen.say(f"vehicle {sysid} has its {what}")
            )
        except GcsError:
            screen.say(f"to give back what was on board before: gcs restore {record}")
            raise
        record_before(record, plan.hash, held.digests, before)
        fleet.check()
        watch.lap("upload")
        return held, before


def _show(screen: Screen, changes: Sequence[ParameterChange], why: dict[tuple[int, str], str]) -> None:
    if not changes:
        return
    from rich.table import Table

    table = Table("vehicle", "parameter", "old", "new", "why", title="parameters that change")
    for change in changes:
        before, after = f"{change.before.value:g}", f"{change.after.value:g}"
        table.add_row(str(change.sysid), change.before.name, before, after, why[change.sysid, change.before.name])
    screen.show(table)
