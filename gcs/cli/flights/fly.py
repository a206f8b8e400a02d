"""`gcs fly`: plan, verify, export, upload, read back, fly, judge."""

from __future__ import annotations

from ipaddress import IPv4Address
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.cli.shared.page_option import PageChoices, PageOption, TilesOption, refuse_tiles
from gcs.errors import UsageError
from gcs.flight.contingency.choices import FlightMode, NavigatorChoice, OnLeaderLoss, OnLoss, TimeKeeping
from gcs.page.page_feed import refuse_without_nicegui

if TYPE_CHECKING:
    from gcs.scenario.schema.scenario import Scenario

LARGEST_SEED = 2**53


def fly(
    mission: shared.MissionArgument,
    sim: Annotated[bool, shared.option("Start emulated vehicles for this flight, and fly them.", "--sim")] = False,
    link: shared.LinkOption = None,
    systems: shared.MapOption = None,
    signing_key_file: shared.KeyOption = None,
    transfer: shared.TransferOption = "auto",
    radio: shared.RadioOption = None,
    missions_only: Annotated[
        bool, shared.option("With --link: do not change fences, rally points and parameters.", "--missions-only")
    ] = False,
    mode: Annotated[
        str, shared.option("stream: setpoint stream; mission: waypoint missions on board.", words=tuple(FlightMode))
    ] = FlightMode.STREAM,
    speedup: Annotated[str, shared.option("With --sim: speed in multiples of real time, or max.")] = "10",
    seed: Annotated[
        int, shared.option("With --sim: seed of the noise of sensors, and of the gusts.", limits=(0, LARGEST_SEED, ""))
    ] = 0,
    fault: Annotated[
        list[str] | None, shared.option("With --sim: inject a fault, e.g. 3:die@60; see sim-bridge --help.")
    ] = None,
    wind: Annotated[
        str | None,
        shared.option("With --sim: wind in m/s and degrees; 3@270 comes from the west.", metavar="SPEED@FROM"),
    ] = None,
    gusts: Annotated[
        str | None,
        typer.Option(
            help="With --sim: gusts: light (0.5 m/s), moderate (1 m/s), severe (2 m/s), "
            "or another standard deviation in m/s.",
            autocompletion=shared.one_of("light", "moderate", "severe"),
        ),
    ] = None,
    follow: Annotated[
        bool, shared.option("With --mode stream: followers use the leader's telemetry instead of its plan.", "--follow")
    ] = False,
    on_loss: Annotated[
        str,
        shared.option(
            "What the other vehicles do when one is lost: land, return, continue, or close (a new plan without it).",
            words=tuple(OnLoss),
        ),
    ] = OnLoss.LAND,
    on_leader_loss: Annotated[
        str,
        shared.option(
            "With --follow, when the leader is lost: promote (the next vehicle leads) or return.",
            words=tuple(OnLeaderLoss),
        ),
    ] = OnLeaderLoss.PROMOTE,
    nav: Annotated[
        str,
        shared.option(
            "With --sim --mode mission: waypoint navigator of the emulated vehicles. own: that of the autopilot; "
            "ideal: it keeps the plan's times; auto: own where it is predicted to meet the table `judge`, else ideal.",
            words=tuple(NavigatorChoice),
        ),
    ] = NavigatorChoice.AUTO,
    gates: Annotated[
        int,
        shared.option(
            "With --mode mission: number of points where all vehicles wait for a common time.",
            metavar="N",
            limits=shared.GATES,
        ),
    ] = 0,
    reserve: Annotated[
        str | None,
        shared.option(
            "With --link: least charge left after the flight, of a full battery; default: `reserve` of the table "
            "`preflight`.",
            metavar="SHARE",
        ),
    ] = None,
    waive: Annotated[
        list[str] | None,
        shared.option(
            "With --link: fly although this pre-flight check fails, by its name; the flight's folder records it. "
            "Repeat it for several.",
            metavar="CHECK",
        ),
    ] = None,
    volumes: Annotated[
        Path | None,
        shared.option(
            "Volumes of this flight that `gcs export --format f3548` wrote: a vehicle that leaves them is an incident.",
            metavar="FILE",
            shown="not watched",
        ),
    ] = None,
    geoid: Annotated[
        float | None,
        shared.option(
            "With --volumes: height of mean sea level above the WGS-84 ellipsoid, as exported.",
            metavar="METRES",
            limits=(-110, 110, "m"),
        ),
    ] = None,
    to: Annotated[Path, shared.option("Folder for the folders of flights.")] = Path("flights"),
    also_to: shared.AlsoToOption = None,
    page: PageOption = False,
    page_address: Annotated[
        str,
        shared.option(
            "With --page: this address of the machine too, for other machines; the page is read-only there.",
            "--page-address",
        ),
    ] = "",
    page_control: Annotated[
        bool, shared.option("With --page-address: orders are taken from other machines too.", "--page-control")
    ] = False,
    page_keep: Annotated[
        bool,
        shared.option(
            "With --page: after the flight the page stays until Ctrl-C, also without a browser or a terminal.",
            "--page-keep",
        ),
    ] = False,
    tiles: TilesOption = "",
    yes_arm: Annotated[bool, shared.option("With --link: arm without confirmation.", "--yes-arm")] = False,
    unverified: shared.UnverifiedOption = False,
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Plan a mission, upload it to every vehicle, read it back, fly it and judge the flight.

    Exit status 0 when the flight violated no criterion of the scenario's table `judge` as far as is known, 10 when it
    did, 9 when it was aborted.

    Examples: gcs fly simulation1 --sim

    gcs fly simulation1 --sim --mode mission --speedup max

    gcs fly simulation1 --sim --speedup 1 --also-to udpout:127.0.0.1:14550

    gcs fly simulation1 --sim --page
    """
    screen = Screen(json=json)
    share = None if reserve is None else shared.as_share(reserve)
    keeping = TimeKeeping(FlightMode(mode), sim, NavigatorChoice(nav), gates)
    _check(keeping, speedup, on_link=bool(link), follow=follow)
    for name, given in (("--reserve", reserve), ("--waive", waive), ("--radio", radio)):
        if given and sim:
            raise UsageError(f"{name} applies to vehicles on a --link only", hint=f"leave {name} out with --sim")
    if page:
        refuse_without_nicegui()
        if json:
            raise UsageError("--page and --json exclude each other: nobody would read the page's address")
    if (volumes is None) != (geoid is None):
        raise UsageError("--volumes and --geoid belong together", hint="give both, or neither")
    refuse_tiles(tiles, page=page)
    _check_page(page, page_address, page_control, page_keep)
    if share is not None and not 0.0 <= share < 1.0:
        raise UsageError(f"--reserve {reserve}: not a share", hint="give a share of a full battery: 30% or 0.3")
    known = shared.connection(link, systems, signing_key_file, transfer, radio) if link else None
    watched_at = shared.watchers(also_to, known.links if known else None)
    from gcs.cli.flights.fly_view import fly_and_judge
    from gcs.cli.shared.plan_argument import Accepts, Stopwatch, plan_for
    from gcs.flight.contingency.options import FlightOptions
    from gcs.flight.monitoring.preflight_check import known_checks
    from gcs.flight.monitoring.volume_watch import FlownVolumes
    from gcs.flight.run import FlightRun, refuse_late_starts
    from gcs.flight.setup.simulator_process import Emulated, refuse_wrong_options
    from gcs.plan.plan_file import is_plan_file, stored_returns
    from gcs.plan.trajectory.constraint_id import Kind
    from gcs.plan.verification.verify import refusal

    waived = known_checks(waive or ())
    watch = Stopwatch(BEGAN_S)
    watch.lap("start")

    emulated = Emulated(speedup, seed, tuple(fault or ()), wind, gusts)

    def refuse(scenario: Scenario) -> None:
        count = len(scenario.formation.sysids)
        if max(scenario.formation.sysids) > shared.LARGEST_SYSTEM:
            raise UsageError(
                f"{count} vehicles: one MAVLink network has at most {shared.LARGEST_SYSTEM} system ids",
                hint="fly a smaller formation; `gcs export` writes files for all vehicles",
            )
        if keeping.mode is FlightMode.MISSION:
            refuse_late_starts(scenario)
        if sim and (fault or wind is not None or gusts is not None):
            refuse_wrong_options(scenario, emulated)

    plan, report = plan_for(mission, screen, watch, Accepts(unverified, refuse=refuse))
    if any(check.constraint.kind is Kind.BATTERY for check in report.failures):
        raise refusal(report)  # no inspection is worth a vehicle that falls
    limits = plan.scenario.preflight
    if share is not None:
        limits = limits.model_copy(update={"reserve": share})
    choices = FlightOptions(
        follow=follow,
        on_loss=OnLoss(on_loss),
        on_leader_loss=OnLeaderLoss(on_leader_loss),
        waived=waived,
        volumes=None if volumes is None or geoid is None else FlownVolumes.read(volumes, plan, geoid),
    )
    run = FlightRun(
        plan,
        report,
        keeping,
        known,
        emulated,
        to,
        choices,
        safety=not missions_only,
        limits=limits,
        also_to=watched_at,
        returns=stored_returns(mission) if is_plan_file(mission) else None,
    )
    return fly_and_judge(
        run,
        screen,
        watch,
        asks=not yes_arm,
        page=PageChoices(page_address, page_control, page_keep, tiles) if page else None,
    )


def _check_page(page: bool, address: str, control: bool, keep: bool) -> None:
    """Raise UsageError for options of a page that there is not, or for an address that is none."""
    if address and not page:
        raise UsageError("--page-address needs a page", hint="add --page")
    if keep and not page:
        raise UsageError("--page-keep needs a page", hint="add --page")
    if control and not address:
        raise UsageError("--page-control is for other machines: this one may always order", hint="give --page-address")
    if address:
        try:
            known = IPv4Address(address)
        except ValueError:
            known = None
        if known is None or known.is_unspecified or known.is_loopback:
            raise UsageError(
                f"--page-address {address}: not an address that other machines reach",
                hint="give the machine's own address in their network, as 192.168.1.5",
            )


def _check(keeping: TimeKeeping, speedup: str, *, on_link: bool, follow: bool) -> None:
    """Refuse options that do not go together before heavy imports. Raises `UsageError`."""
    if keeping.emulated is on_link:
        raise UsageError(
            "give --sim for emulated vehicles, or --link for vehicles on a link, and not both",
            hint="for example `gcs fly simulation1 --sim`",
        )
    shared.as_rate("--speedup", speedup)
    if follow and keeping.mode is not FlightMode.STREAM:
        raise UsageError("--follow needs a setpoint stream", hint="give --mode stream")
    if keeping.gates and (keeping.mode is FlightMode.STREAM or keeping.navigator is NavigatorChoice.IDEAL):
        raise UsageError(
            "--gates needs waypoint missions and the autopilot's own navigator",
            hint="add --mode mission and leave --nav ideal out",
        )
