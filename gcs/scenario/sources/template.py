"""The text of a first scenario: a short one, or one with every table."""

import json
import math
import os
import re
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import ClassVar, Protocol, Self, get_args

import numpy as np
from scipy.spatial import KDTree

from gcs.errors import UsageError
from gcs.frames import Origin, place_up_m
from gcs.scenario.schema.formation_table import Generator
from gcs.scenario.schema.mistake import Mistake, Mistaken, degrees
from gcs.scenario.schema.scenario import OriginTable, Performance, Scenario
from gcs.scenario.schema.vehicle_types import KEY, presets
from gcs.scenario.sources.bundled_missions import FILE_NAME
from gcs.scenario.sources.flight_margins import (
    BETTER_SENSORS,
    GNSS_APART_M,
    HOVERS_S,
    VEHICLE_TYPE,
    fastest_mps,
    ground_phases_s,
    type_limits,
)
from gcs.scenario.sources.load import load_scenario, load_vehicle
from gcs.scenario.validation.to_metres import question
from gcs.scenario.values.battery_estimate import BatteryEstimate, battery_estimate
from gcs.scenario.values.formations import places_up_m, turned
from gcs.scenario.values.navigation_error import vehicle_size_m
from gcs.scenario.values.si import offsets_ned_m
from gcs.types import Array

FORMATION = "FORMATION"
SHAPES: tuple[Generator, ...] = get_args(Generator)
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
_LONGEST_M = 20_000.0
_COMMENTS_AT = 30  # column of comments
_BESIDE_M, _BESIDE_SHARE = 100.0, 0.3  # room beside the straight way, for detours: at least, and of its length
_PACE_SPM = 0.3  # at rest at both ends
_LEAST_S, _ENDS_S = 30.0, 5.0  # of a flight; for its beginning and end at rest
_ROUND_M = 10.0  # of a length that is proposed
_NO_FLY = """[[no_fly]]@@  # as many as you like
north_m = @NORTH@
east_m = @EAST@
radius_m = @RADIUS@               # or polygon_m = [[north, east], ...]
# moves = [[0.0, 0.0, 0.0], [90.0, 0.0, 20.0]]  # displacement: [t s, north m, east m]
"""


class ImpossibleFlight(UsageError):
    """A flight that the rules of scenarios refuse, with its mistakes; `reason` names the keys of the scenario."""

    def __init__(self, message: str, *, hint: str = "", reason: str = "", mistakes: Sequence[Mistake] = ()) -> None:
        super().__init__(message, hint=hint, reason=reason)
        self.mistakes = mistakes


class Flight(Protocol):
    """A flight that can be written as a scenario."""

    # Whether somebody drew where it leads. Then it is written whatever battery it needs, and that is told.
    is_drawn: ClassVar[bool]

    def keys(self) -> dict[str, str]:
        """What stands in the template for each @KEY@; FORMATION replaces the table [formation] and what follows."""

    def quicker(self) -> Self | None:
        """The same flight as fast as it can be planned; None where nothing is left to choose."""

    def fitting(self, longest_s: float) -> str:
        """What to give in its place, where a battery is enough for `longest_s` from take-off to touch-down."""


