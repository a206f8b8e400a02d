"""The operator's choices for a flight, which the commands offer too: it imports nothing else of Skein."""

from dataclasses import dataclass
from enum import StrEnum


class FlightMode(StrEnum):
    """What keeps the time: the ground station by setpoints, or each vehicle by its own waypoint mission."""

    STREAM = "stream"
    MISSION = "mission"


class NavigatorChoice(StrEnum):
    """The waypoint navigator of emulated vehicles: the autopilot's, one that keeps the plan's times, or the fit one."""

    AUTO = "auto"
    OWN = "own"
    IDEAL = "ideal"


@dataclass(frozen=True)
class TimeKeeping:
    """How a flight's missions keep time. `navigator` is that of emulated vehicles."""

    mode: FlightMode
    emulated: bool
    navigator: NavigatorChoice = NavigatorChoice.AUTO
    gates: int = 0


class OnLoss(StrEnum):
    """What the other vehicles do when a vehicle is lost."""

    LAND = "land"
    RETURN = "return"
    CONTINUE = "continue"
    CLOSE = "close"


class OnLeaderLoss(StrEnum):
    """What the followers do when their leader is lost or leaves the formation."""

    PROMOTE = "promote"
    RETURN = "return"


@dataclass(frozen=True)
class Choices:
    """What the contingency policy does where the operator may choose."""

    on_loss: OnLoss = OnLoss.LAND
    on_leader_loss: OnLeaderLoss = OnLeaderLoss.PROMOTE
    follow: bool = False
    own_missions: bool = False  # vehicles fly missions on board: nobody else keeps them in time
