"""Progress of a flight: steps, times, snapshots, events, and the watchers and hooks that receive them.

`PlanTime` is the plan's time by the vehicles' common time; after a pause of this program it goes on with a later T0.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, ParamSpec, Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.flight.monitoring.own_battery import ChargeRule
from gcs.link.session.unknown_systems import LinkNotice
from gcs.link.session.upload_fleet import Holdings
from gcs.types import Array

if TYPE_CHECKING:
    from gcs.flight.monitoring.preflight_check import PreflightCheck
    from gcs.plan.formation_orders import PlanOrder
    from gcs.plan.trajectory.plan import Plan

_SAME_S = 1e-3


@dataclass(frozen=True)
class PlanTime:
    """The T0 of each piece of a flight, with the time from which it counts, in order; the first counts from -inf.

    While vehicles were led back to the plan, the plan waited at the time at which the next piece begins.
    """

    pieces: tuple[tuple[float, float], ...]  # (since, T0), unix s
    led_back: tuple[tuple[float, float], ...] = ()  # from a standstill until all were on the plan again, unix s

    @classmethod
    def of(
        cls, t0_unix_s: float, known: Iterable[tuple[float, float]] = (), led_back: tuple[tuple[float, float], ...] = ()
    ) -> PlanTime:
        """The plan time of a flight with this last T0. `known`: common and plan times of events, as they were noted."""
        pieces: list[tuple[float, float]] = []
        for unix_s, t_s in sorted(one for one in known if math.isfinite(one[0] - one[1])):
            if not pieces or unix_s - t_s > pieces[-1][1] + _SAME_S:
                pieces.append((unix_s if pieces else -math.inf, unix_s - t_s))
        if not pieces or abs(pieces[-1][1] - t0_unix_s) > _SAME_S:
            return cls(((-math.inf, t0_unix_s),), led_back)
        return cls((*pieces[:-1], (pieces[-1][0], t0_unix_s)), led_back)

    @property
    def t0_unix_s(self) -> float:
        """The last T0."""
        return self.pieces[-1][1]

    def t_s(self, unix_s: Array) -> Array:
        """Return plan times (N,) of common times (N,); they never run back."""
        since_s, t0_s = np.array(self.pieces).T
        begins_s = np.append((since_s - t0_s)[1:], np.inf)
        waits_s = np.minimum.accumulate(begins_s[::-1])[::-1]
        piece = np.searchsorted(since_s, unix_s, side="right") - 1
        return np.asarray(np.minimum(unix_s - t0_s[piece], waits_s[piece]))

    def off_plan(self, unix_s: Array) -> NDArray[np.bool_]:
        """Return whether, at common times (N,), a standstill had led the vehicles off the plan."""
        off = np.zeros(len(unix_s), dtype=np.bool_)
        for begin_s, end_s in self.led_back:
            off |= (unix_s >= begin_s) & (unix_s < end_s)
        return off


P = ParamSpec("P")
_RULE = "Only the vehicles of the plan are listened to, each at its own address"


class Step(StrEnum):
    """The steps of a flight, in order."""

    UPLOAD = "upload and read back"
    READY = "waiting for readiness"
    TAKEOFF = "take-off"
    FLY = "flying"
    LAND = "landing"
    DONE = "landed"


class AskedOrder(StrEnum):
    """What the operator may order in flight; the contingency policy says which vehicles then do it."""

    HOLD = "hold"
    LAND = "land"
    RETURN = "return"
    CONTINUE = "continue"


class Action(StrEnum):
    """What a vehicle is ordered to do."""

    HOLD = "hold"
    SPREAD = "climb"
    RETURN = "return"
    DIVERT = "land at the nearest safe point"
    LAND = "land"
    LEAVE = "release"
    PROMOTE = "lead"
    REJOIN = "rejoin"
    OBEY = "follow setpoints again"


class FlightPart(StrEnum):
    """The parts of a flight, each with its own least separation: near the ground, and on the plan."""

    TAKEOFF = "take-off"  # from arming to T0
    FLIGHT = "flight"  # from T0 to the order to land
    LANDING = "landing"  # to the last stop


@dataclass(frozen=True)
class NearestPair:
    """The two vehicles that came nearest to each other in one part of a flight."""

    part: FlightPart
    pair: tuple[int, int]  # system ids
    distance_m: float
    unix_s: float

    def __str__(self) -> str:
        return f"{self.part} {self.distance_m:.2f} m (vehicles {self.pair[0]}, {self.pair[1]})"


@dataclass(frozen=True)
class FlightTimes:
    """The times of a completed flight, in the vehicles' common GNSS time."""

    airborne_unix_s: float  # all vehicles hover over their pads
    t0_unix_s: float  # plan time 0; of the last piece, if T0 moved
    landing_unix_s: float  # all vehicles are ordered to land
    clock: PlanTime | None = None  # of a flight whose T0 may have moved

    @property
    def plan_time(self) -> PlanTime:
        """The plan time of every instant of the flight."""
        return self.clock or PlanTime.of(self.t0_unix_s)


