"""The scene of a recorded flight: flown and planned tracks, what vehicles reported, curves, events."""

import numpy as np

from gcs.autopilots.traits import mode_name
from gcs.flight.monitoring.progress import Event
from gcs.flight.recording.recording import Recording
from gcs.flight.scene import scene_curves
from gcs.flight.scene.plan_scene import (
    changes_of,
    fence_of,
    ground_of,
    inside_s,
    limits_of,
    needed_pct,
    phases_of_plan,
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


def scene_of_recording(recording: Recording, from_s: float, to_s: float) -> Scene:
    """Return the scene of a section of a recorded flight, with its plan beside it where it has one."""
    plan, ids = recording.plan, recording.sysids
    scenario = None if plan is None else plan.scenario
    t_s = scene_curves.instants_s(from_s, to_s, len(ids))
    places, rates = recording.at(t_s)
    flown = scene_curves.motion_of(scenario, places, rates)
    expected = recording.planned(t_s)
    planned = None if expected is None else _planned(recording, t_s, *expected)
    error_m = np.full(places.shape[:2], np.nan)
    if planned is not None:
        error_m = np.linalg.norm(places - planned.places_ned_m, axis=-1)
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
        _reported(recording, t_s, places, error_m),
        () if plan is None else phases_of_plan(plan),
        () if plan is None else changes_of(plan),
        (*_curves(plan, ids, t_s, flown, planned, error_m, limits), *_controls(plan, ids, t_s)),
        _events(recording, from_s, to_s),
        limits,
        recording.notes,
        None if plan is None else rally_of(plan),
        None if plan is None else needed_pct(plan, t_s),
        None if plan is None or recording.predicted is None else band_of(recording.predicted, plan, t_s),
        None if plan is None else survey_of(plan),
        () if scenario is None else points_of(scenario),
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


def _reported(recording: Recording, t_s: Array, places_ned_m: Array, error_m: Array) -> ReportedState:
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
        band = in_band(predicted, plan, t_s, places_ned_m)
    return ReportedState(tuple(words), mode, armed, battery, age_s, error_m, band)


def _curves(
    plan: Plan | None,
    ids: tuple[int, ...],
    t_s: Array,
    flown: Motion,
    planned: Motion | None,
    error_m: Array,
    limits: dict[str, float],
) -> tuple[Curve, ...]:
    curves = []
    if plan is not None:
        curves.append(scene_curves.ground_curve(ids, flown, planned, limits["above_ground_m"]))
    if len(ids) > 1:
        curves.append(scene_curves.separation_curve(ids, flown, planned, limits.get("separation_m")))
    if plan is not None:
        curves.append(scene_curves.error_curve(ids, error_m))
    if plan is not None and len(ids) > 1:
        curves.append(_formation_curve(plan, t_s, flown.places_ned_m))
    return (*curves, scene_curves.speed_curve(ids, flown, planned))


def _controls(plan: Plan | None, ids: tuple[int, ...], t_s: Array) -> tuple[Curve, ...]:
    return () if plan is None else scene_curves.control_curves(ids, plan.controls(inside_s(plan, t_s)))


def _formation_curve(plan: Plan, t_s: Array, places_ned_m: Array) -> Curve:
    """Definition 1, from T0 to the order to land, where all vehicles are known: elsewhere no shape is kept."""
    kept = (t_s >= 0.0) & (t_s <= plan.landing_s) & np.isfinite(places_ned_m[..., 0]).all(axis=0)
    error_m = np.full(len(t_s), np.nan)
    if kept.any():
        error_m[kept] = formation_error_m(places_ned_m[:, kept], plan.offsets(t_s[kept]))
    return Curve("formation error", "m", error_m, None, np.zeros((len(t_s), 2), dtype=np.int64), at_least=False)


def _events(recording: Recording, from_s: float, to_s: float) -> tuple[Happening, ...]:
    found = [happening(event, is_bad=True) for event in recording.events]
    found += [happening(event, is_bad=event.alarm) for event in recording.remarks]
    return tuple(sorted((one for one in found if from_s <= one.t_s <= to_s), key=lambda one: one.t_s))
