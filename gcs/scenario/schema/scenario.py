"""The tables of `scenario.toml`: keys, units, ranges, defaults, and the rules inside one table.

Rules between tables are in `gcs.scenario.validation.cross_table`. Values stay as the file has them (metres up,
degrees); `gcs.scenario.values.si` converts them to SI, NED and radians.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field, Strict

from gcs.autopilots.traits import AutopilotKey
from gcs.mavlink_names import SENSORS
from gcs.scenario.schema.degree_keys import BOX, POSITION
from gcs.scenario.schema.event_table import EventTable
from gcs.scenario.schema.fields import (
    FLIGHT_MAX_S,
    Acceleration,
    Coordinate,
    Disagreement,
    Distance,
    Findings,
    Force,
    Height,
    Jerk,
    Length,
    Number,
    Part,
    Place,
    Seconds,
    Share,
    Speed,
    Torque,
    Truth,
    Turn,
    TurnRate,
    Weight,
    left_out,
)
from gcs.scenario.schema.formation_table import START_SHAPE, ChangeTable, Formation, Generator
from gcs.scenario.schema.heightmap import Relief
from gcs.scenario.schema.places import (
    ROUTE_MAX,
    GeozoneNotes,
    KeepIn,
    LegsTable,
    Mountains,
    NoFlyZone,
    Ripple,
    RoutePoint,
    SurveyTable,
    Terrain,
    ZonesBeyond,
)
from gcs.scenario.schema.toml_lines import Table

__all__ = [
    "START_SHAPE",
    "ChangeTable",
    "EventTable",
    "Formation",
    "Generator",
]  # of the tables beside these, for all users
__all__ += ["KeepIn", "Mountains", "NoFlyZone", "Relief", "Ripple", "RoutePoint", "SurveyTable", "Terrain"]

AT_START = "start"  # as the end: a file may say so instead of a table

TerminalWeight = Literal["1", "t^2", "1/(tf-t+0.5)", "1/(tf-t+0.5)^2"]
PhaseLength = Annotated[Number, Field(ge=0.01, le=3600)]
HoverLength = Annotated[Number, Field(ge=0, le=3600)]
Inertia = Annotated[Number, Field(ge=1e-9, le=10_000)]
RotorCoefficient = Annotated[Number, Field(ge=1e-15, le=1)]
Drag = Annotated[Number, Field(ge=0, le=1000)]
GateCost = Annotated[Number, Field(ge=0, le=1000)] | None
Velocity = Annotated[Number, Field(ge=-340, le=340)]
TorquePair = tuple[Torque, Torque]
ROLL_PITCH_KEYS = ("roll_pitch_force_N", "roll_pitch_moment_Nm", "torque")

if TYPE_CHECKING:
    SensorName = str
else:
    SensorName = Literal[SENSORS]  # a name, as a type of data models


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    low, high = pair
    if low >= high:
        step = "exchange the two numbers" if low > high else ""
        raise Disagreement([((), "must be [low, high] with low < high", step)])
    return pair


def _upwards(pair: tuple[float, float]) -> tuple[float, float]:
    low, high = pair
    if high < low <= 0.0:
        text = "must be [low, high] with low < high; heights are positive upwards"
        raise Disagreement([((), text, f"write [{0.0 - low:g}, {0.0 - high:g}]")])
    return _ordered(pair)


Range = Annotated[tuple[Coordinate, Coordinate], AfterValidator(_ordered)]
HeightRange = Annotated[tuple[Height, Height], AfterValidator(_upwards)]


class Performance(Part):
    """The limits that a type of vehicle has by itself."""

    speed_ned_mps: tuple[Speed, Speed, Speed] = Field(description="largest speed along north, east, vertical, m/s")
    roll_pitch_yaw_deg: tuple[
        Annotated[Number, Field(ge=0.01, le=180)],
        Annotated[Number, Field(ge=0.01, lt=90)],
        Annotated[Number, Field(ge=0.01, le=360)],
    ] = Field(description="largest |roll|, |pitch|, |yaw|, degrees")
    rates_degps: tuple[TurnRate, TurnRate, TurnRate] = Field(
        description="largest |roll rate|, |pitch rate|, |yaw rate|, degrees/s"
    )
    thrust_N: Annotated[tuple[Force, Force], AfterValidator(_ordered)] = Field(description="U_1, [low, high], N")
    roll_pitch_force_N: TorquePair | None = left_out(
        "largest |U_2|, |U_3| as Eqs. 1 and 2 have them: forces on the arm, N"
    )
    roll_pitch_moment_Nm: TorquePair | None = left_out(
        "instead of roll_pitch_force_N: the moments arm_m |U_2|, arm_m |U_3|, the unit of Eq. 51, N m"
    )
    yaw_moment_Nm: Torque | None = left_out(
        "largest |U_4|, N m; needed beside roll_pitch_force_N and roll_pitch_moment_Nm"
    )
    torque: tuple[Torque, Torque, Torque] | None = Field(
        default=None,
        description="deprecated: [roll_pitch_force_N, yaw_moment_Nm] in one list, N, N, N m",
        exclude_if=lambda torque: torque is None,
        json_schema_extra={"deprecated": True},
    )
    load_factor_max: Number = Field(
        ge=0.001, le=100, description="n_max of Eq. 17 and Eq. 18, normal acceleration in turns, in units of g"
    )
    accel_max_mps2: Acceleration | None = Field(
        default=None, description="a_max, largest acceleration of a vehicle, m/s^2"
    )
    jerk_max_mps3: Jerk | None = left_out(
        "j_max, largest jerk of a vehicle: the rate at which its acceleration changes, m/s^3"
    )
    control_margin: Share = Field(default=0.0, description="share of each control that the plan leaves to feedback")

    def _disagreements(self) -> Findings:
        given = [key for key in ROLL_PITCH_KEYS if getattr(self, key) is not None]
        if not given:
            yield (), "lacks the limits of U_2 and U_3", f"give one of {', '.join(ROLL_PITCH_KEYS[:2])}"
        for key in given[1:]:
            yield (key,), f"stands beside {given[0]}; both limit U_2 and U_3", "keep one"
        if self.torque is not None and self.yaw_moment_Nm is not None:
            yield ("yaw_moment_Nm",), "stands beside torque, whose third number is the same limit", "keep one"
        if given and self.torque is None and self.yaw_moment_Nm is None:
            yield ("yaw_moment_Nm",), "missing; it must be a number > 0 (largest |U_4|, N m)"


class LimitsTable(Performance):
    """The limits of every vehicle: Eq. 51, and those that the paper names without a value."""

    degree_keys = (BOX,)

    north_m: Range = Field(description="[low, high], m north of the origin")
    east_m: Range = Field(description="[low, high], m east of the origin")
    height_m: HeightRange = Field(description="[low, high], m above height 0")
    clearance_min_m: Distance = Field(
        description="h_min, least distance to the ground in any direction between take-off and landing, m"
    )
    separation_min_m: Length = Field(description="least distance between two planned vehicles, m")
    zone_margin_m: Distance | None = left_out(
        "least distance of every vehicle to every no-fly zone, m; left out: the plan keeps the navigation "
        "error of [sensors] where there is room"
    )


class OriginTable(Part):
    """The point on Earth that is (0, 0, 0) of the local frame."""

    lat_deg: Number = Field(ge=-85, le=85, description="WGS-84 latitude, degrees")
    lon_deg: Number = Field(ge=-180, le=180, description="WGS-84 longitude, degrees")
    alt_amsl_m: Number = Field(
        ge=-500, le=9000, description="altitude above mean sea level of height 0 in this file, m"
    )


class Time(Part):
    """Duration of the planned flight, without take-off and landing."""

    flight_s: Seconds = Field(description="t_f, from start to end, s")
    free: Truth = Field(default=False, description="the planner chooses the time; flight_s is then only its reference")
    earliest_s: Seconds | None = Field(default=None, description="with free: least time the planner may choose, s")
    latest_s: Seconds | None = Field(default=None, description="with free: longest time the planner may choose, s")

    def _disagreements(self) -> Findings:
        if self.earliest_s is not None and self.latest_s is not None and self.earliest_s >= self.latest_s:
            yield ("latest_s",), f"must be more than earliest_s = {self.earliest_s:g}"


class Power(Part):
    """The battery and the propellers, for the energy a flight takes."""

    battery_Wh: Number = Field(
        ge=0.001, le=100_000, description="energy of a full battery, nominal voltage times capacity, Wh"
    )
    battery_V: Annotated[Number, Field(ge=0.1, le=10_000)] | None = left_out(
        "nominal voltage of the battery, V; left out: 3.7 V for each cell of the reported voltage"
    )
    rotor_radius_m: Number = Field(ge=0.001, le=10, description="radius of a propeller, m")
    figure_of_merit: Annotated[Number, Field(ge=0.01, le=1)] = Field(
        description="ideal power of momentum theory over the power drawn: propeller, motor, speed controller"
    )


class VehicleTable(Part):
    """One type of quadrotor: the constants of the paper's Table 1."""

    name: str = Field(max_length=200, description="name of the type, as reports show it")
    mass_kg: Number = Field(ge=0.001, le=1000, description="m, kg")
    arm_m: Number = Field(ge=0.001, le=10, description="l, centre to rotor, m")
    inertia_kgm2: tuple[Inertia, Inertia, Inertia] = Field(description="I_x, I_y, I_z, kg m^2")
    thrust_coeff_Ns2: RotorCoefficient = Field(description="K_T, thrust of one rotor per squared speed, N s^2")
    moment_coeff_Nms2: RotorCoefficient = Field(description="K_M, moment of one rotor per squared speed, N m s^2")
    drag_Nspm: tuple[Drag, Drag, Drag] = Field(description="K_1..K_3, linear drag north, east, down, N s/m")
    drag_moment_Nms: tuple[Drag, Drag, Drag] = Field(description="K_4..K_6, linear drag of the rates, N m s")
    gravity_mps2: Number = Field(default=9.8, ge=9.7, le=9.9, description="g, m/s^2")
    rotor_max_radps: Number = Field(ge=1, le=100_000, description="largest rotor speed, rad/s")
    power: Power | None = left_out(
        "battery and propellers; without them the battery's need is estimated from the flight time"
    )