def flown_plan_time(t0_unix_s: float, events: Collection[Event]) -> PlanTime:
    """Return the plan time of a flight with this last T0, by its events."""
    led_back = []
    for each in events:
        match (each.data or {}).get(OFF_PLAN):
            case (float(begin_s), float(end_s)) | [float(begin_s), float(end_s)]:
                led_back.append((begin_s, end_s))
    return PlanTime.of(t0_unix_s, ((each.unix_s, each.t_s) for each in events), tuple(led_back))


@dataclass(frozen=True)
class Snapshot:
    """The flight at one moment, for display."""

    phase: str
    progress: float  # of the whole flight, 0..1
    plan_time_s: float | None
    errors_m: dict[int, float]
    link_age_s: dict[int, float]
    armed: dict[int, bool]
    separation_m: float
    formation_error_m: float  # Definition 1
    plan_phase: str = ""  # of the plan: hover, mission, ...; empty outside of it
    plan_end_s: float = math.nan  # end of the plan's landing, plan time
    unix_s: float | None = None  # the vehicles' common GNSS time
    nearest: NearestPair | None = None  # the pair of `separation_m`
    separation_min_m: float = math.nan  # the limit of `[judge]`
    lacks: Mapping[int, str] = field(default_factory=dict)  # missing readiness condition; empty: ready


@dataclass(frozen=True)
class VehicleNow:
    """One vehicle as it reports itself now; NaN for what it has not reported.

    Positions carry the error of the vehicle's own navigation, so every figure here does.
    """

    sysid: int
    mode: str  # empty before its first HEARTBEAT
    armed: bool
    height_m: float  # above the origin's height
    speed_mps: float
    battery_pct: float  # of a full battery
    link_age_s: float  # since its last message; infinite if it was never heard
    loss: float  # share of its frames that were lost
    error_m: float  # distance to its planned position
    zone_m: float  # outside the nearest no-fly zone, negative inside; infinite without zones
    above_ground_m: float  # vertically
    fence_m: float = math.nan  # inside the side of the fence, negative outside
    ceiling_m: float = math.nan  # below `[limits] height_m`
    place_ned_m: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    velocity_ned_mps: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    in_band: bool | None = None  # of the predicted track of its own mission; None while it flies none


GROUND_REACH_M = 50.0  # a larger distance to the ground is not computed
OFF_PLAN = "off_plan_unix_s"  # in the data of an event: from a standstill until all are on the plan again
ALL_VEHICLES, OURSELVES = 0, -1  # as the vehicle of an event: the whole fleet, and this program


@dataclass(frozen=True)
class Event:
    """One incident of a vehicle, or one order to it with the rule behind it."""

    unix_s: float  # GNSS time; NaN before it is known
    t_s: float  # plan time; NaN before T0
    sysid: int  # a vehicle's, `ALL_VEHICLES` or `OURSELVES`
    what: str
    rule: str = ""
    data: Mapping[str, object] | None = field(default=None, hash=False)  # the numbers of a choice, as plain values
    alarm: bool = False  # a vehicle says that something fails: shown as a warning
    action: Action | None = None  # of an order to it

    @property
    def is_remark(self) -> bool:
        """Whether it only says how the whole flight goes on: no incident, no order."""
        return self.sysid == ALL_VEHICLES and not (self.rule or self.data or self.alarm or self.action)

    def __str__(self) -> str:
        when = "before T0" if math.isnan(self.t_s) else f"t = {self.t_s:.1f} s"
        others = {ALL_VEHICLES: "all vehicles", OURSELVES: "this program"}
        subject = others.get(self.sysid, f"vehicle {self.sysid}")
        return f"{when}: {subject} {self.what}. {self.rule}".rstrip(". ")


@dataclass(frozen=True)
class OrderForecast:
    """The vehicles that would obey an order now, and in words and numbers what they would do."""

    vehicles: tuple[int, ...]  # system ids
    words: str


@dataclass(frozen=True)
class PlanForecast:
    """A verified plan that nobody flies yet: in words and numbers what it changes, and its tracks to the landing."""

    words: str
    t_s: Array  # (N,) plan times
    places_ned_m: Array  # (V, N, 3)


class PredictedPlaces(Protocol):
    """Where missions on board have their vehicles over time, and how far off that they may be."""

    sysids: tuple[int, ...]
    band_m: float  # beside the track
    band_s: Array  # (V,) early or late

    def places(self, rows: list[int], t_s: Array) -> Array:
        """Return positions (R, T, 3) of the vehicles in these rows, each at its own plan times (R, T)."""
        ...


