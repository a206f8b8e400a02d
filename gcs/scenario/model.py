"""What a scenario is: the shape of `scenario.toml`, its units and its allowed ranges.

Knows: keys, types, ranges, and what must agree inside one table. Does not know: files, terrain heights,
plans, and what must agree between tables (that is `gcs.scenario.check`). Values stay as people write them
(metres up, degrees); `gcs.scenario.physical` turns them into SI, NED and radians.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict, model_validator

# Strict: TOML has types of its own, so the text "5" or the truth value true is a mistake and not a number.
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]
Share = Annotated[Number, Field(ge=0, lt=1)]
SysId = Annotated[int, Strict(), Field(ge=1, le=254)]
VehicleId = Annotated[int, Strict(), Field(ge=1, le=10_000)]  # of a fleet too large for one MAVLink network
ShapeName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
Generator = Literal["triangle", "line", "column", "vee", "grid", "circle", "sphere"]
Point = tuple[Number, Number]
Vector = tuple[Number, Number, Number]
PositiveVector = tuple[Positive, Positive, Positive]
NonNegativeVector = tuple[NonNegative, NonNegative, NonNegative]
TerminalWeight = Literal["1", "t^2", "1/(tf-t+0.5)", "1/(tf-t+0.5)^2"]

START_SHAPE = "start"  # what changes call the shape at t = 0
_NEEDED = ("angle_deg", "scale", "to")
_KEYS_OF_CHANGES = {
    "angle_deg": ("rotate",),
    "axis": ("rotate",),
    "scale": ("shrink",),
    "to": ("reshape",),
    "assignment": ("reshape",),
}


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] >= pair[1]:
        raise ValueError("must be [low, high] with low < high")
    return pair


Range = Annotated[tuple[Number, Number], AfterValidator(_ordered)]


class Part(BaseModel):
    """Base of every table: immutable, no unknown keys, no silent conversions."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Origin(Part):
    """Where the local frame lies on Earth."""

    lat_deg: Annotated[Number, Field(ge=-85, le=85)] = Field(description="WGS-84 latitude, degrees")
    lon_deg: Annotated[Number, Field(ge=-180, le=180)] = Field(description="WGS-84 longitude, degrees")
    alt_amsl_m: Annotated[Number, Field(ge=-500, le=9000)] = Field(
        description="altitude above mean sea level of height 0 in this file, m"
    )


class Time(Part):
    """Times of the planned flight."""

    flight_s: Annotated[Number, Field(gt=0, le=7200)] = Field(description="t_f, from start to end, s")


class Vehicle(Part):
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


class Limits(Part):
    """Eq. 51 and the limits the paper names without a value; they hold for every vehicle."""

    north_m: Range = Field(description="[low, high], m north of the origin")
    east_m: Range = Field(description="[low, high], m east of the origin")
    height_m: Range = Field(description="[low, high], m above height 0")
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
    clearance_min_m: NonNegative = Field(description="h_min, least height above the ground, m")
    load_factor_max: Positive = Field(description="n_max of Eq. 17, lateral acceleration in units of g")
    accel_max_mps2: Positive | None = Field(default=None, description="a_max, largest acceleration of a vehicle, m/s^2")
    separation_min_m: Positive = Field(description="least distance between two planned vehicles, m")
    control_margin: Share = Field(default=0.0, description="share of each control the plan keeps for feedback")


class Ripple(Part):
    """Coefficients of Eq. 52."""

    a: Number
    b: Number
    c: Number
    d: Number
    e: Number
    f: Number
    g: Number


class Mountains(Part):
    """Eq. 53: one entry per mountain in every list."""

    north_m: tuple[Number, ...] = Field(default=(), description="summits, m north of the origin")
    east_m: tuple[Number, ...] = Field(default=(), description="summits, m east of the origin")
    height_m: tuple[Number, ...] = Field(default=(), description="summits, m above height 0")
    spread_north_m: tuple[Positive, ...] = Field(default=(), description="decay length north and south, m")
    spread_east_m: tuple[Positive, ...] = Field(default=(), description="decay length east and west, m")

    @model_validator(mode="after")
    def _equally_long(self) -> Self:
        lengths = {key: len(getattr(self, key)) for key in type(self).model_fields}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{key} {length}" for key, length in lengths.items())
            raise ValueError(f"lists must be equally long, one entry per mountain; lengths are {found}")
        return self


class Terrain(Part):
    """Ground height: the larger of the ripple and the sum of mountains; flat at height 0 without both."""

    ripple: Ripple | None = Field(default=None, description="Eq. 52; no ripple when left out")
    mountains: Mountains = Field(default=Mountains(), description="Eq. 53; no mountains when left out")


class NoFlyDisk(Part):
    """Eq. 21: a vertical cylinder of any height."""

    north_m: Number = Field(description="centre, m north of the origin")
    east_m: Number = Field(description="centre, m east of the origin")
    radius_m: Positive = Field(description="R_j, m")


