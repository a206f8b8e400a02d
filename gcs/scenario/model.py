"""What a scenario is: the shape of `scenario.toml`, its units and its allowed ranges.

Knows: keys, types, ranges and what must agree with what. Does not know: files, terrain heights, plans.
Values stay as people write them (metres up, degrees); `gcs.scenario.physical` turns them into SI, NED and radians.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, lt=1)]
SysId = Annotated[int, Field(ge=1, le=254)]
Vector = tuple[Finite, Finite, Finite]
PositiveVector = tuple[Positive, Positive, Positive]
TerminalWeight = Literal["1", "t^2", "1/(tf-t+0.5)", "1/(tf-t+0.5)^2"]


class Part(BaseModel):
    """Base of every table: immutable, no unknown keys, no silent conversions from text."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


class Origin(Part):
    """Where the local frame lies on Earth."""

    lat_deg: Annotated[float, Field(ge=-85, le=85)]
    lon_deg: Annotated[float, Field(ge=-180, le=180)]
    alt_amsl_m: Annotated[float, Field(ge=-500, le=9000)]


class Time(Part):
    """Times of the planned flight."""

    flight_s: Annotated[float, Field(gt=0, le=7200)]


class Vehicle(Part):
    """Table 1: one type of quadrotor."""

    name: str
    mass_kg: Positive
    arm_m: Positive
    inertia_kgm2: PositiveVector
    thrust_coeff_Ns2: Positive
    moment_coeff_Nms2: Positive
    drag_Nspm: tuple[NonNegative, NonNegative, NonNegative]
    drag_moment_Nms: tuple[NonNegative, NonNegative, NonNegative]
    gravity_mps2: Annotated[float, Field(ge=9.7, le=9.9)] = 9.8
    rotor_max_radps: Positive


class Limits(Part):
    """Eq. 51 and the limits the paper names without a value."""

    north_m: tuple[Finite, Finite]
    east_m: tuple[Finite, Finite]
    height_m: tuple[Finite, Finite]
    speed_ned_mps: PositiveVector
    roll_pitch_yaw_deg: tuple[
        Annotated[float, Field(gt=0, le=180)],
        Annotated[float, Field(gt=0, lt=90)],
        Annotated[float, Field(gt=0, le=360)],
    ]
    rates_degps: PositiveVector
    thrust_N: tuple[NonNegative, Positive]
    torque: PositiveVector
    clearance_min_m: NonNegative
    load_factor_max: Positive
    separation_min_m: Positive
    control_margin: Share = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for key in ("north_m", "east_m", "height_m", "thrust_N"):
            low, high = getattr(self, key)
            if low >= high:
                raise ValueError(f"{key} must be [low, high] with low < high")
        return self


class Ripple(Part):
    """Coefficients of Eq. 52."""

    a: Finite
    b: Finite
    c: Finite
    d: Finite
    e: Finite
    f: Finite
    g: Finite


class Mountains(Part):
    """Eq. 53: one entry per mountain in every list."""

    north_m: tuple[Finite, ...] = ()
    east_m: tuple[Finite, ...] = ()
    height_m: tuple[Finite, ...] = ()
    spread_north_m: tuple[Positive, ...] = ()
    spread_east_m: tuple[Positive, ...] = ()

    @model_validator(mode="after")
    def _equally_long(self) -> Self:
        lengths = {key: len(getattr(self, key)) for key in type(self).model_fields}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"lists must be equally long, got {lengths}")
        return self


class Terrain(Part):
    """Ground height: the larger of the ripple and the sum of mountains; flat at height 0 without both."""

    ripple: Ripple | None = None
    mountains: Mountains = Mountains()


class NoFlyDisk(Part):
    """Eq. 21: a vertical cylinder of any height."""

    north_m: Finite
    east_m: Finite
    radius_m: Positive


class Boundary(Part):
    """Eqs. 15, 16: the leader's state at one end."""

    position_m: Vector
    velocity_mps: Vector
    roll_pitch_yaw_deg: Vector


class Objective(Part):
    """Eq. 35 with the reference of every term."""

    weights: tuple[NonNegative, NonNegative, NonNegative]
    terminal_weight: TerminalWeight
    heading_ref_deg: Annotated[float, Field(ge=-360, le=360)]
    height_ref_m: Finite
    drag_power_Ns2pm2: Positive
    heading_scale_deg: Positive
    height_scale_m: Positive


class FormationVehicle(Part):
    """One vehicle and where it is at t = 0."""

    sysid: SysId
    position_m: Vector


class Formation(Part):
    """The virtual rigid body."""

    frame: Literal["inertial"] = "inertial"
    leader: SysId
    vehicle: Annotated[tuple[FormationVehicle, ...], Field(min_length=1, max_length=254)]

    @model_validator(mode="after")
    def _leader_exists_once(self) -> Self:
        ids = [v.sysid for v in self.vehicle]
        if len(set(ids)) != len(ids):
            raise ValueError(f"sysid must differ between vehicles, got {ids}")
        if self.leader not in ids:
            raise ValueError(f"leader {self.leader} is not the sysid of a vehicle; there are {ids}")
        return self


class GroundPhases(Part):
    """What joins a trajectory that begins and ends in the air to the ground."""

    run_up_m: NonNegative
    run_up_s: Positive
    takeoff_s: Positive
    hover_s: NonNegative
    landing_s: Positive


class MissionOptions(Part):
    """How the plan is turned into waypoints and setpoints."""

    autopilot: Literal["ardupilot", "px4"] = "ardupilot"
    tolerance_m: Positive
    setpoint_rate_hz: Annotated[float, Field(ge=2, le=100)]


class Sensors(Part):
    """What the emulated vehicles measure with."""

    grade: Literal["rtk", "gnss"]


class Judge(Part):
    """What a flight must hold."""

    separation_min_m: Positive
    arrival_time_s: Positive
    arrival_position_m: Positive
    position_rms_m: Positive


class Scenario(Part):
    """One complete task: who flies, where, from what to what, under which limits."""

    schema_version: Literal[1]
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
    title: str = ""
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

    @model_validator(mode="after")
    def _leader_starts_where_it_is(self) -> Self:
        leader = next(v for v in self.formation.vehicle if v.sysid == self.formation.leader)
        if leader.position_m != self.start.position_m:
            raise ValueError(
                f"start.position_m {self.start.position_m} differs from the leader's formation position {leader.position_m}"
            )
        return self
