"""What a scenario is: the shape of `scenario.toml`, its units and its allowed ranges.

Knows: keys, types, ranges, and what must agree inside one table. Does not know: files, terrain heights,
plans, and what must agree between tables (that is `gcs.scenario.validation.cross_table`). Values stay as people write
them (metres up, degrees); `gcs.scenario.si` turns them into SI, NED and radians.
"""

from __future__ import annotations

import itertools
from typing import Annotated, Literal

import shapely
from pydantic import AfterValidator, Field

from gcs.autopilots.traits import AutopilotKey
from gcs.scenario.environment.heightmap import Relief
from gcs.scenario.schema.fields import (
    Findings,
    NonNegative,
    NonNegativeVector,
    Number,
    Part,
    Point,
    Positive,
    PositiveVector,
    Share,
    Truth,
    Vector,
)
from gcs.scenario.schema.formation_table import (
    START_SHAPE,
    ChangeTable,
    Formation,
    FormationVehicle,
    Generator,
    ShapeTable,
)

__all__ = [
    "START_SHAPE",
    "Boundary",
    "ChangeTable",
    "Dem",
    "Formation",
    "FormationVehicle",
    "Generator",
    "GroundPhases",
    "Judge",
    "LimitsTable",
    "MissionOptions",
    "Mountains",
    "NoFlyZone",
    "ObjectiveTable",
    "OriginTable",
    "Performance",
    "PlannedWind",
    "Power",
    "Range",
    "Relief",
    "Ripple",
    "Scenario",
    "SensorsTable",
    "ShapeTable",
    "TerminalWeight",
    "Terrain",
    "Time",
    "VehicleTable",
]

TerminalWeight = Literal["1", "t^2", "1/(tf-t+0.5)", "1/(tf-t+0.5)^2"]


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] >= pair[1]:
        raise ValueError("must be [low, high] with low < high")
    return pair


Range = Annotated[tuple[Number, Number], AfterValidator(_ordered)]


class OriginTable(Part):
    """Where the local frame lies on Earth."""

    lat_deg: Annotated[Number, Field(ge=-85, le=85)] = Field(description="WGS-84 latitude, degrees")
    lon_deg: Annotated[Number, Field(ge=-180, le=180)] = Field(description="WGS-84 longitude, degrees")
    alt_amsl_m: Annotated[Number, Field(ge=-500, le=9000)] = Field(
        description="altitude above mean sea level of height 0 in this file, m"
    )


class Time(Part):
    """Times of the planned flight."""

    flight_s: Annotated[Number, Field(gt=0, le=7200)] = Field(description="t_f, from start to end, s")
    free: Truth = Field(default=False, description="flight_s is only a reference: the planner chooses the time")
    earliest_s: Positive | None = Field(default=None, description="with free: the least time it may choose, s")
    latest_s: Annotated[Number, Field(gt=0, le=7200)] | None = Field(
        default=None, description="with free: the longest time it may choose, s"
    )

    def disagreements(self) -> Findings:
        """Bounds that are out of order."""
        if self.earliest_s is not None and self.latest_s is not None and self.earliest_s >= self.latest_s:
            yield ("latest_s",), f"must be later than earliest_s = {self.earliest_s:g}"


class Power(Part):
    """Where a vehicle's energy comes from and goes to."""

    battery_Wh: Positive = Field(description="energy of a full battery, nominal voltage times capacity, Wh")
    rotor_radius_m: Positive = Field(description="of a propeller, m")
    figure_of_merit: Annotated[Number, Field(gt=0, le=1)] = Field(
        description="ideal power of momentum theory over the power drawn: propeller, motor, speed controller"
    )


class VehicleTable(Part):
    """Table 1: one type of quadrotor."""

    name: str = Field(description="name of the type, for people")
    mass_kg: Positive = Field(description="m, kg")
    arm_m: Positive = Field(description="l, centre to rotor, m")
    inertia_kgm2: PositiveVector = Field(description="I_x, I_y, I_z, kg m^2")
    thrust_coeff_Ns2: Positive = Field(description="K_T, thrust of one rotor per squared speed, N s^2")
    moment_coeff_Nms2: Positive = Field(description="K_M, moment of one rotor per squared speed, N m s^2")
    drag_Nspm: NonNegativeVector = Field(description="K_1..K_3, linear drag north, east, down, N s/m")
    drag_moment_Nms: NonNegativeVector = Field(description="K_4..K_6, linear drag of the rates, N m s")
    gravity_mps2: Annotated[Number, Field(ge=9.7, le=9.9)] = Field(default=9.8, description="g, m/s^2")
    rotor_max_radps: Positive = Field(description="fastest a rotor turns, rad/s")
    power: Power | None = Field(
        default=None,
        description="battery and propellers; without them a flight's need is told by its time",
        exclude_if=lambda power: power is None,
    )