class PlannedWind(Part):
    """The steady wind that the planner takes into account and that emulated vehicles fly in."""

    speed_mps: Number = Field(ge=0, le=30, description="wind speed at height_m, m/s")
    from_deg: Number = Field(ge=-360, le=360, description="direction the wind comes from, 90 is east, degrees")
    height_m: Number = Field(default=10.0, ge=0.1, le=10_000, description="reference height, m above height 0")
    shear: Annotated[Number, Field(ge=0, le=1)] = Field(
        default=0.0, description="exponent of the power law: 0 is the same wind at every height, 0.14 is open land"
    )


class Boundary(Part):
    """The leader's state at one end of the flight (Eqs. 15, 16)."""

    degree_keys = (POSITION,)

    position_m: Place = Field(description="north, east, height, m")
    height_above_ground_m: Length | None = left_out(
        "instead of a height in position_m or position_deg: height above the ground there, m"
    )
    velocity_mps: tuple[Velocity, Velocity, Velocity] = Field(
        default=(0.0, 0.0, 0.0), description="north, east, up, m/s"
    )
    roll_pitch_yaw_deg: tuple[Turn, Turn, Turn] = Field(
        default=(0.0, 0.0, 0.0), description="Euler angles, degrees; yaw 0 is north, 90 is east"
    )


