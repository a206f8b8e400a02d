"""`gcs download` and `gcs diff`: read what vehicles have on board, as files or against a plan."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.errors import PeerError, counted

if TYPE_CHECKING:
    from gcs.link.session.connection import Connection
    from gcs.link.session.vehicle_load import OnboardState
    from gcs.mission.model import MissionItem
    from gcs.plan.trajectory.plan import Plan

DIFFERENT = 11  # exit code: everything was read, and there are differences
FIND_S = 15.0
_SHOWN = 20  # differences per vehicle


def download(
    to: Annotated[Path, shared.option("Folder to write. An older one is replaced as a whole.", metavar="DIR")],
    link: shared.LinkOption = None,
    listen: shared.ListenOption = 3.0,
    signing_key_file: shared.KeyOption = None,
    backend: shared.BackendOption = "skein",
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Read missions, fences and rally points of every vehicle on a link into files uavN.plan.

    Examples: gcs download --to held --link udpin:127.0.0.1:14550
    """
    from gcs.util.aio import Stoppable

    screen = Screen(json=json)
    known = shared.connection(link, None, signing_key_file)
    every = Stoppable().run(_read_all(known, backend, listen))
    files = _write(to, every)
    for held, name in zip(every, files, strict=True):
        counts = f"{len(held.mission)} mission items, {len(held.fence)} of a fence, {len(held.rally)} rally points"
        screen.say(f"  {to / name}: {counts}")
    screen.result({"folder": to, "files": files})
    return 0


def diff(
    mission: shared.MissionArgument,
    link: shared.LinkOption = None,
    systems: shared.MapOption = None,
    missions_only: Annotated[bool, shared.option("Compare missions only.", "--missions-only")] = False,
    signing_key_file: shared.KeyOption = None,
    backend: shared.BackendOption = "skein",
    untimed: shared.UntimedOption = False,
    unverified: shared.UnverifiedOption = False,
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Compare what vehicles have on board with a plan; change nothing.

    It compares missions, fences, rally points and the parameters that an upload sets.

    Exit status 0 when every vehicle has what the plan requires, 11 when there are differences.

    Examples: gcs diff field --link udpin:127.0.0.1:14550
    """
    from gcs.cli.shared.plan_argument import Accepts, Stopwatch, plan_for
    from gcs.util.aio import Stoppable

    screen, watch = Screen(json=json), Stopwatch(BEGAN_S)
    known = shared.connection(link, systems, signing_key_file)
    watch.lap("start")
    plan, _ = plan_for(mission, screen, watch, Accepts(unverified))
    found = Stoppable().run(_differences(plan, known, backend, timed=not untimed, safety=not missions_only))
    for sysid, lines in found.items():
        screen.say(f"vehicle {sysid}: " + (counted(len(lines), "difference") if lines else "as planned"))
        for line in lines[:_SHOWN]:
            screen.say(f"  {line}")
        if len(lines) > _SHOWN:
            screen.say(f"  and {len(lines) - _SHOWN} more")
    ok = not any(found.values())
    screen.result({"ok": ok, "plan_hash": plan.hash, "differences": {str(k): v for k, v in found.items()}})
    return 0 if ok else DIFFERENT


async def _read_all(known: Connection, backend: str, listen_s: float) -> list[OnboardState]:
    import asyncio

    from gcs.link.session.vehicle_load import read_onboard

    async with known.open_backend(backend) as fleet:
        sessions = await fleet.listen(listen_s)
        if not sessions:
            raise shared.nobody_heard(known, listen_s, fleet.refused_words())
        every = await asyncio.gather(*(read_onboard(session) for session in sessions.values()))
        fleet.check()
        return list(every)


async def _differences(
    plan: Plan, known: Connection, backend: str, *, timed: bool, safety: bool
) -> dict[int, list[str]]:
    import asyncio

    from gcs.flight.setup.build_loads import loads_built_aside
    from gcs.link.session.upload_fleet import preview
    from gcs.link.session.vehicle_load import read_onboard

    async with known.open_backend(backend) as fleet:
        sessions = await fleet.vehicles(plan.sysids, FIND_S, systems=known.systems)
        autopilots = {sysid: s.autopilot for sysid, s in sessions.items()}
        loads = await loads_built_aside(plan, autopilots, timed=timed, safety=safety)
        every = await asyncio.gather(*(read_onboard(sessions[load.sysid]) for load in loads))
        changes = await preview(sessions, loads)
        fleet.check()
    return {
        held.sysid: held.differences(load) + [change.difference for change in changes if change.sysid == held.sysid]
        for held, load in zip(every, loads, strict=True)
    }


def _is_endless(item: MissionItem) -> bool:
    return any(math.isinf(number) for number in (*item.params, item.alt_m))


def _write(to: Path, every: list[OnboardState]) -> list[str]:
    from gcs.autopilots.traits import Autopilot
    from gcs.mission.export.atomic_folder import replaced
    from gcs.mission.formats.mission_file import MissionFile
    from gcs.mission.formats.qgc_plan import write_mission
    from gcs.mission.formats.registry import vehicle_name

    texts: dict[str, str] = {}
    for held in every:
        try:
            firmware = Autopilot(held.autopilot)
        except ValueError:
            raise PeerError(
                f"vehicle {held.sysid} runs autopilot number {held.autopilot}, for which there is no file format."
            ) from None
        if held.home is None:
            raise PeerError(
                f"vehicle {held.sysid} has no home position yet, and a .plan needs one.", hint="wait for its GNSS fix"
            )
        if (endless := next((n for n, one in enumerate(held.mission, 1) if _is_endless(one)), None)) is not None:
            raise PeerError(
                f"vehicle {held.sysid} has an infinite number in its mission item {endless}, which no .plan can hold.",
                hint="its autopilot cannot fly that: upload another mission",
            )
        name = f"{vehicle_name(held.sysid)}.plan"
        file = MissionFile(name, firmware, held.home, held.mission, held.geofence(), held.rally_points())
        texts[name] = write_mission(file)
    with replaced(to) as folder:
        for name, text in texts.items():
            folder.write(name, text)
        folder.write_index({"version": 2, "downloaded": True, "sha256": folder.sha256})
    return list(texts)