@dataclass(frozen=True)
class FirstFlight:
    """A straight flight from the origin: `count` vehicles in a shape that faces the course, from hover to hover."""

    is_drawn: ClassVar[bool] = False
    count: int = 6
    shape: Generator = "vee"
    spacing_m: float = 10.0
    course_deg: float = 0.0
    distance_m: float = 300.0
    height_m: float = 15.0
    end_deg: tuple[float, float] | None = None  # latitude and longitude of the end, to be written as they were given
    pace_spm: float = _PACE_SPM
    limits: Performance = field(default_factory=type_limits)  # of the vehicles

    @property
    def flight_s(self) -> float:
        """From start to end, s."""
        pace_spm = max(self.pace_spm, 1.0 / fastest_mps(self.limits))
        ends_s = 0.0 if pace_spm == _PACE_SPM else _ENDS_S
        return max(_LEAST_S, 5.0 * math.ceil((pace_spm * self.distance_m + ends_s) / 5.0))

    @property
    def phases_s(self) -> tuple[float, float]:
        """Take-off and landing, s."""
        highest_m = float(places_up_m(self.shape, self.count, self.spacing_m)[:, 2].max())
        return ground_phases_s(self.limits, self.height_m + highest_m)

    @property
    def separation_m(self) -> float:
        """Half the spacing, at most 5 m; less where vehicles above each other have their pads nearer."""
        if self.count == 1:
            return 5.0
        return max(0.01, math.floor(100.0 * min(5.0, self.spacing_m / 2.0, 0.9 * self._pads_m)) / 100.0)

    @property
    def _pads_m(self) -> float:
        """The least distance of two pads; infinite for a single vehicle."""
        places_m = places_up_m(self.shape, self.count, self.spacing_m)[:, :2]
        return float(KDTree(places_m).query(places_m, k=2)[0][:, 1].min())

    def quicker(self) -> Self | None:
        """The same flight as fast as it can be planned; None where it is."""
        faster = replace(self, pace_spm=1.0 / fastest_mps(self.limits))
        return faster if faster.flight_s < self.flight_s else None

    def fitting(self, longest_s: float) -> str:
        """What to give in its place, where a battery is enough for `longest_s` from take-off to touch-down."""
        on_ground_s = sum(self.phases_s) + HOVERS_S
        length_m = (longest_s - on_ground_s - _ENDS_S) * fastest_mps(self.limits)
        if longest_s >= on_ground_s + _LEAST_S and length_m >= _ROUND_M:
            option = f"an --end {_down(length_m)} m away" if self.end_deg else f"--distance {_down(length_m)}"
            return f"give {option} or less, and fly the rest as a second flight"
        # Lower as well as shorter, where a lower flight of this length is too long.
        shorter = self.flight_s > longest_s - HOVERS_S - _LEAST_S
        air_s = longest_s - HOVERS_S - (_LEAST_S if shorter else self.flight_s)
        height_m = _down(self.height_m * air_s / sum(self.phases_s))
        also = f" and --distance {_LEAST_S * fastest_mps(self.limits) / 2.0:.0f} or less" if shorter else ""
        return f"give --height {height_m} or less{also}: take-off and landing take {on_ground_s:.0f} s"

    def keys(self) -> dict[str, str]:
        """What stands in the template for each @KEY@."""
        course = math.radians(self.course_deg)
        end_ne_m = np.round(self.distance_m * np.array([math.cos(course), math.sin(course)]), 2) + 0.0
        places_m = turned(places_up_m(self.shape, self.count, self.spacing_m), self.course_deg)
        top_m = self.height_m + float(places_m[:, 2].max())
        yaw_deg = round(180.0 - (180.0 - self.course_deg) % 360.0, 6)
        start, end = [0.0, 0.0, self.height_m], [*end_ne_m.tolist(), self.height_m]
        is_default = replace(self, limits=type_limits()) == FirstFlight()
        middle, radius_m = (end_ne_m / 2.0).round(1).tolist(), max(1.0, float(round(self.distance_m / 10.0)))
        no_fly = [*middle, radius_m] if not is_default else [150.0, 60.0, 50.0]
        north_m, east_m = self._box(places_m[:, :2], end_ne_m) if not is_default else ([-60, 360], [-120, 120])
        attitude = f", roll_pitch_yaw_deg = [0.0, 0.0, {yaw_deg!r}]" if yaw_deg else ""
        zone = f"no_fly = [{{ north_m = {no_fly[0]}, east_m = {no_fly[1]}, radius_m = {no_fly[2]!r} }}]"
        start_line = f"start = {{ position_m = {start}{attitude} }}"
        end_keys = [f"position_m = {end}"]
        if self.end_deg is not None:
            end_keys = [f"position_deg = {list(self.end_deg)}", f"height_m = {self.height_m!r}"]
        end_line = f"end = {{ {', '.join(end_keys)}{attitude} }}"
        takeoff_s, _ = self.phases_s
        sensors = f"\n{BETTER_SENSORS}" if self._pads_m < GNSS_APART_M else ""
        end_line += f"\nground_phases = {{ takeoff_s = {takeoff_s} }}{sensors}"
        who, shaped = self._who, f" in a {self.shape}" if self.count > 1 else ""  # one vehicle is in no formation
        way = "from one hover to another" + (", past a no-fly zone" if is_default else "")
        return {
            "TITLE": f"{who}{shaped}",
            "SENTENCE": f"{who.capitalize()} {'fly' if self.count > 1 else 'flies'}{shaped} {way}.",
            "FLIGHT": repr(self.flight_s),
            "START": start_line.ljust(59) if is_default else f"{start_line}  ",
            "END": end_line,
            "START_PLACE": str(start),
            "END_KEYS": "\n".join(end_keys),
            "YAW": repr(yaw_deg),
            "ATTITUDE": attitude,
            "HEIGHT": repr(self.height_m),
            "NO_FLY": zone if is_default else f"# {zone}",
            "NO_FLY_TABLE": _table(no_fly, commented=not is_default),
            "BOX_NORTH": str([float(v) for v in north_m]),
            "BOX_EAST": str([float(v) for v in east_m]),
            "BOX_HEIGHT": str([0.0, max(40.0, 10.0 * math.ceil(top_m / 10.0 + 1.5))]),
            "CLEARANCE": repr(min(5.0, self.height_m / 2.0)),
            "SEPARATION": repr(self.separation_m),
            "COUNT": str(self.count),
            "SHAPE": self.shape,
            "SPACING": repr(self.spacing_m),
            "HEADING": f", heading_deg = {yaw_deg!r}" if yaw_deg else "",
            "HEADING_LINE": f"heading_deg = {yaw_deg!r}\n" if yaw_deg else "",
            "OTHERS": ", ".join(name for name in SHAPES if name != self.shape),
            "TAKEOFF": repr(takeoff_s),
            "SENSORS": sensors,
            "GRADE": "rtk" if sensors else "gnss",
        }

    @property
    def _who(self) -> str:
        count = _NUMBERS[self.count] if self.count < len(_NUMBERS) else str(self.count)
        return f"{count} quadrotor{'s' * (self.count > 1)}"

    def _box(self, offsets_ne_m: Array, end_ne_m: Array) -> tuple[list[float], ...]:
        """The least and the greatest place north and east, with room for detours."""
        flown = np.concatenate([offsets_ne_m, offsets_ne_m + end_ne_m])
        room_m = max(_BESIDE_M, _BESIDE_SHARE * self.distance_m)
        low, high = flown.min(axis=0) - room_m, flown.max(axis=0) + room_m
        return tuple([10.0 * math.floor(a / 10.0), 10.0 * math.ceil(b / 10.0)] for a, b in zip(low, high, strict=True))


