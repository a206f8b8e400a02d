"""The table `[preflight]`: what a vehicle on a link must report on its pad before it is armed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from gcs.mavlink_names import SENSORS
from gcs.scenario.schema.fields import Findings, Length, Number, Part, Share

if TYPE_CHECKING:
    SensorName = str
else:
    SensorName = Literal[SENSORS]  # a name, as a type of data models


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
            yield ("mentioned_sensors",), f'has "{name}", which required_sensors has too. Name it in one of them'
