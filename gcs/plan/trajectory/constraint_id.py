"""The identity of a constraint, shared by rows of the program, violations and checks; its text is for people only."""

from dataclasses import dataclass
from enum import Enum

from gcs.physics.states import NU, NX
from gcs.plan.formation.coordinates import CoordinateName
from gcs.scenario.environment.no_fly import ZoneName


class Kind(Enum):
    """What is constrained. The value is its text; `{of}` says which of several."""

    # States and controls of Eq. 1, in the order of their columns.
    NORTH = "north position"
    EAST = "east position"
    HEIGHT = "height"
    NORTH_SPEED = "north speed"
    EAST_SPEED = "east speed"
    VERTICAL_SPEED = "vertical speed"
    ROLL = "roll"
    PITCH = "pitch"
    YAW = "yaw"
    ROLL_RATE = "roll rate"
    PITCH_RATE = "pitch rate"
    YAW_RATE = "yaw rate"
    U1 = "thrust U1"
    U2 = "control U2"
    U3 = "control U3"
    U4 = "control U4"
    # The motion of one vehicle.
    LEAST_THRUST = "least thrust"
    LARGEST_THRUST = "largest thrust"
    THRUST_GROWTH = "rate of the growing thrust"
    THRUST_FALL = "rate of the falling thrust"
    ROTOR_SPEED = "rotor speed"
    TURNING = "turning load factor"
    ACCELERATION = "acceleration"
    JERK = "jerk"
    DRIFT = "Eq. 1 re-integrated over 5 s"
    # Places.
    CLEARANCE = "clearance above ground"
    HEIGHT_ABOVE_GROUND = "height above ground"
    BESIDE_PAD = "distance to the ground beside the pad"
    ZONE = "zone"
    # The formation.
    COORDINATE = "coordinate of the shape"
    SHAPE_SPEED = "speed in the shape"
    SHAPE_ACCELERATION = "acceleration in the shape"
    SEPARATION = "separation"
    PAD_SEPARATION = "separation over the pads"
    PLACE = "place in formation"
    COURSE = "heading along the course"
    FORWARDS = "flight towards the formation's front"
    CHANGE_TIMES = "changes begin when they should"
    ASSIGNMENT = "shortest assignment of a reshape (Eq. 14)"
    # Joints and ends.
    STATE_JOINTS = "state continuous at joints"
    CONTROL_JOINTS = "control continuous at joints"
    ACCELERATION_JOINTS = "acceleration continuous at joints"
    START_POSITION = "start position"
    START_VELOCITY = "start velocity"
    START_ATTITUDE = "start attitude"
    END_POSITION = "end position"
    END_VELOCITY = "end velocity"
    END_ATTITUDE = "end attitude"
    TAKEOFF_POINT = "take-off point"
    LANDING_POINT = "landing point"
    ARRIVAL_TIME = "arrival time"
    FLIGHT_TIME = "time of flight"
    BATTERY = "battery at the last touch-down, above its reserve"
    # The route.
    LEG_DURATION = "duration of leg {of}"
    LEG_CORRIDOR = "leg {of}: distance beside the line"
    LEG_HEIGHT = "leg {of}: distance above or below the line"
    LEG_ENDS = "leg {of}: distance beyond its ends"
    LEG_YAW = "leg {of}: yaw"
    POINTS_PASSED = "route points passed"
    POINT_ORDER = "route {of}: order"
    POINT_DISTANCE = "route {of}: distance"
    POINT_TIME = "route {of}: time"
    POINT_SPEED = "route {of}: speed"
    POINT_HEADING = "route {of}: heading"
    HOLD_DISTANCE = "route {of}: distance during the hold"
    HOLD_SPEED = "route {of}: speed during the hold"


STATES, CONTROLS = tuple(Kind)[:NX], tuple(Kind)[NX : NX + NU]
COLUMNS = {kind: column for column, kind in enumerate((*STATES, *CONTROLS))}  # of the state, then of the control
ANGLES = frozenset((*STATES[6:], Kind.COURSE, Kind.LEG_YAW))  # angles and their rates: people read them in degrees