class Performance(Part):
    """What a type of vehicle can do, or may be asked to."""

    speed_ned_mps: PositiveVector = Field(description="largest speed along north, east, vertical, m/s")
    roll_pitch_yaw_deg: tuple[
        Annotated[Number, Field(gt=0, le=180)],
        Annotated[Number, Field(gt=0, lt=90)],
        Annotated[Number, Field(gt=0, le=360)],
    ] = Field(description="largest roll, pitch, yaw either way, degrees")
    rates_degps: PositiveVector = Field(description="largest roll, pitch, yaw rate either way, degrees/s")
    thrust_N: Annotated[tuple[NonNegative, Positive], AfterValidator(_ordered)] = Field(
        description="U_1, [low, high], N"
    )
    torque: PositiveVector = Field(description="largest |U_2|, |U_3| (N, on the arm) and |U_4| (N m)")
    load_factor_max: Positive = Field(description="n_max of Eq. 17, lateral acceleration in units of g")
    accel_max_mps2: Positive | None = Field(default=None, description="a_max, largest acceleration of a vehicle, m/s^2")
    control_margin: Share = Field(default=0.0, description="share of each control the plan keeps for feedback")


class LimitsTable(Performance):
    """Eq. 51 and the limits the paper names without a value; they hold for every vehicle."""

    north_m: Range = Field(description="[low, high], m north of the origin")
    east_m: Range = Field(description="[low, high], m east of the origin")
    height_m: Range = Field(description="[low, high], m above height 0")
    clearance_min_m: NonNegative = Field(description="h_min, least height above the ground, m")
    separation_min_m: Positive = Field(description="least distance between two planned vehicles, m")


class Ripple(Part):
    """Eq. 52: |sin(y + a) + b sin(x) + c cos(d r) + e cos(y) + f sin(g r)| m, of x north, y east and distance r, m."""

    a: Number = Field(description="phase of the wave east, rad")
    b: Number = Field(description="height of the wave north, m")
    c: Number = Field(description="height of the first rings around the origin, m")
    d: Number = Field(description="wave number of the first rings, rad/m")
    e: Number = Field(description="height of the second wave east, m")
    f: Number = Field(description="height of the second rings, m")
    g: Number = Field(description="wave number of the second rings, rad/m")


class Mountains(Part):
    """Eq. 53: one entry per mountain in every list."""

    north_m: tuple[Number, ...] = Field(default=(), description="summits, m north of the origin")
    east_m: tuple[Number, ...] = Field(default=(), description="summits, m east of the origin")
    height_m: tuple[Number, ...] = Field(default=(), description="summits, m above height 0")
    spread_north_m: tuple[Positive, ...] = Field(default=(), description="decay length north and south, m")
    spread_east_m: tuple[Positive, ...] = Field(default=(), description="decay length east and west, m")

    def disagreements(self) -> Findings:
        """Lists that are not equally long."""
        lengths = {key: len(getattr(self, key)) for key in type(self).model_fields}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{key} {length}" for key, length in lengths.items())
            yield (), f"lists must be equally long, one entry per mountain; lengths are {found}"


class Dem(Part):
    """An elevation model: heights above mean sea level in a file that GDAL reads, GeoTIFF or SRTM .hgt for example."""

    file: str = Field(description="path of the file, from the folder of this one")
    unit: Literal["m", "ft"] | None = Field(default=None, description="unit of its heights, where it does not say")


class Terrain(Part):
    """Ground height: the larger of ripple and sum of mountains, or an elevation model; without any flat at height 0."""

    ripple: Ripple | None = Field(default=None, description="Eq. 52; no ripple when left out")
    mountains: Mountains = Field(default=Mountains(), description="Eq. 53; no mountains when left out")
    dem: Dem | None = Field(default=None, description="an elevation model instead of formulas")
    relief: Relief | None = Field(default=None, description="what was read of the elevation model; not for writing")

    def disagreements(self) -> Findings:
        """An elevation model and formulas together."""
        if self.dem is not None and (self.ripple is not None or self.mountains.height_m):
            yield ("dem",), "is the ground already: leave out ripple and mountains"


class NoFlyZone(Part):
    """A closed area of any height: a disk (Eq. 21) or a polygon, that may move."""

    north_m: Number | None = Field(default=None, description="disk: centre, m north of the origin")
    east_m: Number | None = Field(default=None, description="disk: centre, m east of the origin")
    radius_m: Positive | None = Field(default=None, description="disk: R_j, m")
    polygon_m: tuple[Point, ...] | None = Field(
        default=None, description="polygon instead of a disk: its corners in order, [north, east], m"
    )
    moves: tuple[Vector, ...] = Field(
        default=(), description="displacement over time, straight in between: [t s, north m, east m], in order of time"
    )

    def disagreements(self) -> Findings:
        """Neither disk nor polygon, or both; corners that are no polygon; times out of order."""
        disk = {"north_m": self.north_m, "east_m": self.east_m, "radius_m": self.radius_m}
        lacking = [key for key, value in disk.items() if value is None]
        if self.polygon_m is None:
            for key in lacking:
                yield (key,), "missing: a disk has north_m, east_m and radius_m; the other kind is polygon_m"
        elif len(lacking) < len(disk):
            yield ("polygon_m",), f"and {next(k for k in disk if k not in lacking)}: a zone is a polygon or a disk"
        if self.polygon_m is not None:
            if len(self.polygon_m) < 3:
                yield ("polygon_m",), "has fewer than three corners"
            elif (shape := shapely.Polygon(self.polygon_m)) and not shape.is_valid:
                yield ("polygon_m",), f"crosses itself: {shapely.is_valid_reason(shape)} (north east)"
            elif shape.area <= 0.0:
                yield ("polygon_m",), "has no area: its corners are on one line"
        times = [move[0] for move in self.moves]
        if any(b <= a for a, b in itertools.pairwise(times)):
            yield ("moves",), "must be in order of time, each later than the one before"


