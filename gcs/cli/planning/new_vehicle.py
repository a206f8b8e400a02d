"""`gcs new-vehicle`: write a vehicle file, estimated from mass, propellers and battery."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.autopilots.traits import Autopilot
from gcs.cli.shared.console import Screen
from gcs.cli.shared.shared_options import DebugOption, JsonOption, argument, as_share, option, within
from gcs.errors import UsageError

_MM_M, _INCH_M = 1e-3, 0.0254


def new_vehicle(
    file: Annotated[Path, argument("Vehicle file to write. Its name is the type's.", "FILE.toml")],
    mass: Annotated[float, option("Mass with the battery.", metavar="KG", shown=False, limits=(0.02, 100.0, "kg"))],
    propeller: Annotated[
        float, option("Diameter of a propeller.", metavar="INCHES", shown=False, limits=(1.0, 40.0, "inches"))
    ],
    battery: Annotated[str, typer.Option(metavar="BATTERY", help="Cells and capacity, 4S 3300mAh, or energy, 48.8Wh.")],
    size: Annotated[
        float | None,
        option(
            "Distance from motor to motor, diagonally.",
            metavar="MM",
            shown="1.75 propeller diameters",
            limits=(40.0, 3000.0, "mm"),
        ),
    ] = None,
    hover_throttle: Annotated[
        str | None,
        option("Throttle in hover, as the autopilot learned it: 35% or 0.35.", metavar="SHARE", shown="50%"),
    ] = None,
    hover_power: Annotated[
        float | None,
        option(
            "Measured power of the battery in hover.",
            metavar="W",
            shown="momentum theory",
            limits=(1.0, 50_000.0, "W"),
        ),
    ] = None,
    autopilot: Annotated[
        str | None,
        option(
            "Its autopilot.",
            metavar="AUTOPILOT",
            shown="the scenario's",
            words=tuple(known.key for known in Autopilot),
        ),
    ] = None,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Write a vehicle file for scenarios, estimated from mass, propellers, size, hover throttle and battery.

    Every estimate in the file says from what it is and how far off it may be, and which number of a flight's log is
    better. `vehicle_type` in a scenario names the file, and so does --vehicle of `gcs new`.

    Examples: gcs new-vehicle five.toml --mass 1.2 --propeller 5 --battery "4S 3300mAh"

    gcs new-vehicle x500.toml --mass 1.5 --size 500 --propeller 10 --battery 4S5000 --hover-throttle 29%

    gcs new-vehicle five.toml --mass 1.2 --propeller 5 --battery 48.8Wh --hover-power 380 --autopilot px4
    """
    screen = Screen(json=json)
    throttle = None
    if hover_throttle is not None:
        throttle = within("--hover-throttle", as_share(hover_throttle), 0.1, 0.75, "of full throttle")
    from gcs.scenario.sources.vehicle_estimate import KnownVehicle, parse_battery, vehicle_text
    from gcs.util.atomic_write import atomic_write

    if file.exists():
        raise UsageError(f"{file} exists already.", hint="choose another name, or delete the file first")
    known = KnownVehicle(
        mass,
        round(0.5 * _INCH_M * propeller, 5),
        parse_battery(battery),
        None if size is None else round(0.5 * _MM_M * size, 5),
        throttle,
        hover_power,
        autopilot,
    )
    atomic_write(file, vehicle_text(file.stem, known))
    low_min, high_min = (hover_s / 60.0 for hover_s in known.hover_s)
    hovers = f"{low_min:.0f}" if round(low_min) == round(high_min) else f"{low_min:.0f} to {high_min:.0f}"
    screen.say(f"wrote {file}: a full battery hovers for {hovers} minutes")
    screen.say(f"next: gcs new plans/first --vehicle {file}")
    screen.result({"vehicle": file, "hover_min": [round(low_min, 1), round(high_min, 1)]})
