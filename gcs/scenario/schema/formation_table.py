"""The table [formation]: vehicles, named shapes, and changes of shape, with the rules inside this table.

`gcs.scenario.validation.formation_rules` compares it with limits, times and positions of the flight.
"""

from typing import Annotated, Literal

from pydantic import Field, Strict

from gcs.autopilots.traits import AutopilotKey
from gcs.scenario.schema.degree_keys import GATE, POSITION
from gcs.scenario.schema.fields import (
    FLIGHT_MAX_S,
    Acceleration,
    Direction,
    Findings,
    Length,
    Number,
    Part,
    Place,
    Point,
    Speed,
    Truth,
    Turn,
    left_out,
)
from gcs.scenario.schema.mistake import nearest

SysId = Annotated[int, Strict(), Field(ge=1, le=254)]
VehicleId = Annotated[int, Strict(), Field(ge=1, le=10_000)]  # of a fleet too large for one MAVLink network
ShapeName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
Generator = Literal["triangle", "line", "column", "vee", "grid", "circle", "sphere"]
Topology = Literal["leader", "chain", "tree", "voronoi"]

START_SHAPE = "start"  # name of the shape at t = 0 in changes
_AXIS_LEAST = 1e-3
_HOLES = 10  # missing vehicles that one sentence names
_NEEDED = ("angle_deg", "scale", "to")
_KIND_OF_KEY = {"angle_deg": "rotate", "axis": "rotate", "scale": "shrink", "to": "reshape", "assignment": "reshape"}


class FormationVehicle(Part):
    """One vehicle and its position at t = 0."""

    degree_keys = (POSITION,)

    sysid: SysId = Field(description="MAVLink system id")
    position_m: Place = Field(description="north, east, height at t = 0, m")
    autopilot: AutopilotKey | None = left_out("its autopilot, where a fleet is mixed; left out: mission.autopilot")


class ShapeTable(Part):
    """A named shape: a list of offsets, or a generator for any number of vehicles."""

    name: ShapeName = Field(description="name of the shape, for changes")
    generator: Generator | None = Field(default=None, description="a shape for any number of vehicles")
    spacing_m: Length | None = Field(default=None, description="generator: distance between neighbours, m")
    heading_deg: Turn | None = left_out(
        "generator: direction of its front, degrees clockwise from north; left out: north"
    )
    offsets_m: tuple[Place, ...] = Field(
        default=(),
        max_length=10_000,
        description="instead of a generator: north, east, up from the leader, one per vehicle in order, m",
    )

    def _disagreements(self) -> Findings:
        if self.name == START_SHAPE:
            yield ("name",), "is the name of the shape at t = 0", "give this shape another name"
        if self.generator is None and not self.offsets_m:
            yield (), "has no places", "give generator and spacing_m, or offsets_m"
        elif self.generator is None and self.spacing_m is not None:
            yield ("spacing_m",), "has no effect on offsets_m", "remove it, or give a generator instead of them"
        elif self.generator is None and self.heading_deg is not None:
            yield ("heading_deg",), "has no effect on offsets_m", "remove it, or give a generator instead of them"
        elif self.generator is not None and self.offsets_m:
            yield ("offsets_m",), f'generator = "{self.generator}" defines the places already', "keep one of the two"
        if self.generator is not None and self.spacing_m is None:
            yield ("spacing_m",), f'missing; generator = "{self.generator}" needs the distance between neighbours, m'


