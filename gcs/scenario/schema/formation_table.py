"""The table [formation]: who flies where, the shapes that have names, and how the formation changes.

Knows: keys, types, ranges, and what must agree inside this table. Does not know: limits, times and places of the
flight (`gcs.scenario.validation.formation_rules` compares them), where a generator puts vehicles, plans.
"""

from __future__ import annotations

import difflib
from typing import Annotated, Literal

from pydantic import Field, Strict

from gcs.scenario.schema.fields import Findings, NonNegative, Number, Part, Point, Positive, Truth, Vector

SysId = Annotated[int, Strict(), Field(ge=1, le=254)]
VehicleId = Annotated[int, Strict(), Field(ge=1, le=10_000)]  # of a fleet too large for one MAVLink network
ShapeName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
Generator = Literal["triangle", "line", "column", "vee", "grid", "circle", "sphere"]

START_SHAPE = "start"  # what changes call the shape at t = 0
_NEEDED = ("angle_deg", "scale", "to")
_KIND_OF_KEY = {"angle_deg": "rotate", "axis": "rotate", "scale": "shrink", "to": "reshape", "assignment": "reshape"}


class FormationVehicle(Part):
    """One vehicle and where it is at t = 0."""

    sysid: SysId = Field(description="MAVLink system id")
    position_m: Vector = Field(description="north, east, height at t = 0, m")


class ShapeTable(Part):
    """A named shape: a table of offsets, or a generator for any number of vehicles."""

    name: ShapeName = Field(description="what changes call it")
    generator: Generator | None = Field(default=None, description="a shape for any number of vehicles")
    spacing_m: Positive | None = Field(default=None, description="distance between neighbours of a generator, m")
    offsets_m: tuple[Vector, ...] = Field(
        default=(), description="north, east, up from the leader, one for every vehicle in order, m"
    )

    def disagreements(self) -> Findings:
        """No places, or places said twice."""
        if self.name == START_SHAPE:
            yield ("name",), "is what changes call the shape at t = 0; give this one another name"
        if self.generator is None and not self.offsets_m:
            yield (), "has no places; give generator and spacing_m, or offsets_m"
        elif self.generator is None and self.spacing_m is not None:
            yield ("spacing_m",), "means nothing to offsets_m; leave it out, or give a generator in their place"
        elif self.generator is not None and self.offsets_m:
            yield (
                ("offsets_m",),
                f'generator = "{self.generator}" says already where the places are; keep one of the two',
            )
        if self.generator is not None and self.spacing_m is None:
            yield ("spacing_m",), f'missing; generator = "{self.generator}" needs the distance between neighbours, m'


class ChangeTable(Part):
    """One change of shape (§2.2.1-2.2.3): what, and when."""

    kind: Literal["rotate", "shrink", "reshape"] = Field(description="Eqs. 5-8, 9-12 or 13-14")
    at_s: NonNegative | None = Field(default=None, description="begins at this time, s")
    gate_m: tuple[Point, Point] | None = Field(
        default=None, description="begins when the leader crosses the line between these two (north, east), m"
    )
    auto: Truth = Field(default=False, description="the planner decides when and how far")
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

    def disagreements(self) -> Findings:
        """Not one time to begin at, and keys of another kind of change."""
        yield from self._when()
        yield from self._what()
        if self.auto:
            yield from self._of_its_own_accord()
        elif self.weight is not None:
            yield ("weight",), "is what auto = true costs; leave it out"

    def _when(self) -> Findings:
        said = {"at_s": self.at_s is not None, "gate_m": self.gate_m is not None, "auto": self.auto}
        given = [key for key, is_given in said.items() if is_given]
        if not given:
            yield (), "does not say when; give one of at_s, gate_m and auto = true"
        for key in given[1:]:
            yield (key,), f"{given[0]} says already when; keep one of the two"
        if self.gate_m is not None and self.gate_m[0] == self.gate_m[1]:
            yield ("gate_m",), "is a point; a gate lies between two different ones"

    def _what(self) -> Findings:
        for key, kind in _KIND_OF_KEY.items():
            given = getattr(self, key) is not None
            if given and self.kind != kind:
                yield (key,), f'means nothing to kind = "{self.kind}"; leave it out, or give kind = "{kind}"'
            if not given and self.kind == kind and key in _NEEDED:
                yield (key,), f'missing; kind = "{kind}" needs it ({type(self).model_fields[key].description})'
        if self.axis is not None and not any(self.axis):
            yield ("axis",), "has no direction; [0, 0, 1] is straight up"

    def _of_its_own_accord(self) -> Findings:
        if self.kind == "rotate" and self.axis is not None:
            yield ("axis",), "an automatic rotation turns about the vertical; leave axis out"
        if self.kind == "rotate" and self.angle_deg is not None and self.angle_deg <= 0:
            yield ("angle_deg",), "must be > 0: with auto it turns at most so much either way"
        if self.kind == "shrink" and self.scale is not None and self.scale >= 1:
            yield ("scale",), "must be below 1: with auto it is the smallest size the planner may choose"


