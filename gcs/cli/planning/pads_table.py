"""The pads of `gcs show`: the take-off point of every vehicle, as a table and as a file for the crew."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.cli.console import Screen
from gcs.errors import UsageError
from gcs.files import atomic_write

if TYPE_CHECKING:
    from gcs.scenario.schema.scenario import Scenario

SHOWN = 20  # vehicles of a table on a terminal; a pipe or a file gets all
_DIGITS = {"lat_deg": 7, "lon_deg": 7, "alt_amsl_m": 3, "north_m": 3, "east_m": 3}


def pads_of(scenario: Scenario) -> list[dict[str, Any]]:
    """The take-off point of every vehicle."""
    from gcs.frames import ned_to_geodetic
    from gcs.scenario.si import local_origin, pads_ned_m, sysids

    pads = pads_ned_m(scenario)
    lat_deg, lon_deg, alt_m = ned_to_geodetic(pads, local_origin(scenario))
    values = zip(lat_deg, lon_deg, alt_m, pads[:, 0], pads[:, 1], strict=True)
    return [
        {"sysid": sysid}
        | {name: round(float(one), digits) for (name, digits), one in zip(_DIGITS.items(), row, strict=True)}
        for sysid, row in zip(sysids(scenario), values, strict=True)
    ]


def say_pads(screen: Screen, pads: list[dict[str, Any]]) -> None:
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


def shown(screen: Screen) -> int | None:
    """How many vehicles a table has; None for all."""
    return SHOWN if screen.console.is_terminal else None


def say_rest(screen: Screen, count: int, how: str) -> None:
    """Print how many vehicles a table leaves out, and how to see them."""
    if shown(screen) is not None and count > SHOWN:
        screen.say(f"and {count - SHOWN} more: {how}")


def refuse_no_csv(path: Path) -> None:
    """Raises UsageError for a file name that spreadsheets do not open as CSV."""
    if path.suffix.lower() != ".csv":
        raise UsageError(f"--pads {path}: pads are written as CSV", hint=f"write --pads {path.with_suffix('.csv')}")


def write_pads(pads: list[dict[str, Any]], path: Path) -> None:
    """Write all pads as CSV, one row for each vehicle. Raises UsageError where that is impossible."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["sysid", *_DIGITS])
    writer.writerows([pad["sysid"], *(f"{pad[name]:.{digits}f}" for name, digits in _DIGITS.items())] for pad in pads)
    try:
        atomic_write(path, text.getvalue().encode())
    except OSError as problem:
        raise UsageError(f"{path} cannot be written: {problem.strerror or problem}.") from None