class ChangeTable(Part):
    """One change of shape (§2.2.1-2.2.3) and its time."""

    degree_keys = (GATE,)

    kind: Literal["rotate", "shrink", "reshape"] = Field(description="Eqs. 5-8, 9-12 or 13-14")
    at_s: Annotated[Number, Field(ge=0, le=FLIGHT_MAX_S)] | None = Field(
        default=None, description="begins at this time, s"
    )
    done_at_s: Annotated[Number, Field(gt=0, le=FLIGHT_MAX_S)] | None = left_out(
        "is complete at this time, s: it begins as much earlier as it takes"
    )
    gate_m: tuple[Point, Point] | None = Field(
        default=None, description="begins when the leader crosses the line between these two points (north, east), m"
    )
    at_point: Annotated[int, Strict(), Field(ge=1, le=100)] | None = left_out(
        "begins when the leader is at this point of [[route]]; the first is 1, later rounds count on"
    )
    auto: Truth = Field(default=False, description="the planner chooses the time and the amount")
    angle_deg: Turn | None = Field(
        default=None,
        description="rotate: angle about `axis`; with auto, the largest angle in either direction, degrees",
    )
    axis: Direction | None = Field(
        default=None,
        description="rotate: axis north, east, up; right-handed. Left out: straight down, so that + turns right",
    )
    scale: Annotated[Number, Field(ge=0.001, le=10)] | None = Field(
        default=None, description="shrink: new size over old size; with auto, the smallest one allowed"
    )
    to: str | None = Field(default=None, description=f'reshape: name of a shape, or "{START_SHAPE}"')
    assignment: Literal["free", "fixed"] | None = Field(
        default=None,
        description="reshape: assignment of vehicles to places; free (left out) is the fastest one (Eq. 14)",
    )
    weight: Annotated[Number, Field(gt=0, le=1e6)] | None = Field(
        default=None, description="auto: cost of a whole flight in the fully changed shape, in units of Eq. 35"
    )

    @property
    def timed(self) -> tuple[str, float | None]:
        """The key that gives its time, and that time; None where a gate, a point or the planner gives it."""
        return ("at_s", self.at_s) if self.done_at_s is None else ("done_at_s", self.done_at_s)

    def begin_s(self, duration_s: float) -> float | None:
        """When it begins, if it takes so long; None where a gate, a point or the planner gives its time."""
        return self.at_s if self.done_at_s is None else self.done_at_s - duration_s

    def _disagreements(self) -> Findings:
        yield from self._when()
        yield from self._what()
        if self.auto:
            yield from self._automatic()
        elif self.weight is not None:
            yield ("weight",), "is the cost of auto = true", "remove it, or set auto = true"

    def _when(self) -> Findings:
        triggers = "at_s", "done_at_s", "gate_m", "at_point"
        times = {name: getattr(self, name) is not None for name in triggers} | {"auto": self.auto}
        given = [key for key, is_given in times.items() if is_given]
        if not given:
            yield (), "has no time", "give one of at_s, done_at_s, gate_m, at_point and auto = true"
        for key in given[1:]:
            yield (key,), f"{given[0]} sets the time already", "keep one of the two"
        if self.gate_m is not None and self.gate_m[0] == self.gate_m[1]:
            yield ("gate_m",), "is a single point", "give two different points"

    def _what(self) -> Findings:
        for key, kind in _KIND_OF_KEY.items():
            given = getattr(self, key) is not None
            if given and self.kind != kind:
                yield (key,), f'has no effect with kind = "{self.kind}"', f'remove it, or give kind = "{kind}"'
            if not given and self.kind == kind and key in _NEEDED:
                yield (key,), f'missing; kind = "{kind}" needs it ({type(self).model_fields[key].description})'
        if self.axis is not None and max(map(abs, self.axis)) < _AXIS_LEAST:
            yield ("axis",), "has no direction", "give for example [0, 0, 1], straight up"

    def _automatic(self) -> Findings:
        if self.kind == "rotate" and self.axis is not None:
            yield ("axis",), "an automatic rotation turns about the vertical", "remove axis"
        if self.kind == "rotate" and self.angle_deg is not None and self.angle_deg <= 0:
            yield ("angle_deg",), "must be > 0: with auto it is the largest angle in either direction"
        if self.kind == "shrink" and self.scale is not None and self.scale >= 1:
            yield ("scale",), "must be < 1: with auto it is the smallest size that the planner may choose"