class Form(Enum):
    """As what it is constrained. The value is the text of most kinds."""

    CRITERION = "{what}"  # of all vehicles
    BOUND = "limit of {what}"  # of one unknown of the program
    MOTION = "Eq. 1 for {what}"  # a row of the collocation
    ROW = "{what} of vehicle {vehicle}"  # a row of the path, or about a point


_TEXTS = {
    (Kind.ZONE, Form.CRITERION): "{of}{part}",
    (Kind.COORDINATE, Form.CRITERION): "{of}{part}",
    (Kind.COORDINATE, Form.BOUND): "limit of {of}{part}",
    (Kind.COORDINATE, Form.MOTION): "Eq. 1 for {of}{part}",
    (Kind.LEG_DURATION, Form.BOUND): "limit of the {what}",
    (Kind.FLIGHT_TIME, Form.BOUND): "limit of the {what}",
    (Kind.CLEARANCE, Form.ROW): "clearance of vehicle {vehicle}{part}",
    (Kind.ZONE, Form.ROW): "{of}{part} for vehicle {vehicle}",
    (Kind.TURNING, Form.ROW): "turning radius of vehicle {vehicle}",
    (Kind.NORTH, Form.ROW): "north of vehicle {vehicle}",
    (Kind.EAST, Form.ROW): "east of vehicle {vehicle}",
    (Kind.JERK, Form.ROW): "jerk of the formation",
    (Kind.LEG_CORRIDOR, Form.ROW): "{what}",
    (Kind.LEG_HEIGHT, Form.ROW): "{what}",
    (Kind.LEG_YAW, Form.ROW): "{what}",
    (Kind.COURSE, Form.ROW): "heading of the formation along its course",
    (Kind.POINT_DISTANCE, Form.ROW): "distance to {of}",
    (Kind.POINT_SPEED, Form.ROW): "speed at {of}",
    (Kind.POINT_TIME, Form.ROW): "time of {of}",
    (Kind.CHANGE_TIMES, Form.ROW): "time that change {of} of the shape takes",
}
_DERIVATIVES = ("", "'s rate", "'s acceleration", "'s jerk", "'s snap")


@dataclass(frozen=True)
class PointName:
    """What messages call a point of the route."""

    number: int  # 1 is the first point of the first round
    name: str = ""

    @property
    def short(self) -> str:
        """Under a heading that says "point"."""
        return f'{self.number} ("{self.name}")' if self.name else str(self.number)

    def __str__(self) -> str:
        return f"point {self.short}"


@dataclass(frozen=True)
class ConstraintId:
    """One constraint. Code compares its fields; `str` is its name in messages, reports and plan files."""

    kind: Kind
    form: Form = Form.CRITERION
    of: ZoneName | PointName | CoordinateName | int | None = None  # which zone, point, coordinate or leg (from 1)
    part: int = 0  # piece of a zone (from 1), foot beside a vehicle, order of the derivative of a coordinate
    vehicle: int | None = None  # system id

    @property
    def is_of_route(self) -> bool:
        """Whether a point of the route or a line between two asks for it."""
        route = Kind.POINTS_PASSED, Kind.LEG_CORRIDOR, Kind.LEG_HEIGHT, Kind.LEG_ENDS, Kind.LEG_YAW
        return isinstance(self.of, PointName) or self.kind in route

    def __str__(self) -> str:
        what = self.kind.value.format(of=self.of)
        text = _TEXTS.get((self.kind, self.form), self.form.value)
        return text.format(what=what, of=self.of, part=self._part, vehicle=self.vehicle)

    @property
    def _part(self) -> str:
        if self.kind is Kind.COORDINATE:
            return _DERIVATIVES[self.part]
        if not self.part:
            return ""
        return f", part {self.part}" if self.kind is Kind.ZONE else ", other side"
