"""Waypoint missions as tracks: the flights that the models of their autopilots predict, all from the same start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import FileFormatError
from gcs.mission.flight_limits import surroundings_of
from gcs.mission.formats.any_mission import read_mission
from gcs.mission.formats.table_rows import HEADER
from gcs.mission.formats.vendor_quirks import first_line
from gcs.mission.predicted.autopilot_flight import AutopilotFlight
from gcs.mission.predicted.planned_flight import PredictedFlight, surroundings, together
from gcs.mission.proving.csv_rows import TrackFile
from gcs.mission.proving.track import PolynomialTrack
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import ability_of, quadrotor


def is_mission(file: TrackFile) -> bool:
    """Whether a file begins as missions do."""
    return file.is_text and first_line(file.data).startswith(("{", HEADER.split()[0]))


def read_missions(
    files: Sequence[TrackFile], scenario: Scenario | None
) -> list[tuple[list[PolynomialTrack], list[str]]]:
    """One track for each mission in the frame of the scenario or of the first home, and what the model leaves out.

    Raises `FileFormatError` for a file that is no mission, or one without a flight.
    """
    missions = [read_mission(file.data, file.source) for file in files]
    around = surroundings(missions) if scenario is None else surroundings_of(scenario)
    model = AutopilotFlight() if scenario is None else AutopilotFlight(ability_of(quadrotor(scenario), scenario.limits))
    flights = together([model(mission, around) for mission in missions])
    found = []
    for file, flight in zip(files, flights, strict=True):
        left_out = [f"item {item}: {remark}" for item, remark in flight.remarks]
        found.append(([_track(file.stem, file.source, flight)], left_out))
    return found


def _track(name: str, source: str, flight: PredictedFlight) -> PolynomialTrack:
    """The straight pieces of a flight, but for those that take no time, and how far it bends away from them."""
    length_s = np.diff(flight.t_s)
    lasts = np.flatnonzero(length_s > 0.0)
    if not len(lasts):
        raise FileFormatError(f"{source}: the mission leads nowhere.", hint="give it items that are flown")
    slope = np.diff(flight.ned_m, axis=0)[lasts] / length_s[lasts, None]
    t_s = np.append(flight.t_s[lasts], flight.t_s[-1])
    return PolynomialTrack(
        name, PPoly(np.stack([slope, flight.ned_m[lasts]]), t_s), float(flight.bent_m.max(initial=0.0))
    )
