"""Tables and CSV files of the pads from which vehicles take off."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.cli.shared.console import Screen
from gcs.errors import UsageError
from gcs.util.atomic_write import atomic_write

if TYPE_CHECKING:
    from gcs.scenario.schema.scenario import Scenario
    from gcs.types import JsonObject
from gcs.cli.planning.plan_tables import say_rest, shown

_DIGITS = {"lat_deg": 7, "lon_deg": 7, "alt_amsl_m": 3, "north_m": 3, "east_m": 3}


def pads_of(scenario: Scenario) -> list[JsonObject]:
    """The take-off point of every vehicle."""
    from gcs.frames import ned_to_geodetic
    from gcs.scenario.values.si import local_origin, pads_ned_m, sysids

    pads = pads_ned_m(scenario)
    lat_deg, lon_deg, alt_m = ned_to_geodetic(pads, local_origin(scenario))
    values = zip(lat_deg, lon_deg, alt_m, pads[:, 0], pads[:, 1], strict=True)
    return [
        {"sysid": sysid}
        | {name: round(float(one), digits) for (name, digits), one in zip(_DIGITS.items(), row, strict=True)}
        for sysid, row in zip(sysids(scenario), values, strict=True)
    ]


def say_pads(screen: Screen, pads: list[JsonObject]) -> None:
    """Print the table."""
    from rich.table import Table

    table = Table("vehicle", "latitude", "longitude", "altitude AMSL", "north, east", title="pads")
    for pad in pads[: shown(screen)]:
        place = f"{pad['north_m']:.2f}, {pad['east_m']:.2f} m"
        table.add_row(
            str(pad["sysid"]), f"{pad['lat_deg']:.7f}", f"{pad['lon_deg']:.7f}", f"{pad['alt_amsl_m']:.2f} m", place
        )
    screen.show(table)
    say_rest(screen, len(pads), f"--pads pads.csv writes all {len(pads)}")


def refuse_no_csv(path: Path) -> None:
    """Raises UsageError for a file name that spreadsheets do not open as CSV."""
    if path.suffix.lower() != ".csv":
        raise UsageError(f"--pads {path}: pads are written as CSV", hint=f"write --pads {path.with_suffix('.csv')}")


def write_pads(pads: list[JsonObject], path: Path) -> None:
    """Write all pads as CSV, one row for each vehicle. Raises UsageError where that is impossible."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["sysid", *_DIGITS])
    writer.writerows([pad["sysid"], *(f"{pad[name]:.{digits}f}" for name, digits in _DIGITS.items())] for pad in pads)
    try:
        atomic_write(path, text.getvalue().encode())
    except OSError as problem:
        raise UsageError(f"{path} cannot be written: {problem.strerror or problem}.") from None