class Boundary(Part):
    """Eqs. 15, 16: the leader's state at one end."""

    position_m: Vector = Field(description="north, east, height, m")
    velocity_mps: Vector = Field(description="north, east, up, m/s")
    roll_pitch_yaw_deg: Vector = Field(description="Euler angles, degrees; yaw 0 is north, 90 is east")


class Objective(Part):
    """Eq. 35 with the reference of every term."""

    weights: NonNegativeVector = Field(description="a_1 energy, a_2 heading, a_3 height")
    terminal_weight: TerminalWeight = Field(description="Q(t) of section 2.5.3")
    heading_ref_deg: Annotated[Number, Field(ge=-360, le=360)] = Field(
        description="psi_r, the heading asked for towards the end, degrees"
    )
    height_ref_m: Number = Field(description="h_r, the height asked for towards the end, m above height 0")
    drag_power_Ns2pm2: Positive = Field(description="k_f of Eq. 32, N s^2/m^2")
    heading_scale_deg: Positive = Field(description="one unit of the heading term, degrees")
    height_scale_m: Positive = Field(description="one unit of the height term, m")


class FormationVehicle(Part):
    """One vehicle and where it is at t = 0."""

    sysid: SysId = Field(description="MAVLink system id")
    position_m: Vector = Field(description="north, east, height at t = 0, m")


class Shape(Part):
    """A named shape: a table of offsets, or a generator for any number of vehicles."""

    name: ShapeName = Field(description="what changes call it")
    generator: Generator | None = Field(default=None, description="a shape for any number of vehicles")
    spacing_m: Positive | None = Field(default=None, description="distance between neighbours of a generator, m")
    offsets_m: tuple[Vector, ...] = Field(
        default=(), description="north, east, up from the leader, one for every vehicle in order, m"
    )

    @model_validator(mode="after")
    def _one_way_of_saying_it(self) -> Self:
        if (self.generator is None) == (not self.offsets_m):
            raise ValueError("needs either a generator or a table offsets_m")
        if (self.generator is None) != (self.spacing_m is None):
            raise ValueError("spacing_m belongs to a generator, and every generator needs it")
        if self.name == START_SHAPE:
            raise ValueError(f'"{START_SHAPE}" is the shape at t = 0; another one needs another name')
        return self


class Change(Part):
    """One change of shape (§2.2.1-2.2.3): what, and when."""

    kind: Literal["rotate", "shrink", "reshape"] = Field(description="Eqs. 5-8, 9-12 or 13-14")
    at_s: NonNegative | None = Field(default=None, description="begins at this time, s")
    gate_m: tuple[Point, Point] | None = Field(
        default=None, description="begins when the leader crosses the line between these two (north, east), m"
    )
    auto: Annotated[bool, Strict()] = Field(default=False, description="the planner decides when and how far")
    angle_deg: Number | None = Field(
        default=None, description="rotate: by so much about `axis`; with auto, at most so much either way, degrees"
    )
    axis: Vector | None = Field(
        default=None,
        description="rotate: north, east, up; right-handed. Left out: straight down, so that + turns right",
    )
    scale: Annotated[Number, Field(gt=0, le=10)] | None = Field(
        default=None, description="shrink: new size over old; with auto, the smallest allowed"
    )
    to: str | None = Field(default=None, description=f'reshape: name of a shape, or "{START_SHAPE}"')
    assignment: Literal["free", "fixed"] | None = Field(
        default=None, description="reshape: who takes which place; free (left out) is the fastest way (Eq. 14)"
    )
    weight: Positive | None = Field(
        default=None, description="auto: cost of flying fully changed, over the whole flight, in units of Eq. 35"
    )

    @model_validator(mode="after")
    def _says_what_and_when(self) -> Self:
        triggers = [self.at_s is not None, self.gate_m is not None, self.auto]
        if sum(triggers) != 1:
            raise ValueError("needs exactly one of at_s, gate_m and auto = true")
        if self.gate_m is not None and self.gate_m[0] == self.gate_m[1]:
            raise ValueError("gate_m needs two different points")
        for key, kinds in _KEYS_OF_CHANGES.items():
            given = getattr(self, key) is not None
            if given and self.kind not in kinds:
                raise ValueError(f"{key} means nothing to a change of kind {self.kind}")
            if not given and key in _NEEDED and self.kind in kinds:
                raise ValueError(f"a change of kind {self.kind} needs {key}")
        if self.auto and self.axis is not None:
            raise ValueError("an automatic rotation turns about the vertical; leave axis out")
        if self.axis is not None and not any(self.axis):
            raise ValueError("axis needs a direction")
        if self.auto and self.kind == "shrink" and self.scale is not None and self.scale >= 1:
            raise ValueError("an automatic shrink needs a scale below 1")
        if self.weight is not None and not self.auto:
            raise ValueError("weight belongs to auto = true")
        return self