def straight_to(end_deg: tuple[float, float], origin_deg: tuple[float, float]) -> dict[str, float]:
    """The course and the length of a flight from the origin to a place. Raises UsageError for one that is far away."""
    origin = Origin(*origin_deg, 0.0)
    option = f"--end {degrees(end_deg[0])},{degrees(end_deg[1])}"
    if asked := question(end_deg, origin):
        meant = asked.degrees and f"write --end {degrees(asked.degrees[0])},{degrees(asked.degrees[1])}"
        raise UsageError(f"{option}: {asked.text}", hint=meant or "give the origin too: --at LAT,LON[,ALT]")
    north_m, east_m, _ = place_up_m(*end_deg, 0.0, origin)
    distance_m = float(np.hypot(north_m, east_m))
    if not 1.0 <= distance_m <= _LONGEST_M:
        text = f"{option} is {distance_m:,.0f} m from the origin"
        raise UsageError(f"{text}; a flight is 1 to {_LONGEST_M:,.0f} m long.", hint="give another place, or --at")
    return {"course_deg": round(float(np.degrees(np.arctan2(east_m, north_m))), 1), "distance_m": distance_m}


def scenario_text(
    folder: Path,
    origin: Origin,
    *,
    full: bool = False,
    flight: Flight | None = None,
    template: str = "template.toml",
    vehicle: str | None = None,
) -> str:
    """The text of a scenario named after its folder, with this origin; `full` has every table, commented.

    `template` is the text that is filled otherwise: "template_route.toml" has points between start and end. A flight is
    judged with the limits and the battery of `vehicle`, a preset or a vehicle file, which `flown_by` writes.

    A flight for which a battery is not enough is written as its quicker one. Raises UsageError for a folder whose name
    cannot be a scenario's, for a place out of range, and for a `flight` that no scenario allows, or no battery where
    nobody drew it.
    """
    name = folder.resolve().name
    pattern = next(m.pattern for m in Scenario.model_fields["name"].metadata if hasattr(m, "pattern"))
    if not re.match(pattern, name):
        message = f'"{name}" cannot be the name of a scenario.'
        raise UsageError(message, hint="use small letters, digits, - and _; begin with a letter or a digit")
    try:
        OriginTable(**asdict(origin))
    except ValueError:
        raise UsageError(
            f"--at {origin.lat_deg:g} {origin.lon_deg:g} {origin.alt_amsl_m:g}: out of range.",
            hint="give latitude (-85 to 85), longitude (-180 to 180) and height above the sea (-500 to 9000 m)",
        ) from None
    text = _template("template_full.toml" if full else template)
    lat, lon, alt = map(repr, astuple(origin))
    filled = {"NAME": name, "FOLDER": str(folder), "LAT": lat, "LON": lon, "ALT": alt}
    if flight is None:
        return _written(text, filled | FirstFlight().keys())
    kind = VEHICLE_TYPE if vehicle is None else vehicle

    def judged(written: str) -> BatteryEstimate:
        return battery_estimate(_flown(written, vehicle))

    made = _written(text, filled | flight.keys())
    need = judged(made)
    if not need.is_enough and (quicker := flight.quicker()) is not None:
        flight, made = quicker, _written(text, filled | quicker.keys())
        need = judged(made)
    if not need.is_enough and not flight.is_drawn:
        asks = f"the flight takes {need.whole_s:.0f} s from take-off to touch-down, about {need.share:.0%} of a battery"
        most = f"one of {kind} lasts {need.longest_s:.0f} s, with {1.0 - need.usable:.0%} of it in reserve"
        raise UsageError(f"{asks}; {most}", hint=flight.fitting(need.longest_s))
    return made