class InFlight(Protocol):
    """A flight, as far as a watcher reads it."""

    @property
    def plan(self) -> Plan:
        """The plan as it is flown; an order may change it."""
        ...

    def snapshot(self) -> Snapshot:
        """Return how it stands now."""
        ...

    def vehicles_now(self) -> tuple[VehicleNow, ...]:
        """Return every vehicle as it reports itself now."""
        ...

    @property
    def predicted(self) -> PredictedPlaces | None:
        """What is predicted of the missions on board; None while none is flown."""
        ...

    def ground_margins_m(self, sysids: Collection[int]) -> dict[int, float]:
        """Return the distance of vehicles to the ground in any direction, up to `GROUND_REACH_M`."""
        ...

    def forecast(self, order: AskedOrder, vehicles: Collection[int] = ()) -> OrderForecast:
        """Return what an order of the operator would do now. Raises as `ask` does."""
        ...

    def ask(self, order: AskedOrder | PlanOrder, vehicles: Collection[int] = (), *, by: str = "") -> tuple[int, ...]:
        """Give an order to vehicles; none named: to all. Return those that obey. Raises FlightError if none would.

        A `PlanOrder` (`gcs.Avoid`, `gcs.Scale`, `gcs.Reshape`) changes the plan of all.
        """
        ...

    async def propose(self, order: PlanOrder) -> PlanForecast:
        """Return what a `PlanOrder` would lead to now; nobody flies it. Raises as `ask` and `answer` do."""
        ...

    async def answer(self) -> str:
        """Return what came of the last `PlanOrder`, in words. Raises FlightError for a refused one."""
        ...


class Watcher:
    """Receives the progress of a flight; this one ignores it."""

    @property
    def laps_s(self) -> dict[str, float]:
        """The seconds that each part took, for the report."""
        return {}

    def say(self, text: str) -> None:
        """Take one line of progress."""

    def warn(self, text: str) -> None:
        """Take one warning."""
        self.say(f"WARNING: {text}")

    def event(self, event: Event) -> None:
        """Take one incident or order; `say` or `warn` has had it as a line."""

    def lap(self, name: str) -> None:
        """Note that this part of the work is done."""

    def checks(self, checks: tuple[PreflightCheck, ...]) -> None:
        """Take the results of the pre-flight checks."""

    async def confirm(self) -> str:
        """Return who permits to arm, for the record; the checks have passed. Raises `UsageError` if it is denied."""
        return "the program"

    async def follow(self, flight: InFlight) -> None:
        """Run beside the flight until cancelled; `flight.snapshot()` returns how it stands."""


def _log(text: str) -> None:
    logging.getLogger(__name__).error(text)


def spared(call: Callable[P, object], what: str, say: Callable[[str], None] = _log) -> Callable[P, None]:
    """Return `call` without its failures: a screen that fails does not reach the flight. `say` gets the first."""
    failed = False

    def spare(*arguments: P.args, **named: P.kwargs) -> None:
        nonlocal failed
        try:
            call(*arguments, **named)
        except Exception as failure:
            if failed:
                return
            failed = True
            with suppress(Exception):
                say(f"{what} failed, the flight goes on without it: {type(failure).__name__}: {failure}")

    return spare


def _ignore(*_: object) -> None:
    pass


@dataclass(frozen=True)
class FlightHooks:
    """What is called during a flight. `on_read_back` follows the upload.

    `on_ready` may raise to stop the flight before the upload; it returns the charge to end with, None: any.
    """

    on_event: Callable[[Event], None] = _ignore
    on_step: Callable[[Step, float | None], None] = _ignore  # the step begun, and T0 once it is known
    on_ready: Callable[[], Awaitable[ChargeRule | None]] | None = None
    on_read_back: Callable[[Holdings], None] = _ignore

    def spared(self) -> FlightHooks:
        """Return the same hooks, without the failures of those that only report."""
        return replace(
            self,
            on_event=spared(self.on_event, "the report of events"),
            on_step=spared(self.on_step, "that of steps"),
            on_read_back=spared(self.on_read_back, "that of the upload"),
        )


def notice_event(
    notice: LinkNotice, systems: Mapping[int, int], unix_s: float | None, t0_unix_s: float | None
) -> Event:
    """Return the event of a notice. `systems` are the MAVLink systems of vehicles that differ from their numbers."""
    vehicle_of = {system: sysid for sysid, system in systems.items()}
    now_s = math.nan if unix_s is None else unix_s
    t_s = math.nan if t0_unix_s is None else now_s - t0_unix_s
    sysid = vehicle_of.get(notice.system, notice.system) if notice.system else OURSELVES
    return Event(now_s, t_s, sysid, notice.text, _RULE)