class PlannedWind(Part):
    """Steady wind that plans take into account, and emulated vehicles meet."""

    speed_mps: Annotated[Number, Field(ge=0, le=30)] = Field(description="at height_m above height 0, m/s")
    from_deg: Annotated[Number, Field(ge=-360, le=360)] = Field(description="where it comes from, 90 is east, degrees")
    height_m: Positive = Field(default=10.0, description="reference height, m above height 0")
    shear: Annotated[Number, Field(ge=0, le=1)] = Field(
        default=0.0, description="exponent of the power law: 0 the same at every height, 0.14 over open land"
    )


class Boundary(Part):
    """Eqs. 15, 16: the leader's state at one end."""

    position_m: Vector = Field(description="north, east, height, m")
    velocity_mps: Vector = Field(description="north, east, up, m/s")
    roll_pitch_yaw_deg: Vector = Field(description="Euler angles, degrees; yaw 0 is north, 90 is east")


class ObjectiveTable(Part):
    """Eq. 35 with the reference of every term."""

    weights: NonNegativeVector = Field(description="a_1 energy, a_2 heading, a_3 height")
    time_weight: NonNegative = Field(default=0.0, description="cost of [time] flight_s seconds, where time is free")
    terminal_weight: TerminalWeight = Field(description="Q(t) of section 2.5.3")
    heading_ref_deg: Annotated[Number, Field(ge=-360, le=360)] = Field(
        description="psi_r, the heading asked for towards the end, degrees"
    )
    height_ref_m: Number = Field(description="h_r, the height asked for towards the end, m above height 0")
    drag_power_Ns2pm2: Positive = Field(description="k_f of Eq. 32, N s^2/m^2")
    heading_scale_deg: Positive = Field(description="one unit of the heading term, degrees")
    height_scale_m: Positive = Field(description="one unit of the height term, m")


class GroundPhases(Part):
    """What joins a trajectory that begins and ends in the air to the ground."""

    run_up_m: NonNegative = Field(description="distance from the first hover to the start, m")
    run_up_s: Positive = Field(description="time from the first hover to the start, s")
    takeoff_s: Positive = Field(description="time from the ground to the first hover, s")
    hover_s: NonNegative = Field(description="time of the hovers before the run-up and after the end, s")
    landing_s: Positive = Field(description="time from the last hover to the ground, s")


class MissionOptions(Part):
    """How the plan is turned into waypoints and setpoints."""

    autopilot: AutopilotKey = Field(
        default="ardupilot", description="for whom missions are written and timed, and whom emulated vehicles are like"
    )
    tolerance_m: Positive = Field(description="farthest from the plan that waypoints at its own speeds lead, m")
    setpoint_rate_hz: Annotated[Number, Field(ge=2, le=100)] = Field(description="setpoints per second to each vehicle")


class SensorsTable(Part):
    """What the emulated vehicles measure with."""

    grade: Literal["rtk", "gnss"] = Field(description="rtk errs by centimetres, gnss by metres")


class Judge(Part):
    """What the flight of emulated vehicles must hold; conflicts in any flight are judged by separation_min_m."""

    separation_min_m: Positive = Field(description="least true distance between two vehicles, m")
    arrival_time_s: Positive = Field(description="largest error of the arrival time, s")
    arrival_position_m: Positive = Field(description="largest position error at arrival, m")
    position_rms_m: Positive = Field(description="largest RMS position error of a vehicle, m")


class Scenario(Part):
    """One complete task: who flies, where, from what to what, under which limits."""

    schema_version: Literal[1] = Field(description="version of this file format")
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")] = Field(
        description="short name for files and folders"
    )
    title: str = Field(default="", description="one line for people")
    origin: OriginTable
    time: Time
    vehicle: VehicleTable
    limits: LimitsTable
    terrain: Terrain = Terrain()
    no_fly: tuple[NoFlyZone, ...] = ()
    wind: PlannedWind | None = None
    start: Boundary
    end: Boundary
    objective: ObjectiveTable
    formation: Formation
    ground_phases: GroundPhases
    mission: MissionOptions
    sensors: SensorsTable
    judge: Judge