class Formation(Part):
    """The virtual rigid body: its vehicles, its shapes and its changes."""

    frame: Literal["inertial", "course"] = Field(
        default="inertial",
        description="inertial: the shape keeps its direction (Eq. 22); course: it turns with the leader's course, "
        "and scheduled changes have half of change_speed_mps and change_accel_mps2",
    )
    leader: VehicleId = Field(default=1, description="sysid of the leader, whose trajectory is planned")
    vehicle: tuple[FormationVehicle, ...] = Field(
        default=(), max_length=254, description="every vehicle, leader included; or give count and start_shape"
    )
    count: Annotated[int, Strict(), Field(ge=1, le=10_000)] | None = Field(
        default=None, description="number of vehicles 1, 2, ... in start_shape; up to 254 can be flown"
    )
    start_shape: str | None = Field(default=None, description="with count: name of the shape at t = 0")
    shape: tuple[ShapeTable, ...] = Field(default=(), max_length=100, description="named shapes")
    change: tuple[ChangeTable, ...] = Field(default=(), max_length=100, description="changes of shape, in order")
    change_speed_mps: Speed = Field(default=1.0, description="v_max of a change: a vehicle's speed in the shape, m/s")
    change_accel_mps2: Acceleration = Field(default=0.3, description="a_max of a change, m/s^2")
    course_tolerance_deg: Annotated[Number, Field(ge=0.01, le=45)] = Field(
        default=5.0, description="with frame = course: largest lag of the shape's heading behind the course, degrees"
    )
    topology: Topology = Field(
        default="leader",
        description="vehicles whose reports a follower uses with --follow: leader: the leader (a star); chain: the one "
        "before it; voronoi: its Voronoi neighbours nearer to the leader; tree: the nearest of those",
    )

    @property
    def sysids(self) -> tuple[int, ...]:
        """The system ids in order."""
        if self.count is not None:
            return tuple(range(1, self.count + 1))
        return tuple(v.sysid for v in self.vehicle)

    @property
    def ends_in_start_shape(self) -> bool:
        """Whether every vehicle ends where it started, seen from the leader.

        Automatic changes undo themselves; scheduled ones and a shape that turns with the course do not.
        """
        return self.frame == "inertial" and all(change.auto for change in self.change)

    def _disagreements(self) -> Findings:
        if self.count is None and not self.vehicle:
            yield (), "has no vehicles", "give [[formation.vehicle]] tables, or count and start_shape"
        else:
            yield from self._fleet()
            yield from self._places()
        yield from self._names()
        yield from self._schedule()

    def _fleet(self) -> Findings:
        if self.vehicle and self.count is not None:
            text = f"there are {len(self.vehicle)} [[formation.vehicle]] tables already"
            yield ("count",), text, "keep one of the two"
        rows: dict[int, int] = {}
        for row, vehicle in enumerate(self.vehicle):
            if rows.setdefault(vehicle.sysid, row) != row:
                text = f"is the sysid of vehicle[{rows[vehicle.sysid]}] already"
                yield ("vehicle", row, "sysid"), text, "give each vehicle its own"
        ids = self.sysids
        if self.leader not in ids:
            there = f"are {', '.join(map(str, ids))}" if len(ids) <= 10 else f"are {ids[0]} to {ids[-1]}"
            yield ("leader",), f"is not the sysid of a vehicle; there {there}"

    def _places(self) -> Findings:
        if self.count is not None and self.start_shape is None:
            yield ("start_shape",), "missing; count needs the name of a [[formation.shape]] to start in"
        if self.count is None and self.start_shape is not None:
            text = "belongs to count; [[formation.vehicle]] tables have positions"
            yield ("start_shape",), text, "keep one of the two"
        count = len(self.sysids)
        for index, shape in enumerate(self.shape):
            if shape.offsets_m and len(shape.offsets_m) != count:
                missing = self._missing_sysids(len(shape.offsets_m) - count)
                text = f"has {len(shape.offsets_m)} places for {count} vehicles{missing}"
                yield ("shape", index, "offsets_m"), text, "give one for each, leader included"

    def _missing_sysids(self, places: int) -> str:
        """The vehicles that are missing in a row of numbers, where they are as many as the places too many."""
        ids = self.sysids
        holes = sorted(set(range(1, max(ids, default=0))) - set(ids))
        if not holes or len(holes) != places:
            return ""
        more = f" and {len(holes) - _HOLES} more" if len(holes) > _HOLES else ""
        are = "vehicle {} is" if len(holes) == 1 else "vehicles {} are"
        return f"; {are.format(', '.join(map(str, holes[:_HOLES])) + more)} missing in formation.vehicle"

    def _names(self) -> Findings:
        names = [shape.name for shape in self.shape]
        for index, name in enumerate(names):
            if name in names[:index]:
                yield ("shape", index, "name"), f"is the name of shape[{names.index(name)}] already", "give another one"
        if self.start_shape is not None and self.start_shape not in names:
            yield ("start_shape",), *_no_such_shape(self.start_shape, names)
        for index, change in enumerate(self.change):
            if change.to is not None and change.to not in (START_SHAPE, *names):
                yield ("change", index, "to"), *_no_such_shape(change.to, [START_SHAPE, *names])

    def _schedule(self) -> Findings:
        first: dict[str, int] = {}
        latest = 0
        for index, change in enumerate(self.change):
            if change.auto:
                if first.setdefault(change.kind, index) != index:
                    text = f'change[{first[change.kind]}] with kind = "{change.kind}" is automatic already'
                    yield ("change", index, "auto"), text, "keep one"
                if change.kind == "rotate" and self.frame == "course":
                    text = 'with frame = "course" the heading follows the course'
                    yield ("change", index, "auto"), text, "give at_s or gate_m, or remove it"
            key, time_s = change.timed
            if time_s is not None:
                before_key, before_s = self.change[latest].timed
                if before_s is not None and time_s < before_s:
                    does = "begins" if before_key == "at_s" else "is complete"
                    text = f"is before change[{latest}], which {does} at {before_s:g} s"
                    yield ("change", index, key), text, "give changes in order of time"
                latest = index


def _no_such_shape(name: str, names: list[str]) -> tuple[str, str]:
    if near := nearest(name, names):
        return "is the name of no shape", f'write "{near}"'
    known = ", ".join(f'"{known}"' for known in names) if names else "none yet"
    return f"is the name of no shape; [[formation.shape]] tables give names, and there are {known}", ""
