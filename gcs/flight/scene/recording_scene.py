"""The scene of a recorded flight: flown and planned tracks, what vehicles reported, curves, events."""

import math

import numpy as np
from numpy.typing import NDArray

from gcs.autopilots.traits import mode_name
from gcs.flight.monitoring.progress import ALL_VEHICLES, Action, Event
from gcs.flight.recording.recording import SILENCE_S, Recording
from gcs.flight.scene import scene_curves
from gcs.flight.scene.plan_scene import (
    changes_of,
    fence_of,
    ground_of,
    inside_s,
    limits_of,
    needed_pct,
    phases_of_plan,
    planned_motion,
    points_of,
    rally_of,
    survey_of,
    zones_of,
)
from gcs.flight.scene.predicted_band import band_of, in_band
from gcs.flight.scene.scene_model import Curve, Happening, Motion, ReportedState, Scene, SceneKind
from gcs.plan.trajectory.distances import formation_error_m
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

Flags = NDArray[np.bool_]

_AWAY = frozenset({Action.LAND, Action.RETURN, Action.DIVERT, Action.LEAVE})
_LOW = 0.8  # of the hover before T0: a vehicle that returns is lower only to land


def scene_of_recording(recording: Recording, from_s: float, to_s: float) -> Scene:
    """Return the scene of a section of a recorded flight, with its plan beside it where it has one."""
    plan, ids = recording.plan, recording.sysids
    scenario = None if plan is None else plan.scenario
    t_s = scene_curves.instants_s(from_s, to_s, len(ids))
    places, rates = recording.at(t_s)
    flown = scene_curves.motion_of(scenario, places, rates)
    expected = recording.planned(t_s)
    planned = None if expected is None else _planned(recording, t_s, *expected)
    on_plan = _on_plan(recording, t_s)
    error_m = np.full(places.shape[:2], np.nan)
    if planned is not None:
        error_m = _error_m(places, planned, on_plan)
    true = _true(recording, t_s)
    true_m = None if true is None or planned is None else _error_m(true.places_ned_m, planned, on_plan)
    limits = {} if scenario is None else limits_of(scenario)
    return Scene(
        recording.name,
        SceneKind.REPLAY,
        ids,
        0 if scenario is None else scenario.formation.leader,
        t_s,
        None if scenario is None else ground_of(scenario, _known(places, planned)),
        () if scenario is None or plan is None else (*zones_of(scenario), fence_of(plan)),
        planned,
        flown,
        _reported(recording, t_s, places, error_m, on_plan),
        () if plan is None else phases_of_plan(plan),
        () if plan is None else changes_of(plan),
        (*_curves(plan, ids, t_s, (flown, planned, true), (error_m, true_m), limits), *_controls(plan, ids, t_s)),
        _events(recording, from_s, to_s),
        limits,
        recording.notes,
        None if plan is None else rally_of(plan),
        None if plan is None else needed_pct(plan, t_s),
        None if plan is None or recording.predicted is None else band_of(recording.predicted, plan, t_s),
        None if plan is None else survey_of(plan),
        () if scenario is None else points_of(scenario),
        lands_s=_lands_s(recording, t_s, flown),
    )


def happening(event: Event, *, is_bad: bool) -> Happening:
    """Return an event in words, without its time."""
    text = f"{event.what}. {event.rule}".rstrip(". ")
    return Happening(event.t_s, event.sysid, text, is_bad)


def _planned(recording: Recording, t_s: Array, places: Array, rates: Array) -> Motion:
    plan = recording.plan
    assert plan is not None
    yaw_rad = plan.named_states(inside_s(plan, t_s)).attitude_rad[..., 2]
    return scene_curves.motion_of(plan.scenario, places, rates, yaw_rad)


def _known(places: Array, planned: Motion | None) -> Array:
    return places if planned is None else np.concatenate([places, planned.places_ned_m])


def _error_m(places_ned_m: Array, planned: Motion, on_plan: Flags) -> Array:
    """Position errors (V, N) of places (V, N, 3); NaN for a vehicle that left the plan: its own says nothing."""
    return np.where(on_plan, np.linalg.norm(places_ned_m - planned.places_ned_m, axis=-1), np.nan)


def _on_plan(recording: Recording, t_s: Array) -> Flags:
    """Whether each vehicle flies the plan (V, N): not once it was ordered away from it, or was never heard again."""
    found = np.ones((len(recording.tracks), len(t_s)), dtype=np.bool_)
    lost_s = _lost_s(recording)
    for row, track in enumerate(recording.tracks):
        for event in recording.events:
            if event.sysid in (track.sysid, ALL_VEHICLES) and event.action is not None:
                found[row, t_s >= event.t_s] = event.action not in _AWAY
        found[row, t_s > lost_s[track.sysid]] = False
    return found


def _lost_s(recording: Recording) -> dict[int, float]:
    """When each vehicle was heard last, of those that fell silent before the others did; else infinite."""
    last_s = {track.sysid: float(track.t_s[-1]) if len(track.t_s) else -math.inf for track in recording.tracks}
    end_s = max(last_s.values(), default=0.0) - SILENCE_S
    return {sysid: at_s if at_s < end_s else math.inf for sysid, at_s in last_s.items()}


