"""The words of `gcs tell`: what each order needs, and places in degrees."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import UsageError
from gcs.flight.contingency.order_words import order_of
from gcs.flight.monitoring.progress import AskedOrder
from gcs.frames import ned_to_geodetic
from gcs.plan.formation_orders import Avoid, FlyHome, GoOn, GoTo, Hold, Reshape, Scale, Slower
from gcs.scenario.schema.scenario import EventTable, Scenario
from gcs.scenario.values.si import local_origin


def test_orders_are_read_from_words(simulation1: Scenario) -> None:
    assert order_of(["avoid", "560,480,30"], simulation1) == Avoid(560.0, 480.0, 30.0)
    assert order_of(["scale", "0.6"], simulation1) == Scale(0.6)
    assert order_of(["shape", "start"], simulation1) == Reshape("start")
    assert order_of(["home"], simulation1) == FlyHome()
    assert order_of(["slower", "0.7"], simulation1) == Slower(0.7)
    assert order_of(["go", "560,480,30"], simulation1) == GoTo(560.0, 480.0, 30.0)
    assert order_of(["hold"], simulation1) == Hold()
    assert order_of(["resume"], simulation1) == GoOn()
    assert order_of(["land"], simulation1) is AskedOrder.LAND


def test_a_place_may_be_given_in_degrees(simulation1: Scenario) -> None:
    lat_deg, lon_deg, _ = ned_to_geodetic(np.array([560.0, 480.0, 0.0]), local_origin(simulation1))
    found = order_of(["avoid", f"{float(lat_deg):.9f},{float(lon_deg):.9f},30"], simulation1, in_degrees=True)
    assert isinstance(found, Avoid)
    assert (found.north_m, found.east_m) == pytest.approx((560.0, 480.0), abs=0.01)


def test_a_place_to_go_to_may_be_given_in_degrees(simulation1: Scenario) -> None:
    lat_deg, lon_deg, _ = ned_to_geodetic(np.array([560.0, 480.0, 0.0]), local_origin(simulation1))
    found = order_of(["go", f"{float(lat_deg):.9f},{float(lon_deg):.9f},30"], simulation1, in_degrees=True)
    assert isinstance(found, GoTo)
    assert (found.north_m, found.east_m, found.height_m) == pytest.approx((560.0, 480.0, 30.0), abs=0.01)


def test_a_polygon_is_avoided_with_the_smallest_disk_around_it(simulation1: Scenario) -> None:
    found = order_of(["avoid", "0,0", "30,0", "30,40", "0,40"], simulation1)
    assert found == Avoid(15.0, 20.0, 25.0)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "is no order"),
        (["dance"], "is no order"),
        (["hold", "now"], "is no order"),
        (["home", "now"], "is no order"),
        (["avoid"], "avoid of what"),
        (["avoid", "1,2"], "not what avoid needs"),
        (["avoid", "1,2,nan"], "not what avoid needs"),
        (["avoid", "1,2,-3"], "not one of this flight"),
        (["avoid", "1,2", "3,4"], "is no zone"),
        (["avoid", "1e9,2,3"], "not one of this flight"),
        (["scale", "0"], "not scaled by 0"),
        (["slower", "1.2"], "not slowed down to 1.2"),
        (["slower"], "slower of what"),
        (["go", "1,2"], "not what go needs"),
        (["go", "1,2,1e9"], "is no place of this flight"),
        (["go", "1,2,3", "4,5,6"], "is no order"),
        (["resume", "now"], "is no order"),
        (["scale", "x"], "not what scale needs"),
        (["shape", "heart"], 'no shape "heart"'),
    ],
)
def test_other_words_are_refused(simulation1: Scenario, words: list[str], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        order_of(words, simulation1)


def test_an_event_is_answered_by_the_order_that_the_scenario_has_for_it(simulation1: Scenario) -> None:
    rows = (EventTable(event="storm", order="scale", factor=0.6), EventTable(event="fog", order="land"))
    scenario = simulation1.model_copy(update={"on": rows})
    assert order_of(["event", "storm"], scenario) == Scale(0.6)
    assert order_of(["event", "fog"], scenario) is AskedOrder.LAND
    with pytest.raises(UsageError, match="no event") as refused:
        order_of(["event", "rain"], scenario)
    assert "storm, fog" in refused.value.hint
    with pytest.raises(UsageError, match="no event"):
        order_of(["event", "storm"], simulation1)
