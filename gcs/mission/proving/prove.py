"""The proof of tracks: every vehicle and pair at every instant, against limits that are stated or a scenario's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.errors import UsageError
from gcs.mission.proving.break_off import BreakOff
from gcs.mission.proving.break_off_places import WAY_HALVES, BreakOffPlaces, ground_below_brakes
from gcs.mission.proving.break_off_returns import returned
from gcs.mission.proving.break_off_separation import BreakOffSeparation
from gcs.mission.proving.break_off_spans import Moved, proved_or_spans
from gcs.mission.proving.track import FleetMotion, PolynomialTrack
from gcs.mission.proving.track_criteria import (
    NamedRanges,
    TrackCriterion,
    TrackEffort,
    TrackMotion,
    TrackPlaces,
    TrackSeparation,
)
from gcs.mission.proving.track_report import TrackCheck, TrackReport, UnsafeSpan, settled_checks
from gcs.physics.quadrotor import Quadrotor
from gcs.physics.wind import STILL
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.ground_clearance import GroundClearance
from gcs.plan.verification.proof.subdivision import Cells, Family, Rows
from gcs.plan.verification.proof.taylor import Taylor
from gcs.plan.verification.proof.vehicle_tree import VehicleTree
from gcs.plan.verification.proof.verdict import (
    LENGTH_TOLERANCE_M,
    SPEED_TOLERANCE_MPS,
)
from gcs.scenario.environment.ground_distance import ground_distance_m
from gcs.scenario.environment.no_fly import Zone, ZoneName, zone_changes_s, zone_names, zones
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.schema.vehicle_types import VehicleFile
from gcs.scenario.sources.load import vehicle_type
from gcs.scenario.values.si import NED_FROM_UP, landing_points_ned_m, pads_ned_m, steady_wind
from gcs.types import Array
from gcs.util.long_work import searching_for

_CELLS_MAX = 20_000_000
_LISTED = 5
_ROUNDED_M = 1e-4  # far below the tolerance of lengths
_STEP_MPS2 = 0.01  # of the acceleration at a joint: setpoints are written in micrometres
_TAKEOFF, _AIRBORNE, _LANDING = range(3)  # phases of the ground's proof
_LOOKED_AT = 8  # edges of windows at once


@dataclass(frozen=True)
class TrackLimits:
    """What tracks are proved against. What is left out is the scenario's; without one it is not checked.

    With `vertical_scale` c the distance of two vehicles is the root of north² + east² + (down / c)², so that with c
    above 1 they keep farther apart in height.
    """

    separation_m: float | None = None
    vertical_scale: float = 1.0
    speed_mps: float | None = None
    acceleration_mps2: float | None = None
    height_m: tuple[float, float] | None = None  # above height 0, at all times
    clearance_m: float | None = None  # to the ground in any direction, from take-off to landing; needs a scenario
    jerk_mps3: float | None = None
    thrust_N: tuple[float, float] | None = None  # of the rotors together; needs a vehicle, whose limit it replaces
    tilt_deg: float | None = None  # of that force against the vertical, as `thrust_N`

    def __post_init__(self) -> None:
        for name in ("separation_m", "speed_mps", "acceleration_mps2", "jerk_mps3", "tilt_deg", "clearance_m"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise UsageError(f"limit {name} is {value}", hint="give a number above 0, or leave it out")
        if not (np.isfinite(self.vertical_scale) and self.vertical_scale > 0.0):
            raise UsageError(f"vertical_scale is {self.vertical_scale}", hint="give a number above 0; 1 is a sphere")
        for name in ("height_m", "thrust_N"):
            limits = getattr(self, name)
            if limits is not None and not limits[0] < limits[1]:
                raise UsageError(f"limits {name} from {limits[0]} to {limits[1]} are none", hint="give the lower first")


def prove(
    tracks: Sequence[PolynomialTrack],
    limits: TrackLimits | None = None,
    scenario: Scenario | None = None,
    vehicle: str | Path | None = None,
    abort: BreakOff | None = None,
    plan: Plan | None = None,
    limit_s: float | None = None,
) -> TrackReport:
    """Prove tracks of any planner on intervals of time: separation, motion, effort, heights, ground, zones, continuity.

    Time 0 and place (0, 0, 0) are those of the scenario. With a `vehicle`, a preset's name or a vehicle file, thrust
    and tilt are proved in the scenario's wind. With `abort`, it is proved too that all may break off at any instant:
    the same distances, heights, ground and zones, until the last vehicle rests. To prove returns, the tracks are those
    of a `plan`, and the scenario is its own. With `limit_s` each criterion, and each search for the instants at which
    one is not proved, ends after so much time; what is not settled by then is undecided.

    Raises `UsageError` for tracks or limits that leave nothing to prove.
    """
    limits = limits or TrackLimits()
    flown = None if vehicle is None else vehicle_type(vehicle)
    _refuse(tracks, limits, scenario, flown, abort)
    if abort is not None and abort.manoeuvre == "return":
        if plan is None:
            text = "the ground station returns the vehicles of a plan alone"
            raise UsageError(text, hint="give a plan or a scenario of Skein; or hold, or land")
        if scenario is None or (scenario.no_fly, scenario.keep_in) != (plan.scenario.no_fly, plan.scenario.keep_in):
            text = "returns lead round the zones of the plan's own scenario"
            raise UsageError(
                text, hint="give no other scenario and no fence; `no_fly` and `keep_in` may have its areas"
            )
    # What has no bounds is not proved.
    with searching_for(limit_s), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _Proofs(tuple(tracks), limits, scenario, flown, abort, plan).report()


def _refuse(
    tracks: Sequence[PolynomialTrack],
    limits: TrackLimits,
    scenario: Scenario | None,
    vehicle: VehicleFile | None,
    abort: BreakOff | None,
) -> None:
    if not tracks:
        raise UsageError("there are no tracks", hint="give at least one")
    names = [each.name for each in tracks]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise UsageError(f"two tracks have the name {twice[0]}", hint="name each vehicle once")
    if vague := [each for each in tracks if not each.rounding_m <= _ROUNDED_M]:
        raise UsageError(
            f"track {vague[0].name} has terms so large that rounding moves its places by {vague[0].rounding_m:.2g} m",
            hint="give places nearer to 0, or polynomials in shorter pieces, each from time 0",
        )
    if limits.clearance_m is not None and scenario is None:
        raise UsageError("a clearance above the ground needs the ground", hint="give the scenario with the terrain")
    if len(tracks) > 1 and limits.separation_m is None and scenario is None:
        raise UsageError("no separation is stated", hint="give a separation in metres, or a scenario with its limits")
    if vehicle is None and (limits.thrust_N is not None or limits.tilt_deg is not None):
        raise UsageError("thrust and tilt depend on mass and drag", hint="give the vehicle: a preset, or a file")
    accelerates = limits.acceleration_mps2 is not None or limits.jerk_mps3 is not None or vehicle is not None
    if accelerates and (plain := [each.name for each in tracks if not each.accelerates]):
        raise UsageError(
            f"track {plain[0]} is straight between samples: how it accelerates is not known",
            hint="add its velocities, or leave out the vehicle and the limits of acceleration and jerk",
        )
    bent = [each.name for each in tracks if each.off_m]
    if abort is not None and bent:
        raise UsageError(
            f"track {bent[0]} is the flight of a mission, near straight pieces that do not bound its speed",
            hint="leave out the breaking off, or give trajectories: it begins with a velocity that must be known",
        )
    if limits.speed_mps is not None and bent:
        raise UsageError(
            f"track {bent[0]} is the flight of a mission, near straight pieces that do not bound its speed",
            hint="leave out the limit of the speed; `gcs check` judges the speeds of missions",
        )


@dataclass(frozen=True)
class _Proofs:
    tracks: tuple[PolynomialTrack, ...]
    limits: TrackLimits
    scenario: Scenario | None
    vehicle: VehicleFile | None
    abort: BreakOff | None
    plan: Plan | None

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(each.name for each in self.tracks)

    @property
    def _zones(self) -> tuple[tuple[ZoneName, Zone], ...]:
        """All zones of the scenario, also those that its box and its flight do not meet: tracks may."""
        if self.scenario is None:
            return ()
        every = self.scenario.model_copy(update={"no_fly": (*self.scenario.no_fly, *self.scenario.no_fly_beyond)})
        return tuple(zip(zone_names(every), zones(every), strict=True))

    def report(self) -> TrackReport:
        """All checks."""
        own = None if self.scenario is None else self.scenario.limits
        avoided = self._zones
        motion = FleetMotion.of(self.tracks, zone_changes_s([zone for _, zone in avoided]))
        separation_m, height_m = self.limits.separation_m, self.limits.height_m
        if own is not None:
            separation_m = separation_m or own.separation_min_m
            # Its lower height holds in the air alone, where the clearance says more.
            height_m = height_m or (-np.inf, own.height_m[1])
        checks = self._continuity(motion)
        if separation_m and len(self.tracks) > 1:
            family = TrackSeparation(motion, separation_m, self.limits.vertical_scale)
            checks += settled_checks(self._names, family, family.criteria, family.cells())
        checks += self._motion(motion)
        checks += self._effort(motion)
        places = TrackPlaces(
            motion,
            (("northing", None), ("easting", None), ("height", height_m))
            if self.scenario is None
            else self._box(self.scenario, height_m),
            avoided,
            0.0 if own is None else own.zone_margin_m or 0.0,
        )
        if places.criteria:
            checks += settled_checks(self._names, places, places.criteria, _every(motion))
        if self.scenario is not None:
            checks += self._ground(self.scenario, motion)
        unsafe: list[UnsafeSpan] = []
        if self.abort is not None:
            more, unsafe = self._broken_off(self.abort, motion, separation_m, places)
            checks += more
        ends_s = float(motion.edges_s[0]), float(motion.edges_s[-1])
        unchecked = self._unchecked(has_heights=bool(height_m))
        return TrackReport(tuple(checks), unchecked, self._names, *ends_s, tuple(unsafe))

    def _unchecked(self, *, has_heights: bool) -> tuple[str, ...]:
        """What has no limit here."""
        found = [name for _, name, _, most in self._rates if not most]
        found += ["the scenario's speeds"] * (self.scenario is not None and any(each.off_m for each in self.tracks))
        found += ["thrust", "tilt"] * (self.vehicle is None) + ["height"] * (not has_heights)
        return (*found, *(("ground", "no-fly zones") if self.scenario is None else ("the scenario's least height",)))

    @property
    def _rates(self) -> tuple[tuple[int, str, str, float | None], ...]:
        """Derivatives of the place, with the limits asked for."""
        limits = self.limits
        return (
            (1, "speed", "m/s", limits.speed_mps),
            (2, "acceleration", "m/s²", limits.acceleration_mps2),
            (3, "jerk", "m/s³", limits.jerk_mps3),
        )

    def _broken_off(
        self, how: BreakOff, motion: FleetMotion, separation_m: float | None, places: TrackPlaces
    ) -> tuple[list[TrackCheck], list[UnsafeSpan]]:
        """Separation, heights, zones and ground of all that break off at the same instant, whichever it is."""
        checks: list[TrackCheck] = []
        spans: list[UnsafeSpan] = []
        parts: list[tuple[tuple[str, ...], Family, tuple[TrackCriterion, ...], Cells, Moved]] = []
        if self.plan is not None and how.manoeuvre == "return":
            straight, apart_m = returned(self.plan, motion, self.limits.separation_m, self.limits.vertical_scale)
            checks += straight
            parts += [(self._names, each, each.criteria, each.cells(), each.moved_m) for each in apart_m]
        elif separation_m and len(self.tracks) > 1:
            apart = BreakOffSeparation(motion, separation_m, self.limits.vertical_scale, how)
            parts.append((self._names, apart, apart.criteria, apart.cells(), apart.moved_m))
        if places.criteria:
            beside = BreakOffPlaces(motion, places.ranges_m, places.zones, places.zone_margin_m, how)
            parts.append((self._names, beside, beside.criteria, beside.cells(), beside.moved_m))
        if self.scenario is not None:
            limit_m, (phase, _) = self._clearance_m(self.scenario), self._phases(self.scenario, motion)
            below = ground_below_brakes(motion, phase == _AIRBORNE, self.scenario.terrain, limit_m, how)
            halves = tuple(name for name in self._names for _ in range(WAY_HALVES))
            parts.append((halves, *below))
        for part in parts:
            found, of_part = proved_or_spans(*part)
            checks, spans = checks + found, spans + of_part
        return checks, sorted(spans, key=lambda span: span.start_s)

    def _clearance_m(self, scenario: Scenario) -> float:
        return self.limits.clearance_m or scenario.limits.clearance_min_m

    def _box(self, scenario: Scenario, height_m: tuple[float, float] | None) -> NamedRanges:
        """The scenario's box, so wide that its pads and landing points, and those of the tracks, are in it."""
        ends = np.concatenate([each.position_ned_m(each.position_ned_m.x[[0, -1]]) for each in self.tracks])
        north_m, east_m, up_m = (ends * NED_FROM_UP).T
        above_m = up_m - ground_height_m(scenario.terrain, north_m, east_m)
        own = pads_ned_m(scenario), landing_points_ned_m(scenario)
        stands = np.concatenate([ends[above_m < self._clearance_m(scenario)], *own])
        limits = scenario.limits
        north, east = (
            (min(low, stands[:, axis].min().item()), max(high, stands[:, axis].max().item()))
            for axis, (low, high) in enumerate((limits.north_m, limits.east_m))
        )
        return ("northing", north), ("easting", east), ("height", height_m)

    def _continuity(self, motion: FleetMotion) -> list[TrackCheck]:
        """Steps at joints: of the place, of the velocity where the acceleration counts, of that where the jerk does."""
        found = []
        jerk = self.limits.jerk_mps3 is not None
        accelerates = jerk or self.limits.acceleration_mps2 is not None or self.vehicle is not None
        for derivative, name, unit, allowed, counts in (
            (0, "step of the place at a joint", "m", LENGTH_TOLERANCE_M, True),
            (1, "step of the velocity at a joint", "m/s", SPEED_TOLERANCE_MPS, accelerates),
            (2, "step of the acceleration at a joint", "m/s²", _STEP_MPS2, jerk),
        ):
            if not counts:
                continue
            steps = motion.steps(derivative)
            piece = int(steps.argmax())
            most, who, t_s = float(steps[piece]), self._names[motion.row[piece]], float(motion.starts_s[piece])
            found.append(TrackCheck(name, unit, allowed, True, most, most, 0.0, (who,), t_s))
        return found

    def _motion(self, motion: FleetMotion) -> list[TrackCheck]:
        """Speed, acceleration and jerk, while a vehicle's own polynomial says where it is."""
        stated = tuple(
            (order, TrackCriterion(name, unit, most, most=True)) for order, name, unit, most in self._rates if most
        )
        axes: tuple[TrackCriterion, ...] = ()
        if self.scenario is not None and not any(each.off_m for each in self.tracks):
            named = zip(("north", "east", "the vertical"), self.scenario.limits.speed_ned_mps, strict=True)
            axes = tuple(TrackCriterion(f"speed along {axis}", "m/s", most, most=True) for axis, most in named)
        family = TrackMotion(motion, stated, axes)
        return (
            settled_checks(self._names, family, family.criteria, _every(motion, moving=True)) if family.criteria else []
        )

    def _effort(self, motion: FleetMotion) -> list[TrackCheck]:
        """Thrust and tilt, in the scenario's wind."""
        if self.vehicle is None:
            return []
        body, own = self.vehicle.vehicle, self.vehicle.limits
        wind = STILL if self.scenario is None else steady_wind(self.scenario)
        tilt_deg = self.limits.tilt_deg or min(own.roll_pitch_yaw_deg[:2])
        family = TrackEffort(
            motion,
            Quadrotor(**body.model_dump(exclude={"name", "power"}), wind=wind),
            self.limits.thrust_N or own.thrust_N,
            np.radians(tilt_deg).item(),
        )
        return settled_checks(self._names, family, family.criteria, _every(motion, moving=True))

    def _phases(self, scenario: Scenario, motion: FleetMotion) -> tuple[Rows, Array]:
        """Whether vehicles take off, fly or land in each piece (P,), and the heights of their pads (3, V)."""
        count, windows = len(self.tracks), len(motion.edges_s) - 1
        phase = np.full((count, windows), _AIRBORNE, dtype=np.intp)
        first, last = self._high_ends(scenario, motion)
        number = np.arange(windows)
        phase[number < first[:, None]] = _TAKEOFF
        phase[number >= last[:, None]] = _LANDING
        pads, rows = np.zeros((3, count)), np.arange(count)
        for of, t_s in ((_TAKEOFF, motion.edges_s[0]), (_LANDING, motion.edges_s[-1])):
            pads[of] = motion.places(rows, np.full(count, t_s))[:, 2]
        return phase[motion.row, motion.window], pads

    def _high_ends(self, scenario: Scenario, motion: FleetMotion) -> tuple[Rows, Rows]:
        """The first and the last edge (V,) of windows at which a vehicle is as high as its clearance.

        One that is never high enough does not only take off and land: 0, and the last edge of all.
        """
        limit_m, count, edges = self._clearance_m(scenario), len(self.tracks), len(motion.edges_s)
        ends = np.zeros(count, dtype=np.intp), np.full(count, edges - 1)
        for found, order in zip(ends, (1, -1), strict=True):
            waiting, numbers = np.arange(count), np.arange(edges)[::order]
            for begin in range(0, edges, _LOOKED_AT):  # most are high after a few: the others need not be computed
                some = numbers[begin : begin + _LOOKED_AT]
                row, at_s = np.repeat(waiting, len(some)), np.tile(motion.edges_s[some], len(waiting))
                north_m, east_m, up_m = (motion.places(row, at_s) * NED_FROM_UP).T
                away_m = ground_distance_m(scenario.terrain, north_m, east_m, up_m, 2.0 * limit_m)
                is_high = away_m.reshape(len(waiting), -1) >= limit_m
                there = is_high.any(axis=1)
                found[waiting[there]] = some[is_high[there].argmax(axis=1)]
                waiting = waiting[~there]
                if not len(waiting):
                    break
        return ends

    def _ground(self, scenario: Scenario, motion: FleetMotion) -> list[TrackCheck]:
        """The distance to the ground from take-off to landing; before and after, what is beside the place below."""
        limit_m, cells, (phase, pads) = self._clearance_m(scenario), _every(motion), self._phases(scenario, motion)
        cells = Cells(cells.who, cells.start_s, cells.end_s, phase, cells.patch)
        alone = np.arange(len(self.tracks))
        none = np.full((len(alone), 2), -1)
        single = VehicleTree(alone, none, np.zeros((len(alone), 0, 3)), np.zeros(len(alone)), np.zeros((len(alone), 3)))

        def places_of(some: Cells) -> Taylor:
            return motion.enclosed(some.who[:, 0], some.start_s, some.end_s)

        airborne = np.array([_AIRBORNE])
        family = GroundClearance(places_of, single, scenario.terrain, limit_m, airborne, pads)
        criteria = (
            TrackCriterion("clearance above the ground", "m", limit_m),
            TrackCriterion("room beside the ground at take-off and landing", "m", 0.0),
        )
        return settled_checks(self._names, family, criteria, family.around(cells), phases=3)


def _every(motion: FleetMotion, *, moving: bool = False) -> Cells:
    """Every piece of every vehicle, or those of its own polynomial."""
    pieces = np.flatnonzero(motion.moves | (not moving))
    none = np.zeros(len(pieces), dtype=np.intp)
    starts_s, ends_s = motion.starts_s[pieces], motion.ends_s[pieces]
    return Cells(motion.row[pieces, None], starts_s, ends_s, none, np.zeros((len(pieces), 0)))