class ObjectiveTable(Part):
    """The cost of a flight (Eq. 35): its weights, and the reference and unit of every term."""

    weights: tuple[Weight, Weight, Weight] = Field(
        default=(0.8, 0.1, 0.1), description="a_1 energy, a_2 heading, a_3 height"
    )
    time_weight: Weight = Field(default=0.0, description="cost of [time] flight_s seconds, where time is free")
    terminal_weight: TerminalWeight = Field(default="1", description="Q(t) of section 2.5.3")
    heading_ref_deg: Annotated[Number, Field(ge=-360, le=360)] | None = Field(
        default=None, description="psi_r, the desired heading towards the end, degrees; left out: the yaw of [end]"
    )
    height_ref_m: Height | None = Field(
        default=None, description="h_r, the desired height towards the end, m above height 0; left out: that of [end]"
    )
    drag_power_Ns2pm2: Number = Field(default=0.06, ge=1e-9, le=100_000, description="k_f of Eq. 32, N s^2/m^2")
    heading_scale_deg: Number = Field(
        default=60.0, ge=0.001, le=36_000, description="one unit of the heading term, degrees"
    )
    height_scale_m: Length = Field(default=10.0, description="one unit of the height term, m")
    gate_cost_percent: GateCost = left_out("of a drawn route: what the middle of gates may add, percent; left out: 0.1")


class GroundPhases(Part):
    """The phases between the ground and the flight: take-off, hover, run-up, landing."""

    run_up_m: Number = Field(default=0.0, ge=0, le=1000, description="distance from the first hover to the start, m")
    run_up_s: PhaseLength = Field(default=1.0, description="time from the first hover to the start, s")
    takeoff_s: PhaseLength = Field(default=20.0, description="time from the ground to the first hover, s")
    hover_s: HoverLength = Field(default=5.0, description="hover time before the run-up and after the end, s")
    landing_s: PhaseLength | None = Field(
        default=None, description="time from the last hover to the ground, s; left out: that of the autopilots' landing"
    )


class MissionOptions(Part):
    """The autopilot, the waypoints and the setpoint stream."""

    autopilot: AutopilotKey = Field(
        default="ardupilot", description="autopilot that missions are written and timed for, and that --sim emulates"
    )
    tolerance_m: Number = Field(
        default=0.5, ge=0, le=1000, description="largest distance of the waypoint polyline to the plan, m"
    )
    setpoint_rate_hz: Number = Field(default=10.0, ge=2, le=100, description="setpoints per second to each vehicle")


class SensorsTable(Part):
    """The sensors of emulated vehicles."""

    grade: Literal["rtk", "gnss"] = Field(
        default="gnss",
        description="rtk: position errors of centimetres; gnss: of 1 m north and east, 1.5 m in height (1 sigma)",
    )


