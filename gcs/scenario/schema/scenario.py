"""The tables of `scenario.toml`: keys, units, ranges, defaults, and the rules inside one table.

Rules between tables are in `gcs.scenario.validation.cross_table`. Values stay as the file has them (metres up,
degrees); `gcs.scenario.si` converts them to SI, NED and radians.
"""

from __future__ import annotations

import itertools
from typing import Annotated, Literal

import shapely
from pydantic import Field

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
from gcs.scenario.schema.limits_table import ROLL_PITCH_KEYS, LimitsTable, Performance, Range
from gcs.scenario.schema.preflight_table import PreflightTable

__all__ = [
    "ROLL_PITCH_KEYS",
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
    "PreflightTable",
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


PhaseLength = Annotated[Number, Field(gt=0, le=3600)]
HoverLength = Annotated[Number, Field(ge=0, le=3600)]


class OriginTable(Part):
    """The point on Earth that is (0, 0, 0) of the local frame."""

    lat_deg: Annotated[Number, Field(ge=-85, le=85)] = Field(description="WGS-84 latitude, degrees")
    lon_deg: Annotated[Number, Field(ge=-180, le=180)] = Field(description="WGS-84 longitude, degrees")
    alt_amsl_m: Annotated[Number, Field(ge=-500, le=9000)] = Field(
        description="altitude above mean sea level of height 0 in this file, m"
    )


class Time(Part):
    """Duration of the planned flight, without take-off and landing."""

    flight_s: Annotated[Number, Field(gt=0, le=7200)] = Field(description="t_f, from start to end, s")
    free: Truth = Field(default=False, description="the planner chooses the time; flight_s is then only its reference")
    earliest_s: Positive | None = Field(default=None, description="with free: least time the planner may choose, s")
    latest_s: Annotated[Number, Field(gt=0, le=7200)] | None = Field(
        default=None, description="with free: longest time the planner may choose, s"
    )

    def disagreements(self) -> Findings:
        """Yield bounds that are out of order."""
        if self.earliest_s is not None and self.latest_s is not None and self.earliest_s >= self.latest_s:
            yield ("latest_s",), f"must be more than earliest_s = {self.earliest_s:g}"


class Power(Part):
    """The battery and the propellers, for the energy a flight takes."""

    battery_Wh: Positive = Field(description="energy of a full battery, nominal voltage times capacity, Wh")
    battery_V: Positive | None = Field(
        default=None,
        description="nominal voltage of the battery, V; left out: 3.7 V for each cell of the reported voltage",
        exclude_if=lambda volt: volt is None,
    )
    rotor_radius_m: Positive = Field(description="radius of a propeller, m")
    figure_of_merit: Annotated[Number, Field(gt=0, le=1)] = Field(
        description="ideal power of momentum theory over the power drawn: propeller, motor, speed controller"
    )


class VehicleTable(Part):
    """One type of quadrotor: the constants of the paper's Table 1."""

    name: str = Field(description="name of the type, as reports show it")
    mass_kg: Positive = Field(description="m, kg")
    arm_m: Positive = Field(description="l, centre to rotor, m")
    inertia_kgm2: PositiveVector = Field(description="I_x, I_y, I_z, kg m^2")
    thrust_coeff_Ns2: Positive = Field(description="K_T, thrust of one rotor per squared speed, N s^2")
    moment_coeff_Nms2: Positive = Field(description="K_M, moment of one rotor per squared speed, N m s^2")
    drag_Nspm: NonNegativeVector = Field(description="K_1..K_3, linear drag north, east, down, N s/m")
    drag_moment_Nms: NonNegativeVector = Field(description="K_4..K_6, linear drag of the rates, N m s")
    gravity_mps2: Annotated[Number, Field(ge=9.7, le=9.9)] = Field(default=9.8, description="g, m/s^2")
    rotor_max_radps: Positive = Field(description="largest rotor speed, rad/s")
    power: Power | None = Field(
        default=None,
        description="battery and propellers; without them the battery's need is estimated from the flight time",
        exclude_if=lambda power: power is None,
    )


class Ripple(Part):
    """Eq. 52: |sin(y + a) + b sin(x) + c cos(d r) + e cos(y) + f sin(g r)|; x north, y east, r distance, m."""

    a: Number = Field(description="phase of the wave east, rad")
    b: Number = Field(description="height of the wave north, m")
    c: Number = Field(description="height of the first rings around the origin, m")
    d: Number = Field(description="wave number of the first rings, rad/m")
    e: Number = Field(description="height of the second wave east, m")
    f: Number = Field(description="height of the second rings, m")
    g: Number = Field(description="wave number of the second rings, rad/m")


class Mountains(Part):
    """The mountains of Eq. 53: one entry per mountain in every list."""

    north_m: tuple[Number, ...] = Field(default=(), description="summits, m north of the origin")
    east_m: tuple[Number, ...] = Field(default=(), description="summits, m east of the origin")
    height_m: tuple[Number, ...] = Field(default=(), description="summits, m above height 0")
    spread_north_m: tuple[Positive, ...] = Field(default=(), description="decay length north and south, m")
    spread_east_m: tuple[Positive, ...] = Field(default=(), description="decay length east and west, m")

    def disagreements(self) -> Findings:
        """Yield lists of unequal length."""
        lengths = {key: len(getattr(self, key)) for key in type(self).model_fields}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{key} {length}" for key, length in lengths.items())
            yield (
                (),
                f"lists must be equally long, one entry per mountain; lengths are {found}. Complete the short ones",
            )


class Dem(Part):
    """An elevation model: heights above mean sea level, in a file that GDAL reads (GeoTIFF, SRTM .hgt)."""

    file: str = Field(description="path of the file, relative to the scenario's folder")
    unit: Literal["m", "ft"] | None = Field(
        default=None, description="unit of its heights, where the file does not name one"
    )


class Terrain(Part):
    """The ground: the larger of ripple and sum of mountains, or an elevation model. Left out: level, at height 0."""

    ripple: Ripple | None = Field(default=None, description="Eq. 52; left out: no ripple")
    mountains: Mountains = Field(default=Mountains(), description="Eq. 53; left out: no mountains")
    dem: Dem | None = Field(default=None, description="an elevation model instead of formulas")
    relief: Relief | None = Field(
        default=None, description="the heights read from the elevation model; the program writes it"
    )

    def disagreements(self) -> Findings:
        """Yield an elevation model that stands beside formulas."""
        if self.dem is not None and (self.ripple is not None or self.mountains.height_m):
            yield ("dem",), "is the whole ground. Remove ripple and mountains, or remove [terrain.dem]"


class NoFlyZone(Part):
    """A no-fly zone of unlimited height: a disk (Eq. 21) or a polygon. It may move."""

    north_m: Number | None = Field(default=None, description="disk: centre, m north of the origin")
    east_m: Number | None = Field(default=None, description="disk: centre, m east of the origin")
    radius_m: Positive | None = Field(default=None, description="disk: R_j, m")
    polygon_m: tuple[Point, ...] | None = Field(
        default=None, description="polygon, instead of a disk: its corners in order, [north, east], m"
    )
    moves: tuple[Vector, ...] = Field(
        default=(), description="displacement over time, linear in between: [t s, north m, east m], in order of time"
    )

    def disagreements(self) -> Findings:
        """Yield a zone that is not exactly one of disk and polygon, bad corners, and times out of order."""
        disk = {"north_m": self.north_m, "east_m": self.east_m, "radius_m": self.radius_m}
        lacking = [key for key, value in disk.items() if value is None]
        if self.polygon_m is None:
            for key in lacking:
                yield (key,), "missing; a disk needs north_m, east_m and radius_m. Give it, or give polygon_m"
        elif len(lacking) < len(disk):
            yield (
                ("polygon_m",),
                f"stands beside {next(k for k in disk if k not in lacking)}. Keep the polygon or the disk",
            )
        if self.polygon_m is not None:
            if len(self.polygon_m) < 3:
                yield ("polygon_m",), f"has {len(self.polygon_m)} corners; a polygon needs at least 3"
            elif (shape := shapely.Polygon(self.polygon_m)) and not shape.is_valid:
                yield (
                    ("polygon_m",),
                    f"crosses itself: {shapely.is_valid_reason(shape)} (north east). Give the corners in order",
                )
            elif shape.area <= 0.0:
                yield ("polygon_m",), "has no area: its corners are on one line. Move a corner"
        times = [move[0] for move in self.moves]
        if any(b <= a for a, b in itertools.pairwise(times)):
            yield ("moves",), "must be in order of time. Make each time later than the one before"


class PlannedWind(Part):
    """The steady wind that the planner takes into account and that emulated vehicles fly in."""

    speed_mps: Annotated[Number, Field(ge=0, le=30)] = Field(description="wind speed at height_m, m/s")
    from_deg: Annotated[Number, Field(ge=-360, le=360)] = Field(
        description="direction the wind comes from, 90 is east, degrees"
    )
    height_m: Positive = Field(default=10.0, description="reference height, m above height 0")
    shear: Annotated[Number, Field(ge=0, le=1)] = Field(
        default=0.0, description="exponent of the power law: 0 is the same wind at every height, 0.14 is open land"
    )


class Boundary(Part):
    """The leader's state at one end of the flight (Eqs. 15, 16)."""

    position_m: Vector = Field(description="north, east, height, m")
    velocity_mps: Vector = Field(default=(0.0, 0.0, 0.0), description="north, east, up, m/s")
    roll_pitch_yaw_deg: Vector = Field(
        default=(0.0, 0.0, 0.0), description="Euler angles, degrees; yaw 0 is north, 90 is east"
    )


class ObjectiveTable(Part):
    """The cost of a flight (Eq. 35): its weights, and the reference and unit of every term."""

    weights: NonNegativeVector = Field(default=(0.8, 0.1, 0.1), description="a_1 energy, a_2 heading, a_3 height")
    time_weight: NonNegative = Field(default=0.0, description="cost of [time] flight_s seconds, where time is free")
    terminal_weight: TerminalWeight = Field(default="1", description="Q(t) of section 2.5.3")
    heading_ref_deg: Annotated[Number, Field(ge=-360, le=360)] | None = Field(
        default=None, description="psi_r, the desired heading towards the end, degrees; left out: the yaw of [end]"
    )
    height_ref_m: Number | None = Field(
        default=None, description="h_r, the desired height towards the end, m above height 0; left out: that of [end]"
    )
    drag_power_Ns2pm2: Positive = Field(default=0.06, description="k_f of Eq. 32, N s^2/m^2")
    heading_scale_deg: Positive = Field(default=60.0, description="one unit of the heading term, degrees")
    height_scale_m: Positive = Field(default=10.0, description="one unit of the height term, m")


class GroundPhases(Part):
    """The phases between the ground and the flight: take-off, hover, run-up, landing."""

    run_up_m: NonNegative = Field(default=0.0, description="distance from the first hover to the start, m")
    run_up_s: PhaseLength = Field(default=1.0, description="time from the first hover to the start, s")
    takeoff_s: PhaseLength = Field(default=20.0, description="time from the ground to the first hover, s")
    hover_s: HoverLength = Field(default=5.0, description="hover time before the run-up and after the end, s")
    landing_s: PhaseLength = Field(default=30.0, description="time from the last hover to the ground, s")


class MissionOptions(Part):
    """The autopilot, the waypoints and the setpoint stream."""

    autopilot: AutopilotKey = Field(
        default="ardupilot", description="autopilot that missions are written and timed for, and that --sim emulates"
    )
    tolerance_m: Positive = Field(default=0.5, description="largest distance of the waypoint polyline to the plan, m")
    setpoint_rate_hz: Annotated[Number, Field(ge=2, le=100)] = Field(
        default=10.0, description="setpoints per second to each vehicle"
    )


class SensorsTable(Part):
    """The sensors of emulated vehicles."""

    grade: Literal["rtk", "gnss"] = Field(
        default="gnss",
        description="rtk: position errors of centimetres; gnss: of 1 m north and east, 1.5 m in height (1 sigma)",
    )


class Judge(Part):
    """What a flight of emulated vehicles must meet. Any flight uses separation_min_m to detect conflicts."""

    separation_min_m: Positive = Field(default=1.0, description="least true distance between two vehicles, m")
    arrival_time_s: Positive = Field(default=3.0, description="largest error of the arrival time, s")
    arrival_position_m: Positive = Field(default=5.0, description="largest position error at arrival, m")
    position_rms_m: Positive = Field(default=3.5, description="largest RMS position error of a vehicle, m")


class Scenario(Part):
    """One mission: the vehicles, their limits, the place, the start, the end and the formation."""

    schema_version: Literal[1] = Field(description="version of this file format")
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")] = Field(
        description="short name for files and folders"
    )
    title: str = Field(default="", description="one line that reports show")
    origin: OriginTable
    time: Time
    vehicle: VehicleTable
    limits: LimitsTable
    terrain: Terrain = Terrain()
    no_fly: tuple[NoFlyZone, ...] = ()
    wind: PlannedWind | None = None
    start: Boundary
    end: Boundary
    objective: ObjectiveTable = ObjectiveTable()
    formation: Formation
    ground_phases: GroundPhases = GroundPhases()
    mission: MissionOptions = MissionOptions()
    sensors: SensorsTable = SensorsTable()
    judge: Judge = Judge()
    preflight: PreflightTable = Field(default=PreflightTable(), exclude_if=lambda table: table == PreflightTable())