class Formation(Part):
    """The virtual rigid body: who flies where in it, and how it changes."""

    frame: Literal["inertial", "course"] = Field(
        default="inertial", description="where the shape is constant: in the world (Eq. 22), or turning with the course"
    )
    leader: VehicleId = Field(default=1, description="sysid of the vehicle the plan is made for")
    vehicle: tuple[FormationVehicle, ...] = Field(
        default=(), max_length=254, description="every vehicle, leader included; or count and start_shape"
    )
    count: Annotated[int, Strict(), Field(ge=1, le=10_000)] | None = Field(
        default=None, description="number of vehicles 1, 2, ... that stand in start_shape; up to 254 can be flown"
    )
    start_shape: str | None = Field(default=None, description="name of the shape at t = 0, with count")
    shape: tuple[ShapeTable, ...] = Field(default=(), description="shapes that changes name")
    change: tuple[ChangeTable, ...] = Field(default=(), description="changes of shape, in order")
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

    @property
    def sysids(self) -> tuple[int, ...]:
        """System ids in order."""
        if self.count is not None:
            return tuple(range(1, self.count + 1))
        return tuple(v.sysid for v in self.vehicle)

    @property
    def ends_in_start_shape(self) -> bool:
        """Whether every vehicle ends where it started, seen from the leader.

        Automatic changes undo themselves; scheduled ones and a shape that turns with the course do not.
        """
        return self.frame == "inertial" and all(change.auto for change in self.change)

    def disagreements(self) -> Findings:
        """Vehicles, shapes and changes that do not belong together."""
        if self.count is None and not self.vehicle:
            yield (), "has no vehicles; give [[formation.vehicle]] tables, or count and start_shape"
        else:
            yield from self._fleet()
            yield from self._places()
        yield from self._names()
        yield from self._schedule()

    def _fleet(self) -> Findings:
        if self.vehicle and self.count is not None:
            yield ("count",), f"there are {len(self.vehicle)} [[formation.vehicle]] tables already; keep one of the two"
        rows: dict[int, int] = {}
        for row, vehicle in enumerate(self.vehicle):
            if rows.setdefault(vehicle.sysid, row) != row:
                text = f"is the sysid of vehicle[{rows[vehicle.sysid]}] already; every vehicle needs one of its own"
                yield ("vehicle", row, "sysid"), text
        ids = self.sysids
        if self.leader not in ids:
            there = f"are {', '.join(map(str, ids))}" if len(ids) <= 10 else f"are {ids[0]} to {ids[-1]}"
            yield ("leader",), f"is not the sysid of a vehicle; there {there}"

    def _places(self) -> Findings:
        if self.count is not None and self.start_shape is None:
            yield ("start_shape",), "missing; count needs the name of a [[formation.shape]] to start in"
        if self.count is None and self.start_shape is not None:
            yield ("start_shape",), "belongs to count; where [[formation.vehicle]] tables start, they say themselves"
        count = len(self.sysids)
        for index, shape in enumerate(self.shape):
            if shape.offsets_m and len(shape.offsets_m) != count:
                text = f"has {len(shape.offsets_m)} places for {count} vehicles; give one for each, leader included"
                yield ("shape", index, "offsets_m"), text

    def _names(self) -> Findings:
        names = [shape.name for shape in self.shape]
        for index, name in enumerate(names):
            if name in names[:index]:
                yield ("shape", index, "name"), f"is the name of shape[{names.index(name)}] already; give another one"
        if self.start_shape is not None and self.start_shape not in names:
            yield ("start_shape",), _no_such_shape(self.start_shape, names)
        for index, change in enumerate(self.change):
            if change.to is not None and change.to not in (START_SHAPE, *names):
                yield ("change", index, "to"), _no_such_shape(change.to, [START_SHAPE, *names])

    def _schedule(self) -> Findings:
        first: dict[str, int] = {}
        latest = 0
        for index, change in enumerate(self.change):
            if change.auto:
                if first.setdefault(change.kind, index) != index:
                    text = f'change[{first[change.kind]}] with kind = "{change.kind}" is automatic already; keep one'
                    yield ("change", index, "auto"), text
                if change.kind == "rotate" and self.frame == "course":
                    text = 'with frame = "course" the heading follows the course; give at_s or gate_m, or leave it out'
                    yield ("change", index, "auto"), text
            if change.at_s is not None:
                before = self.change[latest].at_s
                if before is not None and change.at_s < before:
                    text = f"is before change[{latest}], which begins at {before:g} s; give changes in order of time"
                    yield ("change", index, "at_s"), text
                latest = index


def _no_such_shape(name: str, names: list[str]) -> str:
    if near := difflib.get_close_matches(name, names, n=1):
        return f'is the name of no shape; the nearest one is "{near[0]}"'
    known = ", ".join(f'"{known}"' for known in names) if names else "none yet"
    return f"is the name of no shape; [[formation.shape]] tables give names, and there are {known}"
