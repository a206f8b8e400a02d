"""[limits]: what a type of vehicle can do by itself, and the limits of every vehicle of a flight (Eq. 51)."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from gcs.scenario.schema.degree_keys import BOX
from gcs.scenario.schema.fields import (
    Acceleration,
    Coordinate,
    Distance,
    Findings,
    Force,
    Height,
    Jerk,
    Length,
    Number,
    Part,
    Share,
    Speed,
    Torque,
    TurnRate,
    left_out,
)


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    low, high = pair
    if low >= high:
        step = f". Write [{high:g}, {low:g}]" if low > high else ""
        raise ValueError(f"must be [low, high] with low < high{step}")
    return pair


def _upwards(pair: tuple[float, float]) -> tuple[float, float]:
    low, high = pair
    if high < low <= 0.0:
        raise ValueError(
            f"must be [low, high] with low < high; heights are positive upwards. Write [{0.0 - low:g}, {0.0 - high:g}]"
        )
    return _ordered(pair)


Range = Annotated[tuple[Coordinate, Coordinate], AfterValidator(_ordered)]
HeightRange = Annotated[tuple[Height, Height], AfterValidator(_upwards)]
TorquePair = tuple[Torque, Torque]
ROLL_PITCH_KEYS = ("roll_pitch_force_N", "roll_pitch_moment_Nm", "torque")


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
            yield (), f"lacks the limits of U_2 and U_3. Give one of {', '.join(ROLL_PITCH_KEYS[:2])}"
        for key in given[1:]:
            yield (key,), f"stands beside {given[0]}; both limit U_2 and U_3. Keep one"
        if self.torque is not None and self.yaw_moment_Nm is not None:
            yield ("yaw_moment_Nm",), "stands beside torque, whose third number is the same limit. Keep one"
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
