"""Plans with a route, for tests: points drawn onto the track that the leader flies anyway."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import RoutePoint
from gcs.scenario.values.si import NED_FROM_UP


def with_route(plan: Plan, points: Mapping[float, Mapping[str, Any]], *, loops: int = 1) -> Plan:
    """The plan with a route point where its leader is at each of these times, and the other keys of each point."""
    places = plan.leader_trajectory.state(np.array(list(points)))[:, POSITION] * NED_FROM_UP
    route = tuple(
        RoutePoint.model_validate({"position_m": place, **keys})
        for place, keys in zip(places.tolist(), points.values(), strict=True)
    )
    scenario = plan.scenario.model_copy(update={"route": route, "loops": loops})
    return replace(plan, scenario=scenario, route_s=tuple(points))