def _reported(recording: Recording, t_s: Array, places_ned_m: Array, error_m: Array, on_plan: Flags) -> ReportedState:
    tracks, plan, predicted = recording.tracks, recording.plan, recording.predicted
    words: dict[str, int] = {}
    shape = len(tracks), len(t_s)
    mode, armed, battery = (np.full(shape, fill, dtype=np.int64) for fill in (-1, 0, -1))
    age_s = np.full(shape, np.nan)
    for row, track in enumerate(tracks):
        last = np.searchsorted(track.t_s, t_s, side="right") - 1
        heard = last >= 0
        at = last[heard]
        named = {int(one): mode_name(track.autopilot, int(one)) for one in np.unique(track.mode)}
        place = {one: words.setdefault(name, len(words)) for one, name in named.items()}
        mode[row, heard] = [place[int(one)] for one in track.mode[at]]
        armed[row, heard], battery[row, heard] = track.armed[at], track.battery_pct[at]
        age_s[row, heard] = t_s[heard] - track.t_s[at]
    band = np.full(shape, -1, dtype=np.int64)
    if plan is not None and predicted is not None:
        band = np.where(on_plan, in_band(predicted, plan, t_s, places_ned_m), -1)
    return ReportedState(tuple(words), mode, armed, battery, age_s, error_m, band)


def _true(recording: Recording, t_s: Array) -> Motion | None:
    """The true motion of emulated vehicles; None where it is not known."""
    truth, plan = recording.truth, recording.plan
    if truth is None or plan is None:
        return None
    outside = (t_s < truth.t_s[0]) | (t_s > truth.t_s[-1])
    rates = np.gradient(truth.ned_m, truth.t_s, axis=1)
    found = []
    for values in (truth.ned_m, rates):
        between = [[np.interp(t_s, truth.t_s, one) for one in vehicle.T] for vehicle in values]
        found.append(np.where(outside[:, None], np.nan, np.array(between).swapaxes(1, 2)))
    return scene_curves.motion_of(plan.scenario, *found)


def _lands_s(recording: Recording, t_s: Array, flown: Motion) -> float:
    """When the last vehicle begins to land: by the plan, or after an order that took it down, or never heard again."""
    plan = recording.plan
    if plan is None:
        return math.inf
    lost_s = _lost_s(recording)
    begins_s = {sysid: min(plan.landing_s, lost_s.get(sysid, math.inf)) for sysid in plan.sysids}
    hover_m = _LOW * float(planned_motion(plan, np.zeros(1)).above_ground_m.min())
    for event in recording.events:
        for row, sysid in enumerate(plan.sysids):
            if event.sysid not in (sysid, ALL_VEHICLES):
                continue
            if event.action is Action.LAND:
                begins_s[sysid] = min(begins_s[sysid], event.t_s)
            elif event.action in (Action.RETURN, Action.DIVERT):  # flown, until it comes down for the last time
                high = np.flatnonzero((t_s >= event.t_s) & (flown.above_ground_m[row] > hover_m))
                begins_s[sysid] = float(t_s[high[-1]]) if len(high) else event.t_s
    return max(begins_s.values())


def _curves(
    plan: Plan | None,
    ids: tuple[int, ...],
    t_s: Array,
    motions: tuple[Motion, Motion | None, Motion | None],
    errors_m: tuple[Array, Array | None],
    limits: dict[str, float],
) -> tuple[Curve, ...]:
    """The curves of flown, planned and true motions, and of errors as reported and as they are."""
    flown, planned, true = motions
    curves = []
    if plan is not None:
        curves.append(scene_curves.ground_curve(ids, flown, planned, limits["above_ground_m"], true))
    if len(ids) > 1:
        curves.append(scene_curves.separation_curve(ids, flown, planned, limits.get("separation_m"), true))
    if plan is not None:
        curves.append(scene_curves.error_curve(ids, *errors_m))
    if plan is not None and len(ids) > 1:
        curves.append(_formation_curve(plan, t_s, motions, errors_m))
    return (*curves, scene_curves.speed_curve(ids, flown, planned, true))


def _controls(plan: Plan | None, ids: tuple[int, ...], t_s: Array) -> tuple[Curve, ...]:
    return () if plan is None else scene_curves.control_curves(ids, plan.controls(inside_s(plan, t_s)))


def _formation_curve(
    plan: Plan, t_s: Array, motions: tuple[Motion, Motion | None, Motion | None], errors_m: tuple[Array, Array | None]
) -> Curve:
    """Definition 1, from T0 to the order to land, while all vehicles fly the plan: elsewhere no shape is kept."""

    def formation_m(places: Array, off_m: Array) -> Array:
        kept = (t_s >= 0.0) & (t_s <= plan.landing_s) & np.isfinite(off_m).all(axis=0)
        found = np.full(len(t_s), np.nan)
        if kept.any():
            found[kept] = formation_error_m(places[:, kept], plan.offsets(t_s[kept]))
        return found

    none = np.zeros((len(t_s), 2), dtype=np.int64)
    flown, _, true = motions
    true_m = None if true is None or errors_m[1] is None else formation_m(true.places_ned_m, errors_m[1])
    reported_m = formation_m(flown.places_ned_m, errors_m[0])
    return Curve("formation error", "m", reported_m, None, none, at_least=False, true=true_m)


def _events(recording: Recording, from_s: float, to_s: float) -> tuple[Happening, ...]:
    found = [happening(event, is_bad=not event.is_remark) for event in recording.events]
    found += [happening(event, is_bad=event.alarm) for event in recording.remarks]
    return tuple(sorted((one for one in found if from_s <= one.t_s <= to_s), key=lambda one: one.t_s))