def draft(flight: Flight, vehicle: str | None = None) -> Scenario:
    """The scenario of a flight at no particular place, whatever battery it needs. Raises UsageError as above."""
    filled = {"NAME": "draft", "FOLDER": "draft", "LAT": "0.0", "LON": "0.0", "ALT": "0.0"}
    return _flown(_written(_template("template.toml"), filled | flight.keys()), vehicle)


def _flown(text: str, vehicle: str | None) -> Scenario:
    return possible_scenario(text if vehicle is None else _of_type(text, _found(vehicle)))


def _template(file: str) -> str:
    return (files("gcs.scenario.sources") / file).read_text(encoding="utf-8")


def _down(length_m: float) -> int:
    """A length that is a little less, in round metres."""
    return int(_ROUND_M * (0.98 * length_m // _ROUND_M))


def _written(template: str, filled: dict[str, str]) -> str:
    """A template with its values."""
    text, table, formation = template.partition("[formation]")
    text += filled[FORMATION] if FORMATION in filled else table + formation
    text = "\n".join(filled_line(line, filled) for line in text.split("\n"))
    tomllib.loads(text)
    return text


def flown_by(text: str, vehicle: str, folder: Path) -> str:
    """The text of a scenario in `folder` whose vehicles are of a preset, or of a vehicle file.

    Raises ScenarioError for a file with mistakes, UsageError for a vehicle that cannot fly the scenario.
    """
    if vehicle in presets():
        return _of_type(text, vehicle)
    possible_scenario(_of_type(text, _found(vehicle)))
    return _of_type(text, Path(os.path.relpath(vehicle, folder)).as_posix())


def named_beside(text: str, file: Path, folder: Path) -> str:
    """The text of a scenario in `folder` with the path of a file from there, in place of its absolute path."""
    absolute, beside = file.resolve().as_posix(), Path(os.path.relpath(file, folder)).as_posix()
    return text.replace(json.dumps(absolute, ensure_ascii=False), json.dumps(beside, ensure_ascii=False), 1)


def _found(vehicle: str) -> str:
    """A vehicle type as a scenario in any folder names it. Raises ScenarioError for a file with mistakes."""
    if vehicle in presets():
        return vehicle
    load_vehicle(Path(vehicle))
    return Path(vehicle).resolve().as_posix()


def _of_type(text: str, name: str) -> str:
    line = f"{KEY} = {json.dumps(name, ensure_ascii=False)}"
    return re.sub(rf"^{KEY} = .*$", lambda _: line, text, count=1, flags=re.MULTILINE)


def filled_line(line: str, keys: dict[str, str], comments_at: int = _COMMENTS_AT) -> str:
    """A line of the template with its values, and its comment where comments stand."""
    if "@" not in line:
        return line
    code, mark, comment = line.partition("  #")
    code, comment = (re.sub(r"@(\w*)@", lambda found: keys.get(found[1], ""), part) for part in (code, comment))
    if not mark:
        return code
    return f"{code.rstrip().ljust(comments_at - 2)}  #{comment.lstrip('#')}"


def _table(zone: list[float], *, commented: bool) -> str:
    values = dict(zip(("NORTH", "EAST", "RADIUS"), map(repr, zone), strict=True))
    lines = [filled_line(line, values, _COMMENTS_AT - 2 * commented) for line in _NO_FLY.split("\n")]
    return "\n".join(f"# {line}" if commented and line and not line.startswith("#") else line for line in lines)


def possible_scenario(text: str) -> Scenario:
    """The scenario of a text. Raises UsageError for one that its own rules refuse."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / FILE_NAME
        file.write_text(text, encoding="utf-8")
        try:
            scenario = load_scenario(file)
        except Mistaken as found:
            text = f"such a flight is not possible: {found.reason}"
            hint = "give other numbers"
            raise ImpossibleFlight(text, hint=hint, reason=found.reason, mistakes=found.mistakes) from None
    places, size_m = offsets_ned_m(scenario), vehicle_size_m(scenario.vehicle)
    for points, where in ((places, "be"), (places[:, :2], "take off")):
        apart_m = float(KDTree(points).query(points, k=2)[0][:, 1].min())  # infinite for a single vehicle
        if apart_m < size_m:
            message = f"such a flight is not possible: vehicles of {size_m:.2f} m would {where} {apart_m:.3g} m apart"
            raise UsageError(message, hint="give a greater --spacing")
    return scenario