class Formation(Part):
    """The virtual rigid body: who flies where in it, and how it changes."""

    frame: Literal["inertial", "course"] = Field(
        default="inertial", description="where the shape is constant: in the world (Eq. 22), or turning with the course"
    )
    leader: VehicleId = Field(description="sysid of the vehicle the plan is made for")
    vehicle: tuple[FormationVehicle, ...] = Field(
        default=(), max_length=254, description="every vehicle, leader included; or count and start_shape"
    )
    count: Annotated[int, Strict(), Field(ge=1, le=10_000)] | None = Field(
        default=None, description="number of vehicles 1, 2, ... that stand in start_shape"
    )
    start_shape: str | None = Field(default=None, description="name of the shape at t = 0, with count")
    shape: tuple[Shape, ...] = Field(default=(), description="shapes that changes name")
    change: tuple[Change, ...] = Field(default=(), description="changes of shape, in order")
    change_speed_mps: Positive = Field(
        default=1.0, description="v_max of a change: a vehicle's speed in the shape, m/s"
    )
    change_accel_mps2: Positive = Field(default=0.3, description="a_max of a change, m/s^2")
    course_tolerance_deg: Annotated[Number, Field(gt=0, le=45)] = Field(
        default=5.0, description="frame = course: most the shape's heading lags the course, degrees"
    )
    topology: Literal["voronoi", "leader"] = Field(
        default="voronoi",
        description="whose state a follower needs: its Voronoi neighbours nearer to the leader, or his",
    )

    @model_validator(mode="after")
    def _leader_exists_once(self) -> Self:
        if bool(self.vehicle) == (self.count is not None):
            raise ValueError("needs either [[formation.vehicle]] entries or count")
        if (self.count is None) != (self.start_shape is None):
            raise ValueError("count and start_shape belong together")
        ids = self.sysids
        if len(set(ids)) != len(ids):
            raise ValueError(f"every vehicle needs a sysid of its own; there are {list(ids)}")
        if self.leader not in ids:
            there = f"are {list(ids)}" if len(ids) <= 10 else f"are {ids[0]} to {ids[-1]}"
            raise ValueError(f"leader = {self.leader} is not the sysid of a vehicle; there {there}")
        return self

    @model_validator(mode="after")
    def _shapes_are_known_and_fit(self) -> Self:
        names = [shape.name for shape in self.shape]
        if len(set(names)) != len(names):
            raise ValueError(f"every shape needs a name of its own; there are {names}")
        wanted = [self.start_shape, *(change.to for change in self.change)]
        for name in wanted:
            if name not in (None, START_SHAPE, *names):
                raise ValueError(f'there is no shape "{name}"; there are {[START_SHAPE, *names]}')
        for shape in self.shape:
            if shape.offsets_m and len(shape.offsets_m) != len(self.sysids):
                raise ValueError(
                    f'shape "{shape.name}" has {len(shape.offsets_m)} offsets_m for {len(self.sysids)} vehicles'
                )
        autos = [change.kind for change in self.change if change.auto]
        if len(set(autos)) != len(autos):
            raise ValueError("each kind of change can be automatic once")
        if self.frame == "course" and "rotate" in autos:
            raise ValueError("with frame = course the heading is the course's; it cannot rotate automatically as well")
        return self

    @property
    def sysids(self) -> tuple[int, ...]:
        """System ids in order."""
        if self.count is not None:
            return tuple(range(1, self.count + 1))
        return tuple(v.sysid for v in self.vehicle)


class GroundPhases(Part):
    """What joins a trajectory that begins and ends in the air to the ground."""

    run_up_m: NonNegative = Field(description="distance from the first hover to the start, m")
    run_up_s: Positive = Field(description="time from the first hover to the start, s")
    takeoff_s: Positive = Field(description="time from the ground to the first hover, s")
    hover_s: NonNegative = Field(description="time of the hovers before the run-up and after the end, s")
    landing_s: Positive = Field(description="time from the last hover to the ground, s")


class MissionOptions(Part):
    """How the plan is turned into waypoints and setpoints."""

    autopilot: Literal["ardupilot", "px4"] = Field(
        default="ardupilot", description="whose dialect files and links speak"
    )
    tolerance_m: Positive = Field(description="farthest the waypoints' polyline is from the trajectory, m")
    setpoint_rate_hz: Annotated[Number, Field(ge=2, le=100)] = Field(description="setpoints per second")


class Sensors(Part):
    """What the emulated vehicles measure with."""

    grade: Literal["rtk", "gnss"] = Field(description="centimetres or metres")


class Judge(Part):
    """What a flight must hold."""

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
    origin: Origin
    time: Time
    vehicle: Vehicle
    limits: Limits
    terrain: Terrain = Terrain()
    no_fly: tuple[NoFlyDisk, ...] = ()
    start: Boundary
    end: Boundary
    objective: Objective
    formation: Formation
    ground_phases: GroundPhases
    mission: MissionOptions
    sensors: Sensors
    judge: Judge
