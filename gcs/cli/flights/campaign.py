"""`gcs campaign`: fly one plan many times under drawn conditions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.errors import UsageError
from gcs.flight.contingency.choices import FlightMode, NavigatorChoice, OnLeaderLoss, OnLoss

FLIGHTS_MAX = 10_000_000


def campaign(
    mission: shared.MissionArgument,
    flights: Annotated[
        int | None, shared.option("Number of flights.", metavar="N", limits=(1, FLIGHTS_MAX, ""), shown="100")
    ] = None,
    seed: Annotated[
        int | None,
        shared.option("Seed of the campaign: it fixes every flight.", limits=(0, 2**53, ""), shown="0"),
    ] = None,
    wind: Annotated[
        str | None,
        shared.option("Wind in m/s and degrees, each a value, a range or any: 0..6@any.", metavar="SPEED@FROM"),
    ] = None,
    gusts: Annotated[
        str | None,
        shared.option("Gusts: none, light, moderate, severe, or m/s; several, or a range: light,moderate."),
    ] = None,
    loss: Annotated[
        str | None, shared.option("Packet loss of every link, both ways: 5%, or 0..20%.", metavar="SHARE")
    ] = None,
    fault: Annotated[
        list[str] | None,
        shared.option("A fault: its chance, vehicle, kind and time, as 5%:any:die@any. Repeat it for several."),
    ] = None,
    vary: Annotated[
        list[str] | None,
        shared.option("A value of the scenario, planned anew for every flight: vehicle.mass_kg=1.8..2.4. Repeatable."),
    ] = None,
    sampling: Annotated[
        str | None,
        shared.option(
            "random; latin: every factor evenly; full: every combination of levels.",
            words=("random", "latin", "full"),
            shown="random",
        ),
    ] = None,
    design: Annotated[
        Path | None, shared.option("TOML file with these options by name; those given here come first.")
    ] = None,
    mode: Annotated[
        str | None,
        shared.option(
            "stream: setpoint stream; mission: waypoint missions on board.", words=tuple(FlightMode), shown="stream"
        ),
    ] = None,
    nav: Annotated[
        str | None,
        shared.option("With --mode mission: as that of `gcs fly`.", words=tuple(NavigatorChoice), shown="auto"),
    ] = None,
    follow: Annotated[
        bool | None, shared.option("With --mode stream: followers use the leader's telemetry.", "--follow")
    ] = None,
    on_loss: Annotated[
        str | None,
        shared.option("What the others do when a vehicle is lost.", words=tuple(OnLoss), shown="land"),
    ] = None,
    on_leader_loss: Annotated[
        str | None,
        shared.option("With --follow, when the leader is lost.", words=tuple(OnLeaderLoss), shown="promote"),
    ] = None,
    until: Annotated[
        str | None,
        shared.option("End as soon as the interval of the pass rate is so wide, 2% for instance.", metavar="WIDTH"),
    ] = None,
    worst: Annotated[
        int, shared.option("Flights kept whole for each criterion, beside all that did not hold.", limits=(1, 1000, ""))
    ] = 3,
    to: Annotated[
        Path | None, shared.option("Folder of the campaign; one that is there goes on.", shown="campaigns/NAME")
    ] = None,
    workers: Annotated[
        int | None, shared.option("Flights at a time on this machine.", limits=(1, 1024, ""), shown="one for each core")
    ] = None,
    scheduler: Annotated[
        str | None, shared.option("Dask scheduler of a cluster: tls://HOST:8786.", metavar="ADDRESS")
    ] = None,
    tls: Annotated[
        Path | None, shared.option("With tls://: folder with ca.pem, cert.pem and key.pem.", metavar="FOLDER")
    ] = None,
    open_scheduler: Annotated[
        bool,
        shared.option(
            "Use a tcp:// scheduler on another machine: whoever reaches it runs any code there, and here.",
            "--open-scheduler",
        ),
    ] = False,
    dashboard: Annotated[
        bool, shared.option("Print the address of Dask's dashboard; it needs the package bokeh.", "--dashboard")
    ] = False,
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Fly a mission many times, emulated, in drawn wind, gusts and faults; the same command goes on where it ended.

    Every flight is fixed by the seed and can be flown again; Ctrl-C keeps what has ended. `gcs campaign report FOLDER`
    shows pass rates and what they depend on, also while flights are under way.

    Exit status 0 when the campaign is complete, whatever its flights did.

    Example: gcs campaign field --flights 1000 --wind 0..6@any --gusts light,moderate --to campaigns/field
    """
    screen = Screen(json=json)
    from gcs.campaign.cluster_address import Cluster, refuse_open_scheduler, refuse_without_dask

    refuse_without_dask()
    cluster = Cluster(workers, scheduler, tls, open_scheduler, dashboard)
    refuse_open_scheduler(cluster)
    from gcs.campaign.campaign_options import CampaignOptions, read_design

    given = {
        name: value
        for name, value in (
            *(("flights", flights), ("seed", seed), ("wind", wind), ("gusts", gusts), ("loss", loss)),
            *(("faults", fault), ("sampling", sampling), ("mode", mode), ("nav", nav), ("follow", follow)),
            *(("on_loss", on_loss), ("on_leader_loss", on_leader_loss), ("until", until), ("vary", vary)),
        )
        if value is not None
    }
    asked = CampaignOptions.of((read_design(design) if design else {}) | given)
    from gcs.cli.flights.campaign_view import fly_campaign
    from gcs.cli.shared.plan_argument import Accepts, Stopwatch, plan_for

    watch = Stopwatch(BEGAN_S)
    watch.lap("start")
    plan, report = plan_for(mission, screen, watch, Accepts(refuse=asked.refuse))
    if to is None:
        to = Path("campaigns") / plan.scenario.name
    if dashboard and scheduler is None:
        from importlib.util import find_spec

        if find_spec("bokeh") is None:
            raise UsageError("--dashboard needs bokeh, which is not installed", hint="pip install bokeh")
    return fly_campaign(screen, asked, plan, report, cluster, to, worst)
