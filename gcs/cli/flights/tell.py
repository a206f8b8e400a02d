"""`gcs tell`: orders to a flight that `gcs fly` of this computer flies, or to vehicles on a link."""

from pathlib import Path
from typing import Annotated

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import Screen
from gcs.errors import UsageError


def tell(
    order: Annotated[
        list[str],
        shared.argument(
            "All together: hold, resume, home, go NORTH,EAST,HEIGHT, slower FACTOR, avoid NORTH,EAST,RADIUS, "
            "scale FACTOR, shape NAME; one by one: hold with --vehicles, continue, land, return; "
            "event NAME: the order that the scenario has for it.",
            "ORDER",
            shared.one_of(
                *("hold", "resume", "home", "go", "slower", "avoid", "scale", "shape"),
                *("continue", "land", "return", "event"),
            ),
        ),
    ],
    vehicles: Annotated[
        str | None,
        shared.option("System ids of vehicles that hold, land, return or continue; without it, all.", metavar="1,3"),
    ] = None,
    degrees: Annotated[
        bool, shared.option("Places are LATITUDE,LONGITUDE in degrees; radius and height are in m.", "--degrees")
    ] = False,
    flight: Annotated[
        Path | None, shared.option("Folder of the flight.", metavar="FOLDER", shown="the newest under way")
    ] = None,
    to: Annotated[Path, shared.option("Folder that holds the folders of flights.")] = Path("flights"),
    link: shared.LinkOption = None,
    listen: shared.ListenOption = 2.0,
    signing_key_file: shared.KeyOption = None,
    backend: shared.BackendOption = "skein",
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Give an order to a flight under way: change its plan, or have vehicles hold, land or return one by one.

    A new plan continues the old one in flight, is verified, and replaces the setpoints of all vehicles at one instant.
    Where none is found the old plan is flown on; before a new no-fly zone the formation brakes. One that holds, or went
    elsewhere, hovers there until the next order, and lands after five minutes; resume goes on with the plan it left.

    With --link vehicles are commanded directly, whichever program flies them: hold, land or return (RTL), each by
    itself. Those that are not armed receive no command.

    Exit status 0 when the order is carried out, or every armed vehicle has confirmed; 9 when the flight refuses it.

    Examples: gcs tell avoid 560,480,30

    gcs tell home

    gcs tell hold

    gcs tell land --link udpin:127.0.0.1:14550
    """
    screen = Screen(json=json)
    if link:
        from gcs.cli.flights.vehicles import command_directly

        return command_directly(screen, " ".join(order), link, vehicles, listen, signing_key_file, backend)
    from gcs.flight.contingency.order_words import PLACES
    from gcs.flight.setup.order_socket import Told, newest_flying
    from gcs.flight.setup.order_socket import tell as tell_flight

    if degrees and order[0] not in PLACES:
        raise UsageError(f"--degrees: {order[0]} has no place", hint="leave it out")
    told = Told(tuple(order), shared.system_ids(vehicles), degrees)
    folder, answers = flight or newest_flying(to), []
    for text in tell_flight(folder, told):
        screen.say(text)
        answers.append(text)
    screen.result({"folder": folder, "order": " ".join(order), "answers": answers})
    return 0
