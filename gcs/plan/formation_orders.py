"""What may be asked of the plan of a whole formation in flight."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.scenario.schema.scenario import NoFlyZone


@dataclass(frozen=True)
class Avoid:
    """A disk that no vehicle may enter from now on, m north and east of the origin."""

    north_m: float
    east_m: float
    radius_m: float

    @property
    def zone(self) -> NoFlyZone:
        """The same as a zone of a scenario."""
        return NoFlyZone(north_m=self.north_m, east_m=self.east_m, radius_m=self.radius_m)

    def __str__(self) -> str:
        return f"avoid {self.radius_m:g} m around ({self.north_m:g}, {self.east_m:g})"


@dataclass(frozen=True)
class Scale:
    """The shape grows or shrinks to this share of its size."""

    factor: float

    def __str__(self) -> str:
        return f"scale its shape by {self.factor:g}"


@dataclass(frozen=True)
class Reshape:
    """The formation takes the shape of this name of its scenario."""

    name: str

    def __str__(self) -> str:
        return f'take the shape "{self.name}"'


@dataclass(frozen=True)
class FlyHome:
    """The formation flies home together and lands on its pads."""

    zones: tuple[NoFlyZone, ...] = ()  # that came up, which its plan does not keep out of

    def __str__(self) -> str:
        return "fly home together"


@dataclass(frozen=True)
class Slower:
    """The rest of the plan at this share of its speeds."""

    factor: float

    def __str__(self) -> str:
        return f"fly at {self.factor:g} times its speed"


@dataclass(frozen=True)
class Hold:
    """The formation brakes as one, hovers in its shape, and lands there if no order follows for five minutes."""

    zones: tuple[NoFlyZone, ...] = ()  # that came up, before which it brakes

    def __str__(self) -> str:
        return "brake together before the zone" if self.zones else "hold together"


@dataclass(frozen=True)
class GoTo:
    """The formation flies straight to a place of its leader, and hovers there as after `Hold`; m from the origin."""

    north_m: float
    east_m: float
    height_m: float

    def __str__(self) -> str:
        return f"go to ({self.north_m:g}, {self.east_m:g}) at {self.height_m:g} m"


@dataclass(frozen=True)
class GoOn:
    """The formation goes on with the plan that it left to hold or to go elsewhere; a slower one at its first speed."""

    def __str__(self) -> str:
        return "go on with its plan"


@dataclass(frozen=True)
class CloseRanks:
    """The vehicles `sysids` fly on without those that left the formation, which may be in `zones` from now on."""

    sysids: tuple[int, ...]
    zones: tuple[NoFlyZone, ...]

    def __str__(self) -> str:
        return f"close ranks and fly on with {len(self.sysids)} vehicle{'s' if len(self.sysids) > 1 else ''}"


PlanOrder = Avoid | Scale | Reshape | Slower | Hold | GoTo | GoOn | FlyHome | CloseRanks
PACED = (Slower, Hold, GoTo, GoOn)  # that need no optimiser, unless a zone came up
