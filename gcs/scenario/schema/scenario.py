"""The tables of `scenario.toml`: keys, units, ranges, defaults, and the rules inside one table.

Rules between tables are in `gcs.scenario.validation.cross_table`. Values stay as the file has them (metres up,
degrees); `gcs.scenario.values.si` converts them to SI, NED and radians.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, Strict

from gcs.autopilots.traits import AutopilotKey
from gcs.scenario.schema.degree_keys import POSITION
from gcs.scenario.schema.fields import (
    FLIGHT_MAX_S,
    Findings,
    Height,
    Length,
    Number,
    Part,
    Place,
    Seconds,
    Truth,
    Turn,
    Weight,
    left_out,
)
from gcs.scenario.schema.formation_table import START_SHAPE, ChangeTable, Formation, Generator
from gcs.scenario.schema.ground_tables import Mountains, NoFlyZone, Ripple, Terrain
from gcs.scenario.schema.heightmap import Relief
from gcs.scenario.schema.limits_table import ROLL_PITCH_KEYS, LimitsTable, Performance
from gcs.scenario.schema.preflight_table import PreflightTable
from gcs.scenario.schema.route_tables import ROUTE_MAX, KeepIn, RoutePoint, SurveyTable

__all__ = ["START_SHAPE", "ChangeTable", "Formation", "Generator"]  # of the tables beside these, for all users
__all__ += ["ROLL_PITCH_KEYS", "KeepIn", "LimitsTable", "Performance", "PreflightTable", "RoutePoint", "SurveyTable"]
__all__ += ["Mountains", "NoFlyZone", "Relief", "Ripple", "Terrain"]

AT_START = "start"  # as the end: a file may say so instead of a table

TerminalWeight = Literal["1", "t^2", "1/(tf-t+0.5)", "1/(tf-t+0.5)^2"]
PhaseLength = Annotated[Number, Field(ge=0.01, le=3600)]
HoverLength = Annotated[Number, Field(ge=0, le=3600)]
Inertia = Annotated[Number, Field(ge=1e-9, le=10_000)]
RotorCoefficient = Annotated[Number, Field(ge=1e-15, le=1)]
Drag = Annotated[Number, Field(ge=0, le=1000)]
Velocity = Annotated[Number, Field(ge=-340, le=340)]


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


class GroundPhases(Part):
    """The phases between the ground and the flight: take-off, hover, run-up, landing."""

    run_up_m: Number = Field(default=0.0, ge=0, le=1000, description="distance from the first hover to the start, m")
    run_up_s: PhaseLength = Field(default=1.0, description="time from the first hover to the start, s")
    takeoff_s: PhaseLength = Field(default=20.0, description="time from the ground to the first hover, s")
    hover_s: HoverLength = Field(default=5.0, description="hover time before the run-up and after the end, s")
    landing_s: PhaseLength = Field(default=30.0, description="time from the last hover to the ground, s")


class MissionOptions(Part):
    """The autopilot, the waypoints and the setpoint stream."""

    autopilot: AutopilotKey = Field(
        default="ardupilot", description="autopilot that missions are written and timed for, and that --sim emulates"
    )
    tolerance_m: Number = Field(
        default=0.5, ge=0.001, le=1000, description="largest distance of the waypoint polyline to the plan, m"
    )
    setpoint_rate_hz: Number = Field(default=10.0, ge=2, le=100, description="setpoints per second to each vehicle")


class SensorsTable(Part):
    """The sensors of emulated vehicles."""

    grade: Literal["rtk", "gnss"] = Field(
        default="gnss",
        description="rtk: position errors of centimetres; gnss: of 1 m north and east, 1.5 m in height (1 sigma)",
    )


def _or_at_start(schema: dict[str, Any]) -> None:
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
    keep_in: tuple[KeepIn, ...] = Field(default=(), max_length=16, exclude_if=lambda areas: not areas)
    wind: PlannedWind | None = None
    start: Boundary
    route: tuple[RoutePoint, ...] = Field(default=(), max_length=ROUTE_MAX, exclude_if=lambda points: not points)
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
    preflight: PreflightTable = Field(default=PreflightTable(), exclude_if=lambda table: table == PreflightTable())