def _or_at_start(schema: Table) -> None:
    """The end may be the word "start" instead of a table: the leader's place at t = 0, at rest."""
    table = {key: schema.pop(key) for key in list(schema)}
    schema["anyOf"] = [table, {"const": AT_START, "description": "the start's position and attitude, at rest"}]


class Judge(Part):
    """What a flight of emulated vehicles must meet. Any flight uses separation_min_m to detect conflicts."""

    separation_min_m: Length | None = left_out(
        "least true distance between two vehicles, m; left out: limits.separation_min_m less the "
        "navigation error of two vehicles, and no less than the size of a vehicle"
    )
    arrival_time_s: Number = Field(
        default=3.0, ge=0.001, le=FLIGHT_MAX_S, description="largest error of the arrival time, s"
    )
    arrival_position_m: Length = Field(default=5.0, description="largest position error at arrival, m")
    position_rms_m: Length = Field(default=3.5, description="largest RMS position error of a vehicle, m")


class PreflightTable(Part):
    """What a vehicle on a link must report before it is armed. A failed check is a no-go."""

    required_sensors: tuple[SensorName, ...] = Field(
        default=(), description="sensors that must be enabled and healthy, also those that the autopilot flies without"
    )
    mentioned_sensors: tuple[SensorName, ...] = Field(
        default=(),
        description="sensors that are only mentioned where not healthy, beside those that the autopilot flies without "
        "(radio control on both); every other enabled sensor must be healthy",
    )
    pad_m: Length = Field(default=3.0, description="largest horizontal distance of a vehicle from its own pad, m")
    height_m: Length = Field(default=10.0, description="largest difference of its height from its pad's, m")
    home_m: Length = Field(default=3.0, description="largest horizontal distance of its home from its position, m")
    origin_m: Length = Field(
        default=5.0, description="largest horizontal distance of its local frame's origin from its pad, m"
    )
    round_trip_s: Number = Field(default=1.0, ge=0.001, le=60, description="longest round trip of TIMESYNC, s")
    reserve: Share = Field(default=0.25, description="charge left after the flight, share of a full battery")
    endurance_s: Number = Field(
        default=900.0, ge=1, le=86_400, description="hover time of a full battery, used without [vehicle.power], s"
    )
    effort: Annotated[Number, Field(ge=1, le=100)] = Field(
        default=1.15, description="energy for climbs and wind over that of hover, used without [vehicle.power]"
    )
    capacity_tolerance: Share = Field(
        default=0.1,
        description="largest difference of the capacity that a vehicle is set to from that of [vehicle.power], share",
    )

    def _disagreements(self) -> Findings:
        for name in sorted({*self.required_sensors} & {*self.mentioned_sensors}):
            yield ("mentioned_sensors",), f'has "{name}", which required_sensors has too', "name it in one of them"


class Scenario(Part):
    """One mission: the vehicles, their limits, the place, the start, the end and the formation."""

    schema_version: Literal[1] = Field(description="version of this file format")
    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]*$", max_length=100, description="short name for files and folders")
    title: str = Field(default="", max_length=1000, description="one line that reports show")
    origin: OriginTable
    time: Time
    vehicle: VehicleTable
    limits: LimitsTable
    terrain: Terrain = Terrain()
    no_fly: Annotated[tuple[NoFlyZone, ...], Field(max_length=256)] = ()
    geozones: GeozoneNotes = ()
    no_fly_beyond: ZonesBeyond = ()
    keep_in: tuple[KeepIn, ...] = Field(default=(), max_length=16, exclude_if=lambda areas: not areas)
    wind: PlannedWind | None = None
    start: Boundary
    route: tuple[RoutePoint, ...] = Field(default=(), max_length=ROUTE_MAX, exclude_if=lambda points: not points)
    legs: LegsTable = Field(default=LegsTable(), exclude_if=lambda table: table == LegsTable())
    loops: Annotated[int, Strict(), Field(ge=1, le=ROUTE_MAX)] = Field(
        default=1, description="the points of [[route]] are flown so many times", exclude_if=lambda loops: loops == 1
    )
    end: Boundary = Field(json_schema_extra=_or_at_start)
    survey: SurveyTable | None = Field(default=None, exclude_if=lambda survey: survey is None)
    objective: ObjectiveTable = ObjectiveTable()
    formation: Formation
    ground_phases: GroundPhases = GroundPhases()
    mission: MissionOptions = MissionOptions()
    sensors: SensorsTable = SensorsTable()
    judge: Judge = Judge()
    on: tuple[EventTable, ...] = Field(default=(), max_length=32, exclude_if=lambda rows: not rows)
    preflight: PreflightTable = Field(default=PreflightTable(), exclude_if=lambda table: table == PreflightTable())
